//! The object's surface inside the page: made small, turned upright, packed.
//!
//! The packed mesh is little-endian and goes into the page as base64:
//!
//! | bytes | what |
//! |---|---|
//! | 6 per vertex | position, `u16` each: 0..65535 across the box between `low` and `high` |
//! | 3 per vertex | unit normal, `i8` each |
//! | 3 per vertex | colour, sRGB, `u8` each |
//! | 6 per triangle | three vertices, `u16` each |
//!
//! Everything is in the frame in which the viewer shows it: the middle of the box at the origin, y up as
//! the cameras have it, z towards the first camera, the farthest vertex at distance 1.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3, Vec3};
use io_colmap::View;
use ply_mesh::Mesh;
use std::collections::HashMap;

/// Most vertices in the page: about a megabyte, and their numbers fit 16 bits.
const MOST_VERTICES: usize = 40_000;
/// Halvings until the finest grid that keeps to [`MOST_VERTICES`] is known well enough.
const SEARCH_STEPS: usize = 12;

/// A mesh ready for the page.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PackedMesh {
    pub(super) vertices: usize,
    pub(super) triangles: usize,
    /// Corners of the box of positions.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    pub(super) base64: String,
}

/// Makes a mesh small enough for a page and packs it; `None` if nothing is left of it.
pub(super) fn packed(mesh: &Mesh, views: &[View]) -> Option<PackedMesh> {
    let mesh = upright(mesh, views);
    let mesh = if mesh.positions.len() > MOST_VERTICES {
        simplified(&mesh)
    } else {
        mesh
    };
    if mesh.triangles.is_empty() {
        return None;
    }
    let (low, high) = mesh.bounds();
    let size = (high - low).max(DVec3::splat(1e-9));
    let mut bytes = Vec::with_capacity(12 * mesh.positions.len() + 6 * mesh.triangles.len());
    for position in &mesh.positions {
        let share = (*position - low) / size;
        for value in share.to_array() {
            bytes.extend(((65535.0 * value).round() as u16).to_le_bytes());
        }
    }
    for normal in &mesh.normals {
        bytes.extend(normal.to_array().map(|n| (127.0 * n).round() as i8 as u8));
    }
    bytes.extend(mesh.colours.iter().flatten());
    for corner in mesh.triangles.iter().flatten() {
        bytes.extend((*corner as u16).to_le_bytes());
    }
    Some(PackedMesh {
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        low: low.as_vec3(),
        high: high.as_vec3(),
        base64: STANDARD.encode(bytes),
    })
}

/// The mesh in the viewer's frame.
fn upright(mesh: &Mesh, views: &[View]) -> Mesh {
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    // Cameras have y down. Their mean is the photographer's idea of it.
    let mean: DVec3 = views
        .iter()
        .map(|view| view.camera_from_world.inverse().transform_vector(-DVec3::Y))
        .sum();
    let up = mean.normalize_or(DVec3::Y);
    let first = views
        .first()
        .map_or(DVec3::Z, |view| view.camera_from_world.centre() - middle);
    let towards = first.reject_from_normalized(up);
    let towards = towards.normalize_or(up.any_orthonormal_vector());
    let turn = DMat3::from_cols(up.cross(towards), up, towards).transpose();
    let farthest = mesh
        .positions
        .iter()
        .map(|position| position.distance(middle))
        .fold(0.0, f64::max);
    let scale = 1.0 / farthest.max(1e-12);
    Mesh {
        positions: mesh
            .positions
            .iter()
            .map(|position| turn * (*position - middle) * scale)
            .collect(),
        normals: mesh
            .normals
            .iter()
            .map(|normal| (turn * normal.as_dvec3()).as_vec3())
            .collect(),
        colours: mesh.colours.clone(),
        triangles: mesh.triangles.clone(),
    }
}

/// Merges vertices that share a cell of the finest grid that leaves no more than [`MOST_VERTICES`].
fn simplified(mesh: &Mesh) -> Mesh {
    let (low, high) = mesh.bounds();
    let extent = (high - low).max_element().max(1e-12);
    // Cells along the longest side; a surface with n cells across has no more than a few n² of them.
    let (mut coarse, mut fine) = (1.0, (mesh.positions.len() as f64).sqrt() * 4.0);
    for _ in 0..SEARCH_STEPS {
        let cells = 0.5 * (coarse + fine);
        if cells_of(mesh, low, extent / cells).1 <= MOST_VERTICES {
            coarse = cells;
        } else {
            fine = cells;
        }
    }
    let (cell_of, count) = cells_of(mesh, low, extent / coarse);
    merged(mesh, &cell_of, count)
}

