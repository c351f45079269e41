//! A whole training step: samples of both fields, compositing, losses, gradients, optimisers.

use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use demo_scene::DemoConfig;
use hashgrid::{GridLayout, SparseGrad};
use io_colmap::{MaskSet, Scene as Photos};
use neus_render::march::{Grids, MarchConfig};
use scene_decomp::{FrozenSurface, Scene, Sharpness, Surface};
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::view::load_views;
use sos_train::prepare::{Prepared, prepare};
use sos_train::run_folder::{Existing, RunFolder};
use sos_train::train::Trainer;
use sos_train::train::batch::BatchMarcher;
use sos_train::train::grids::FieldGrids;
use sos_train::train::sampler::Sampler;
use sos_train::train::schedule;
use sos_train::train::setup::scene_config;
use sos_train::train::step::{Known, StepContext, loss};

use crate::support::{GRADIENT, Random, VALUE, assert_close, gpu, numbers, tensor, under_test};

/// Late in a run, when all losses count.
const STEP: u32 = 50;
const RAYS: usize = 48;

pub(crate) fn config(device: &str) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.steps = 60;
    for setting in [
        "model.levels=6",
        "model.log2_table_size=12",
        "sampling.target_samples=2048",
        "sampling.rays=64",
        "sampling.object_steps=64",
        "sampling.occupancy_resolution=32",
        "schedule.warmup_steps=4",
    ] {
        config.apply_override(setting).unwrap();
    }
    config.device = device.to_owned();
    config.validate().unwrap();
    config
}

/// With as many rays in every batch: a GPU's are drawn steps before, when it has followed its budget less far.
fn fixed_rays(device: &str) -> TrainConfig {
    let mut config = config(device);
    config.apply_override("sampling.most_rays=64").unwrap();
    config
}

pub(crate) fn prepared(folder: &Path, config: &TrainConfig) -> Prepared {
    let dir = folder.join("scene");
    demo_scene::generate(&DemoConfig::tiny())
        .write(&dir)
        .unwrap();
    let photos = Photos::open(&dir).unwrap();
    let masks = MaskSet::find(&dir.join("coarse_masks"), &photos, None).unwrap();
    let views = load_views(&photos, Some(&masks)).unwrap();
    let (points, band) = (&photos.model.points, config.loss.ignore_band);
    prepare(views, points, &config.prepare, band).unwrap()
}

/// A field in the midst of training: its table has entries `spread` times those it begins with, and its first
/// layer, which begins blind to the table, looks at it.
fn as_if_trained(surface: &mut Surface, spread: f32) {
    surface
        .grid
        .update_table(|values| values.iter_mut().for_each(|value| *value *= spread));
    let layer = &mut surface.sdf[0];
    let shape = layer.weight.val().dims();
    layer.weight = layer.weight.clone().map(|weight| {
        let change: Vec<f32> = Random(4).list(shape[0] * shape[1]);
        let change = tensor(&change, shape, &weight.device()) * 0.2;
        (weight.detach() + change).detach().require_grad()
    });
}

/// Entries as large as training makes them, as a multiple of those that a table begins with.
const SPREAD: f32 = 300.0;

