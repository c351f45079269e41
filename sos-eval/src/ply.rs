//! Meshes to compare, from PLY files.

use crate::EvalError;
use crate::mesh::TriangleMesh;
use glam::DVec3;
use ply_mesh::{Mesh, PlyError};
use std::path::Path;

/// Coordinates beyond this are of no object. Distances take products of four of them, which have to stay finite.
const FARTHEST: f64 = 1e30;

/// Reads vertices and triangles, as [`Mesh::read`] does; normals and colours are left out.
///
/// # Errors
/// [`EvalError::Mesh`] where that cannot be read, and for a vertex where no object is.
pub fn read_ply(path: &Path) -> Result<TriangleMesh, EvalError> {
    let mesh =
        Mesh::read(path).map_err(|PlyError { path, reason }| EvalError::Mesh { path, reason })?;
    let is_far = |v: &DVec3| v.abs().max_element() > FARTHEST;
    if let Some(bad) = mesh.positions.iter().position(is_far) {
        return Err(EvalError::Mesh {
            path: path.to_owned(),
            reason: format!("vertex {bad} lies more than {FARTHEST:e} away, where no object is"),
        });
    }
    Ok(TriangleMesh {
        vertices: mesh.positions,
        triangles: mesh.triangles,
    })
}
