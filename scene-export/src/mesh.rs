//! The run's mesh, read from `mesh.ply` and checked.

use crate::error::ExportError;
use crate::run::{has_ended, resumed};
use ply_mesh::Mesh;
use std::path::Path;

/// Reads a run's mesh: the object's surface in the scene's own frame, with a normal of unit length for each vertex.
///
/// # Errors
/// [`ExportError`] if it is missing, damaged or without triangles.
pub fn mesh_of_run(root: &Path) -> Result<Mesh, ExportError> {
    let path = root.join("mesh.ply");
    let nothing_found = |what: &str| {
        let remedy = "train for longer, or with masks that show the object";
        Err(ExportError::bad(&path, what, remedy))
    };
    if !path.is_file() {
        if has_ended(root) == Some(true) {
            return Err(ExportError::bad(
                &path,
                "the run has come to its end without a mesh: it found no surface, or the file is gone",
                format!(
                    "train for longer, or with masks that show the object; one that is gone is made again by {}",
                    resumed(root)
                ),
            ));
        }
        return Err(ExportError::bad(
            &path,
            "the run has no mesh, which it writes at its end where it found a surface",
            format!("let it come to its end: {}", resumed(root)),
        ));
    }
    let damaged = |what: String| {
        let remedy = format!("make the run's results again: {}", resumed(root));
        ExportError::bad(&path, what, remedy)
    };
    let mesh = Mesh::read(&path).map_err(|error| damaged(error.reason))?;
    // What is written holds 32-bit numbers.
    let mut positions = mesh.positions.iter();
    if let Some(bad) = positions.position(|v| !v.as_vec3().is_finite()) {
        return Err(damaged(format!("vertex {bad} has no finite x, y and z")));
    }
    if mesh.triangles.is_empty() {
        return nothing_found("the mesh has no triangles: the run found no surface");
    }
    Ok(mesh.completed())
}
