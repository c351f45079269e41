//! Where cameras have come to be in a run that refined them.

use draft_folder::Draft;
use io_colmap::Model;

use super::ExportError;
use crate::prepare::TrainView;
use crate::run_folder::{RunError, RunFolder};

/// Writes `cameras/`: `model` without its points, which were not moved along, and with the poses of the views that were
/// `moved`. Where none were, a folder that is there is an earlier end's of this run, and goes.
///
/// # Errors
/// When a file cannot be written.
pub fn write_cameras(
    run: &RunFolder,
    model: &Model,
    moved: Option<&[TrainView]>,
) -> Result<(), ExportError> {
    let Some(views) = moved else {
        return Ok(run.forget_cameras()?);
    };
    let mut model = Model {
        points: Vec::new(),
        ..model.clone()
    };
    for (view, moved) in model.views.iter_mut().zip(views) {
        view.camera_from_world = moved.camera_from_world;
    }
    let draft = Draft::beside(&run.cameras_dir()).map_err(RunError::from)?;
    model.write_binary(draft.path())?;
    Ok(draft.replace().map_err(RunError::from)?)
}