/// The losses of one step and the gradients of all parameters, by name; `spread` is that of
/// [`as_if_trained`].
fn step(
    data: &Prepared,
    config: &TrainConfig,
    device: &Device,
    spread: f32,
) -> Vec<(&'static str, Vec<f64>)> {
    let device = device.clone().autodiff();
    let sizes = scene_config(config, data);
    let layouts = [&sizes.object_grid, &sizes.background_grid];
    let [object_layout, background_layout] = layouts.map(|grid| Arc::new(GridLayout::new(grid)));
    let mut scene = Scene::new(&sizes, config.seed, &device);
    as_if_trained(&mut scene.object, spread);
    as_if_trained(&mut scene.background, spread);
    scene.object.grid.table = scene.object.grid.table.set_require_grad(false);
    scene.background.grid.table = scene.background.grid.table.set_require_grad(false);
    let sharpness = Sharpness::new(sizes.sharpness_start, &device);
    let context = StepContext {
        config: config.clone(),
        object_gradient: SparseGrad::new(&object_layout),
        background_gradient: SparseGrad::new(&background_layout),
        object_layout,
        background_layout,
        device,
        points: data.points.clone(),
    };
    let batch = Sampler::new(data, config.seed, 0.5).draw(data, STEP, RAYS);
    let crop = config.prepare.crop_threshold;
    let grids = FieldGrids::new(32, &data.map, crop);
    let mut marcher = BatchMarcher::default();
    let marched = marcher.march(
        &batch.rays,
        Grids {
            object: Some(&grids.object),
            background: Some(&grids.background),
        },
        &MarchConfig {
            step_object: 2.0 / 64.0,
            background_samples: 16,
            ..MarchConfig::default()
        },
        grids.partition(&data.map, true),
    );
    let mut marched = marched.samples();
    marched.background.look_up(&data.map);
    assert!(!marched.object.is_empty() && !marched.background.is_empty());
    let schedule = schedule::at(config, STEP, context.object_layout.levels.len());
    let (total, losses) = loss(
        &context,
        &scene,
        &sharpness,
        &batch,
        &marched,
        Known {
            spread: None,
            box_background: &[],
            mask_trust: &vec![1.0; batch.rays.len()],
        },
        schedule,
    )
    .unwrap();
    let losses = losses.read();
    let grads = total.backward();
    let wide = |values: Vec<f32>| values.into_iter().map(f64::from).collect();
    let mut out = vec![
        ("total loss", vec![f64::from(losses.total)]),
        ("colour loss", vec![f64::from(losses.colour)]),
        ("mask loss", vec![f64::from(losses.mask)]),
        ("Eikonal loss", vec![f64::from(losses.eikonal)]),
        (
            "sharpness",
            numbers(sharpness.s.val().grad(&grads).unwrap()),
        ),
        ("object table", wide(context.object_gradient.to_dense())),
        (
            "background table",
            wide(context.background_gradient.to_dense()),
        ),
    ];
    for (weight, bias, surface) in [
        ("object weights", "object biases", &scene.object),
        ("background weights", "background biases", &scene.background),
    ] {
        for layer in surface.sdf.iter().chain(&surface.colour) {
            out.push((weight, numbers(layer.weight.val().grad(&grads).unwrap())));
            out.push((bias, numbers(layer.bias.val().grad(&grads).unwrap())));
        }
    }
    out
}

#[test]
fn losses_and_gradients_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let config = config("cpu");
    let data = prepared(folder.path(), &config);
    let found = step(&data, &config, &gpu, SPREAD);
    let expected = step(&data, &config, &Device::flex(), SPREAD);
    for (name, values) in &expected {
        assert!(values.iter().any(|value| *value != 0.0), "{name}");
    }
    compare(&found, &expected, VALUE, GRADIENT);
}

fn compare(
    found: &[(&str, Vec<f64>)],
    expected: &[(&str, Vec<f64>)],
    of_losses: f64,
    of_gradients: f64,
) {
    for (i, ((name, found), (_, expected))) in found.iter().zip(expected).enumerate() {
        let tolerance = if name.ends_with("loss") {
            of_losses
        } else {
            of_gradients
        };
        assert_close(&format!("{name} ({i})"), found, expected, tolerance);
    }
}

/// The CPU's step has tables as they are: binary16 rounds an entry by up to 1/2048 of it.
#[test]
fn a_step_with_halved_tables_is_close_to_that_of_the_cpu() {
    let Some(gpu) = gpu() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let mut config = config("cpu");
    let data = prepared(folder.path(), &config);
    let expected = step(&data, &config, &Device::flex(), SPREAD);
    let [(_, with), (_, without)] = [&expected[0], &step(&data, &config, &Device::flex(), 1.0)[0]];
    assert!((with[0] / without[0] - 1.0).abs() > 0.01, "tables count");
    config.apply_override("model.table_reads=half").unwrap();
    let found = step(&data, &config, &gpu, SPREAD);
    compare(&found, &expected, 1e-3, 1e-2);
}

