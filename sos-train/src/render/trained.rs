//! A run's scene as its checkpoint has it, to draw what the run itself did not.

use super::rays::FrozenScene;
use crate::prepare::view::load_views;
use crate::prepare::{Prepared, prepare};
use crate::report::ReportInputs;
use crate::run_folder::{RunError, RunFolder};
use crate::train::Trainer;

/// Reads a run's last checkpoint, and the photos and masks that it was trained on, which determine the
/// frame it lives in.
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
    let mut data = prepare(
        load_views(&inputs.scene, inputs.masks.as_ref())?,
        &inputs.scene.model.points,
        &config.prepare,
        config.loss.ignore_band,
    )?;
    let mut trainer = Trainer::new(&config, &data)?;
    trainer.load(run)?;
    // In pixels of the size that was trained on.
    let factor = config.prepare.downscale.max(1) as f32;
    let shifts: Vec<f32> = trainer.mask_shifts().iter().map(|s| factor * s).collect();
    data.shift_masks(&shifts, &config.prepare, config.loss.ignore_band);
    Ok((trainer.freeze(), data))
}
