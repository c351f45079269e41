//! `mesh.ply`.

use super::ExportError;
use crate::run_folder::RunFolder;
use ply_mesh::Mesh;

/// What the file says of itself.
const COMMENTS: [&str; 2] = [
    concat!("made by sos ", env!("CARGO_PKG_VERSION")),
    "colours are sRGB, coordinates those of the camera poses",
];

/// Writes `mesh.ply`: the object's surface in the scene's own frame, as [`Mesh::write`] does.
///
/// # Errors
/// [`ExportError::Run`].
///
/// # Panics
/// Where [`Mesh::write`] does.
pub fn write_mesh(run: &RunFolder, mesh: &Mesh) -> Result<(), ExportError> {
    Ok(run.write(&run.mesh_path(), |out| mesh.write(out, &COMMENTS))?)
}