/// The number of each vertex's cell, in order of appearance, and how many cells there are.
fn cells_of(mesh: &Mesh, low: DVec3, size: f64) -> (Vec<u32>, usize) {
    let mut known: HashMap<[i32; 3], u32> = HashMap::new();
    let cells = mesh
        .positions
        .iter()
        .map(|position| {
            let cell = ((*position - low) / size).floor().as_ivec3().to_array();
            let next = known.len() as u32;
            *known.entry(cell).or_insert(next)
        })
        .collect();
    (cells, known.len())
}

/// One vertex per cell, the mean of those in it; triangles that lost a corner go, as do doubles.
fn merged(mesh: &Mesh, cell_of: &[u32], count: usize) -> Mesh {
    let mut positions = vec![DVec3::ZERO; count];
    let mut normals = vec![Vec3::ZERO; count];
    let mut colours = vec![[0u32; 3]; count];
    let mut members = vec![0u32; count];
    for (i, &cell) in cell_of.iter().enumerate() {
        let cell = cell as usize;
        positions[cell] += mesh.positions[i];
        normals[cell] += mesh.normals[i];
        for (sum, value) in colours[cell].iter_mut().zip(mesh.colours[i]) {
            *sum += u32::from(value);
        }
        members[cell] += 1;
    }
    let mut triangles: Vec<[u32; 3]> = mesh
        .triangles
        .iter()
        .map(|corners| corners.map(|i| cell_of[i as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .map(|[a, b, c]| {
            // The smallest first; the order around stays.
            let least = a.min(b).min(c);
            match least {
                l if l == a => [a, b, c],
                l if l == b => [b, c, a],
                _ => [c, a, b],
            }
        })
        .collect();
    triangles.sort_unstable();
    triangles.dedup();
    Mesh {
        positions: positions
            .iter()
            .zip(&members)
            .map(|(sum, n)| *sum / f64::from(*n))
            .collect(),
        normals: normals.iter().map(|n| n.normalize_or(Vec3::Y)).collect(),
        colours: colours
            .iter()
            .zip(&members)
            .map(|(sum, n)| sum.map(|value| (value / n) as u8))
            .collect(),
        triangles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use io_colmap::Pose;

    /// A ball of radius 2 around (5, 0, 0), `n` by `2 n` vertices.
    fn ball(n: usize) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..n {
            for j in 0..2 * n {
                let (polar, around) = (
                    std::f64::consts::PI * (i as f64 + 0.5) / n as f64,
                    std::f64::consts::PI * j as f64 / n as f64,
                );
                let normal = DVec3::new(
                    polar.sin() * around.cos(),
                    polar.cos(),
                    polar.sin() * around.sin(),
                );
                mesh.positions
                    .push(2.0 * normal + DVec3::new(5.0, 0.0, 0.0));
                mesh.normals.push(normal.as_vec3());
                mesh.colours.push([10, 200, (i % 2) as u8 * 2 + 99]);
                if i + 1 < n {
                    let at = |i: usize, j: usize| (i * 2 * n + j % (2 * n)) as u32;
                    mesh.triangles
                        .push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                    mesh.triangles
                        .push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
        mesh
    }

    fn views() -> Vec<View> {
        vec![View {
            id: 1,
            name: "a.jpg".to_owned(),
            camera_id: 1,
            camera_from_world: Pose {
                rotation: DQuat::IDENTITY,
                translation: DVec3::new(-5.0, 0.0, 9.0),
            },
        }]
    }

    #[test]
    fn a_small_mesh_is_packed_as_it_is() {
        let mesh = ball(8);
        let packed = packed(&mesh, &views()).expect("a mesh");
        assert_eq!((packed.vertices, packed.triangles), (128, 224));
        let bytes = STANDARD.decode(packed.base64).expect("base64");
        assert_eq!(bytes.len(), 12 * 128 + 6 * 224);
        assert!(packed.high.length() < 2.0 && packed.low.x < -0.9);
        // The camera's y, which is the world's here, points down: the ball's top is its bottom.
        let y = u16::from_le_bytes([bytes[2], bytes[3]]);
        assert_eq!(y, 0);
    }

    #[test]
    fn a_large_mesh_is_merged_to_the_limit() {
        let mesh = ball(200);
        assert!(mesh.positions.len() > MOST_VERTICES);
        let small = simplified(&mesh);
        let count = small.positions.len();
        assert!(
            (MOST_VERTICES / 2..=MOST_VERTICES).contains(&count),
            "{count}"
        );
        assert!(small.triangles.len() > count);
        for (position, normal) in small.positions.iter().zip(&small.normals) {
            let out = *position - DVec3::new(5.0, 0.0, 0.0);
            assert!((out.length() - 2.0).abs() < 0.05);
            assert!(out.normalize().dot(normal.as_dvec3()) > 0.95);
        }
        assert!(small.colours.iter().all(|c| (99..=101).contains(&c[2])));
    }

    #[test]
    fn nothing_is_packed_as_nothing() {
        assert_eq!(packed(&Mesh::default(), &[]), None);
    }
}
