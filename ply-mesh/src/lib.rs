//! Triangle meshes with normals and colours as PLY files.
//!
//! The parser underneath, `ply-rs-bw`, knows elements and properties; here they become a mesh whose numbers are
//! finite and whose triangles name vertices that exist.
//!
//! ```
//! use glam::DVec3;
//! use ply_mesh::Mesh;
//!
//! let mesh = Mesh {
//!     positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
//!     triangles: vec![[0, 1, 2]],
//!     ..Mesh::default()
//! }
//! .completed();
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("triangle.ply");
//! mesh.write(&mut std::fs::File::create(&path)?, &["a triangle"])?;
//! assert_eq!(Mesh::read(&path)?, mesh);
//! assert_eq!(mesh.normals[0], glam::Vec3::Z);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod read;
mod vertex;
mod write;

use glam::{DVec3, Vec3};
use std::path::PathBuf;

/// Below this length a normal has no direction.
const SHORT: f32 = 1e-6;

/// A surface of triangles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertices `[n_vertices, 3]`, in the file's own units.
    pub positions: Vec<DVec3>,
    /// One per vertex, outwards; zero where the file has none.
    pub normals: Vec<Vec3>,
    /// sRGB, one per vertex; white where the file has none.
    pub colours: Vec<[u8; 3]>,
    /// Indices of corners `[n_triangles, 3]`, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A file that is no mesh, or cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {reason}; write it anew as a PLY triangle mesh", .path.display())]
pub struct PlyError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, in one line.
    pub reason: String,
}

impl Mesh {
    /// The corners of the box around all vertices; infinite and reversed where there are none.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for position in &self.positions {
            low = low.min(*position);
            high = high.max(*position);
        }
        (low, high)
    }

    /// The same with a normal of unit length and a colour for every vertex: normals are those of the triangles
    /// around one where it has none, colours white.
    ///
    /// # Panics
    /// If a triangle names a vertex that does not exist.
    #[must_use]
    pub fn completed(mut self) -> Self {
        self.colours.resize(self.positions.len(), [255; 3]);
        self.normals.resize(self.positions.len(), Vec3::ZERO);
        if self.normals.iter().all(|n| n.length() > SHORT) {
            self.normals.iter_mut().for_each(|n| *n = n.normalize());
            return self;
        }
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|i| self.positions[i as usize]);
            // Its length is twice the triangle's area, by which it counts.
            let normal = (b - a).cross(c - a);
            for i in corners {
                sums[*i as usize] += normal;
            }
        }
        for (normal, sum) in self.normals.iter_mut().zip(sums) {
            *normal = if normal.length() > SHORT {
                normal.normalize()
            } else {
                // A vertex that no triangle uses gets any direction.
                sum.normalize_or(DVec3::Z).as_vec3()
            };
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_that_are_missing_come_from_the_triangles() {
        let mesh = Mesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE],
            normals: vec![Vec3::ZERO, Vec3::ZERO, Vec3::X * 3.0],
            colours: Vec::new(),
            triangles: vec![[0, 1, 2]],
        }
        .completed();
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::X, Vec3::Z]);
        assert_eq!(mesh.colours, [[255; 3]; 4]);
    }
}