#[test]
fn a_run_trains_on_the_gpu_and_its_checkpoint_goes_on_elsewhere() {
    let Some(gpu) = under_test() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (there, here) = [gpu.option, "cpu"].map(fixed_rays).into();
    let data = prepared(folder.path(), &there);
    let mut on_gpu = Trainer::new(&there, &data).unwrap();
    let mut on_cpu = Trainer::new(&here, &data).unwrap();
    // Beyond carving, where the object's field begins.
    let last = schedule::carve_step(&there) + 4;
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    while on_gpu.step_number() < last {
        on_gpu.step(&data);
        let (a, b) = (on_gpu.settle(), on_cpu.step(&data).losses);
        assert!(a.is_finite() && b.is_finite());
        found.push(f64::from(a.mse));
        expected.push(f64::from(b.mse));
    }
    // Adam's first steps move every weight by the learning rate, also where rounding decides the sign of
    // its gradient: the first loss is the same, and then the two runs part slowly.
    assert_close("mse", &found[..1], &expected[..1], VALUE);
    assert_close("mse", &found[..4], &expected[..4], 1e-2);
    assert_close("mse", &found, &expected, 0.2);

    let run = RunFolder::create(&folder.path().join("run"), Existing::Keep).unwrap();
    on_gpu.save(&run, 1.0).unwrap();
    on_cpu.load(&run).unwrap();
    let mut back = Trainer::new(&there, &data).unwrap();
    back.load(&run).unwrap();
    let points: Vec<f32> = (0..300).map(|i| (i as f32 * 0.37).sin()).collect();
    let wide = |values: Vec<f32>| -> Vec<f64> { values.into_iter().map(f64::from).collect() };
    let of = |trainer: &Trainer| wide(trainer.freeze_object(6).geometry(&points).values);
    assert_close("moved", &of(&on_cpu), &of(&on_gpu), VALUE);
    assert_close("came back", &of(&back), &of(&on_gpu), VALUE);
    // Not `on_gpu`, which looks ahead with older fields than the checkpoint's.
    let (a, b) = (back.step(&data), on_cpu.step(&data));
    let mse = |losses: f32| [f64::from(losses)];
    assert_close("next", &mse(b.losses.mse), &mse(a.losses.mse), 1e-3);
}

/// What is fetched from a GPU by another thread may be read long after this one has trained on.
#[test]
fn a_copy_on_the_cpu_is_of_the_fields_as_they_were() {
    let Some(gpu) = under_test() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let config = config(gpu.option);
    let data = prepared(folder.path(), &config);
    let mut trainer = Trainer::new(&config, &data).unwrap();
    trainer.step(&data);
    let points: Vec<f32> = (0..300).map(|i| (i as f32 * 0.37).sin()).collect();
    let of = |field: &FrozenSurface| -> Vec<f64> {
        let values = field.geometry(&points).values;
        values.into_iter().map(f64::from).collect()
    };
    let field = trainer.freeze_background(6);
    let before = of(&field);
    let (go, wait) = std::sync::mpsc::channel();
    let fetch = std::thread::spawn(move || {
        let copy = field.to_device(&Device::flex());
        // Nobody has looked at its values yet.
        wait.recv().unwrap();
        copy
    });
    for _ in 0..4 {
        trainer.step(&data);
    }
    let after = of(&trainer.freeze_background(6));
    assert!(before.iter().zip(&after).any(|(a, b)| (a - b).abs() > 1e-3));
    go.send(()).unwrap();
    assert_close("copy", &of(&fetch.join().unwrap()), &before, VALUE);
}
