//! Cameras for tools that know pinholes only, and photos of one size.

use crate::error::ExportError;
use crate::run::Posed;
use io_colmap::{CameraModel, Scene};

/// What to do about a lens that a tool does not know.
pub(crate) const UNDISTORT: &str =
    "undistort the scene with colmap image_undistorter and train on that";

/// Refuses distorted photos, and photos of different sizes.
pub(crate) fn check(tool: &str, scene: &Scene, posed: &[Posed<'_>]) -> Result<(), ExportError> {
    let size = |posed: &Posed<'_>| (posed.camera.width, posed.camera.height);
    for one in posed {
        let path = scene.image_path(one.view);
        if !matches!(
            one.camera.model,
            CameraModel::SimplePinhole | CameraModel::Pinhole
        ) {
            let what = format!(
                "{tool} knows pinhole cameras only, and this one is {}",
                one.camera.model
            );
            return Err(ExportError::bad(&path, what, UNDISTORT));
        }
        if size(one) != size(&posed[0]) {
            let what = format!(
                "{tool} needs photos of one size, and this is {}x{} but the first {}x{}",
                size(one).0,
                size(one).1,
                size(&posed[0]).0,
                size(&posed[0]).1
            );
            return Err(ExportError::bad(
                &path,
                what,
                "scale the photos to one size",
            ));
        }
    }
    Ok(())
}
