//! Growth with a scene's size: mattes with the size of a picture, preparation and training steps with
//! the number of views.

// `criterion_group!` writes a public function.
#![allow(missing_docs)]

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use demo_scene::DemoConfig;
use glam::Vec2;
use io_colmap::{MaskSet, Scene};
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::view::{TrainView, load_views};
use sos_train::prepare::{Prepared, prepare};
use sos_train::train::Trainer;

/// The tiny demo scene with so many views: what `prepare` is given.
fn views(count: usize) -> (Vec<TrainView>, Scene) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let demo = DemoConfig {
        views: count,
        ..DemoConfig::tiny()
    };
    let written = demo_scene::generate(&demo).write(folder.path());
    written.expect("the demo scene is written");
    let scene = Scene::open(folder.path()).expect("the demo scene is read");
    let masks = MaskSet::find(&folder.path().join("coarse_masks"), &scene, None);
    let masks = masks.expect("the masks are found");
    let views = load_views(&scene, Some(&masks)).expect("the photos are read");
    (views, scene)
}

fn prepared(views: Vec<TrainView>, scene: &Scene, config: &TrainConfig) -> Prepared {
    let band = config.loss.ignore_band;
    prepare(views, &scene.model.points, &config.prepare, band).expect("masks that agree")
}

fn short_run() -> TrainConfig {
    TrainConfig {
        steps: 200,
        ..TrainConfig::preset(Preset::Quick)
    }
}

fn growth_with_views(c: &mut Criterion) {
    let config = short_run();
    let mut group = c.benchmark_group("number_of_views");
    for count in [6, 12, 24] {
        let (views, scene) = views(count);
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::new("prepare", count), |b| {
            b.iter_batched(
                || views.clone(),
                |views| black_box(prepared(views, &scene, &config)),
                criterion::BatchSize::PerIteration,
            );
        });
        let data = prepared(views, &scene, &config);
        let mut trainer = Trainer::new(&config, &data).expect("a device");
        group.throughput(Throughput::Elements(1));
        group.bench_function(BenchmarkId::new("training_step", count), |b| {
            b.iter(|| black_box(trainer.step(&data)));
        });
    }
}

fn growth_with_size(c: &mut Criterion) {
    let config = short_run();
    let (views, scene) = views(12);
    let data = prepared(views, &scene, &config);
    let mut trainer = Trainer::new(&config, &data).expect("a device");
    while trainer.step_number() < config.steps {
        trainer.step(&data);
    }
    let frozen = trainer.freeze();
    let view = &data.views[0];
    let world_from_camera = view.world_from_camera(&data.frame);
    let mut group = c.benchmark_group("size_of_a_picture");
    for factor in [1, 2, 4] {
        let (width, height) = (factor * view.width(), factor * view.height());
        let rays: Vec<_> = (0..width * height)
            .filter_map(|i| {
                let pixel = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                view.ray(&world_from_camera, pixel / factor as f32)
            })
            .collect();
        group.throughput(Throughput::Elements(rays.len() as u64));
        let size = format!("{width}x{height}");
        group.bench_function(BenchmarkId::new("mattes", &size), |b| {
            b.iter(|| black_box(frozen.mattes(&rays)));
        });
        group.bench_function(BenchmarkId::new("whole_pictures", &size), |b| {
            b.iter(|| black_box(frozen.render(&rays)));
        });
    }
}

fn short() -> Criterion {
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
}

criterion_group! { name = benches; config = short(); targets = growth_with_views, growth_with_size }
criterion_main!(benches);
