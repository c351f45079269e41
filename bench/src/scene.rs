//! The demo scene, prepared for training.

use anyhow::Result;
use demo_scene::DemoConfig;
use io_colmap::{MaskSet, Scene};
use sos_train::config::TrainConfig;
use sos_train::prepare::view::load_views;
use sos_train::prepare::{Prepared, prepare};

/// Renders the demo scene of this size into a folder that is gone afterwards, and prepares it.
pub(crate) fn prepared(demo: &DemoConfig, config: &TrainConfig) -> Result<Prepared> {
    let folder = tempfile::tempdir()?;
    demo_scene::generate(demo).write(folder.path())?;
    let scene = Scene::open(folder.path())?;
    let masks = MaskSet::find(&folder.path().join("coarse_masks"), &scene, None)?;
    let views = load_views(&scene, Some(&masks))?;
    Ok(prepare(
        views,
        &scene.model.points,
        &config.prepare,
        config.loss.ignore_band,
    )?)
}
