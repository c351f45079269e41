//! For tests: a tiny scene with both fields from the first step on.

#![allow(clippy::unwrap_used)]

use demo_scene::DemoConfig;
use io_colmap::{MaskSet, Scene};

use crate::config::{Preset, TrainConfig};
use crate::prepare::view::load_views;
use crate::prepare::{Prepared, prepare};

/// The first step is one at which views are looked at.
pub(super) fn config() -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    for setting in [
        "steps=9",
        "schedule.carve=0",
        "model.levels=6",
        "model.log2_table_size=12",
        "sampling.occupancy_resolution=32",
    ] {
        config.apply_override(setting).unwrap();
    }
    config
}

/// The tiny demo scene with rough masks, but for these views.
pub(super) fn prepared(config: &TrainConfig, unmasked: &[usize]) -> Prepared {
    let folder = tempfile::tempdir().unwrap();
    let scene = demo_scene::generate(&DemoConfig::tiny());
    scene.write(folder.path()).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let masks = MaskSet::find(&folder.path().join("coarse_masks"), &scene, None).unwrap();
    let mut views = load_views(&scene, Some(&masks)).unwrap();
    for &view in unmasked {
        views[view].mask = None;
    }
    let (points, band) = (&scene.model.points, config.loss.ignore_band);
    prepare(views, points, &config.prepare, band).unwrap()
}
