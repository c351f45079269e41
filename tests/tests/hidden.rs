//! What hides the object costs, but less where a pixel is background from inside the box.
#![allow(clippy::unwrap_used)]

use demo_scene::DemoConfig;
use io_colmap::{MaskSet, Scene};
use neus_render::march::{Grids, MarchConfig};
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::view::load_views;
use sos_train::prepare::{Prepared, prepare};
use sos_train::train::Trainer;
use sos_train::train::batch::BatchMarcher;
use sos_train::train::grids::FieldGrids;
use sos_train::train::sampler::Sampler;

const RAYS: usize = 64;

fn config() -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    for setting in [
        "steps=60",
        "model.levels=6",
        "model.log2_table_size=12",
        "sampling.occupancy_resolution=32",
        "schedule.carve=0",
    ] {
        config.apply_override(setting).unwrap();
    }
    config
}

fn prepared(config: &TrainConfig) -> Prepared {
    let folder = tempfile::tempdir().unwrap();
    demo_scene::generate(&DemoConfig::tiny())
        .write(folder.path())
        .unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let masks = MaskSet::find(&folder.path().join("coarse_masks"), &scene, None).unwrap();
    let views = load_views(&scene, Some(&masks)).unwrap();
    let (points, band) = (&scene.model.points, config.loss.ignore_band);
    prepare(views, points, &config.prepare, band).unwrap()
}

/// The loss of a first step whose rays get this share of their light from the background in the box.
fn hidden(config: &TrainConfig, data: &Prepared, box_background: &[f32]) -> f32 {
    let batch = Sampler::new(data, config.seed, 0.5).draw(data, 0, RAYS);
    let grids = FieldGrids::new(32, &data.map, config.prepare.crop_threshold);
    // Not cropped: the background is before the object and inside it.
    let mut marcher = BatchMarcher::default();
    let marched = marcher.march(
        &batch.rays,
        Grids {
            object: Some(&grids.object),
            background: Some(&grids.background),
        },
        &MarchConfig::default(),
        grids.partition(&data.map, false),
    );
    let mut marched = marched.samples();
    marched.background.look_up(&data.map);
    let mut trainer = Trainer::new(config, data).unwrap();
    let schedule = trainer.schedule();
    let report = trainer.learn(&batch, &marched, None, box_background, schedule);
    report.losses.hidden
}

#[test]
fn the_loss_falls_with_the_share_of_background() {
    let config = config();
    let data = prepared(&config);
    let whole = hidden(&config, &data, &[]);
    assert!(whole > 0.0);
    assert_eq!(hidden(&config, &data, &[0.0; RAYS]), whole);
    let half = hidden(&config, &data, &[0.25; RAYS]);
    assert!((half / whole - 0.5).abs() < 1e-4, "{half} of {whole}");
    assert_eq!(hidden(&config, &data, &[0.75; RAYS]), 0.0);
}
