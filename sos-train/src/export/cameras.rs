//! Where cameras have come to be in a run that refined them.

use crate::prepare::TrainView;
use crate::run_folder::RunFolder;
use io_colmap::{ColmapError, Model};

/// Writes `cameras/`: `model` without its points, which were not moved along, and with the poses of `views`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_cameras(
    run: &RunFolder,
    model: &Model,
    views: &[TrainView],
) -> Result<(), ColmapError> {
    let mut model = Model {
        points: Vec::new(),
        ..model.clone()
    };
    for (view, moved) in model.views.iter_mut().zip(views) {
        view.camera_from_world = moved.camera_from_world;
    }
    model.write_binary(&run.cameras_dir())
}
