//! Where cameras have come to be in a run that refined them.

use std::fs;

use draft_folder::Draft;
use io_colmap::Model;

use super::ExportError;
use crate::prepare::TrainView;
use crate::run_folder::{RunError, RunFolder};

/// Writes `cameras/`: `model` without its points, which were not moved along, and with the poses of the views that were
/// `moved`. Where none were, files that are there are an earlier end's of this run, and go.
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
    // Beside it and moved file by file: what else lies there stays.
    let place = run.cameras_dir();
    let draft = Draft::beside(&place).map_err(RunError::from)?;
    model.write_binary(draft.path())?;
    fs::create_dir_all(&place).map_err(|e| RunError::io("create the folder", &place, e))?;
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = place.join(name);
        fs::rename(draft.path().join(name), &path).map_err(|e| RunError::io("write", &path, e))?;
    }
    Ok(())
}
