//! A run's scene as its checkpoint has it, to draw what the run itself did not.

use io_colmap::Scene;

use super::rays::FrozenScene;
use crate::prepare::view::{all_downscaled, find_ignored, load_ignored, load_views};
use crate::prepare::{KnownScene, MaskConsensus, Prepared, prepare_with};
use crate::report::ReportInputs;
use crate::run_folder::{RunError, RunFolder};
use crate::train::Trainer;
use crate::train::checkpoint::frame_of;

/// Reads a run's last checkpoint, and the photos and masks that it was trained on, which determine the
/// frame it lives in where the checkpoint is of a version that does not say.
///
/// # Errors
/// When there is no checkpoint, or photos or masks are gone.
pub fn load_trained(run: &RunFolder) -> anyhow::Result<(FrozenScene, Prepared)> {
    if !run.has_checkpoint() {
        return Err(RunError::NoCheckpoint {
            path: run.root().to_path_buf(),
        }
        .into());
    }
    let inputs = ReportInputs::gather(run)?;
    let mut config = inputs.config;
    // Pictures are drawn on the CPU, wherever the run was trained.
    "cpu".clone_into(&mut config.device);
    // With poses as they were given: tables have their sizes by them, and where cameras have come to be the trainer knows.
    let scene = Scene::open(&inputs.scene.root)?;
    let mut photos = load_views(&scene, inputs.masks.as_ref())?;
    if let Some(dir) = &inputs.ignore {
        load_ignored(&mut photos, &find_ignored(dir, &scene)?)?;
    }
    let (points, sizes) = (&scene.model.points, &config.prepare);
    // As the run itself did: the box is found with masks as they are, unless it found them itself, and
    // the tables have the size for photos as they were trained on.
    let given =
        photos.iter().filter(|view| view.mask.is_some()).count() > 1 && !run.has_found_masks();
    let consensus = given.then(|| MaskConsensus::of(&photos, points, sizes));
    let consensus = consensus.transpose()?;
    let (views, photos) = match sizes.downscale {
        0 | 1 => (photos, None),
        factor => (all_downscaled(photos.clone(), factor)?, Some(photos)),
    };
    let band = config.loss.ignore_band;
    let known = KnownScene {
        consensus,
        frame: frame_of(run)?,
    };
    let mut data = prepare_with(views, known, points, sizes, band)?;
    let mut trainer = Trainer::new(&config, &data)?;
    trainer.load(run)?;
    trainer.place_cameras(&mut data);
    data.correct_masks(trainer.mask_faults(), &config.prepare, band)?;
    if let Some(photos) = photos {
        // Labels are of the size that was trained on, and no longer asked for.
        data.views = photos;
        data.given_masks.clear();
        data.outlines.clear();
        trainer.place_cameras(&mut data);
    }
    Ok((trainer.freeze(), data))
}
