//! Exact knowledge about the target in world coordinates: distance, bounds, surface mesh.

use std::sync::OnceLock;

use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::DVec3;
use ply_mesh::Mesh;
use rayon::prelude::*;

use crate::kind::SceneKind;
use crate::stage::{Stage, TABLE_CENTRE};
use crate::subject::Subject;

fn stage() -> &'static Stage {
    static STAGE: OnceLock<Stage> = OnceLock::new();
    STAGE.get_or_init(|| Stage::new(SceneKind::Can))
}

/// Signed distance from a world point (metres) to the watering can's surface, negative inside the
/// material: zero exactly on the surface, elsewhere at most the true distance.
///
/// ```
/// let (low, high) = demo_scene::target_bounds();
/// assert!(demo_scene::target_sdf(low) > 0.0);
/// assert!(demo_scene::target_sdf(0.5 * (low + high)).abs() < (high - low).length());
/// ```
#[must_use]
pub fn target_sdf(p: DVec3) -> f64 {
    stage().target().sdf(p - TABLE_CENTRE)
}

/// Lower and upper corner of a world-aligned box around the target, whichever it is, metres.
#[must_use]
pub fn target_bounds() -> (DVec3, DVec3) {
    let corner = |i: u32| {
        let side = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let (half, centre) = Subject::BOUNDS;
        let local = centre + half * DVec3::new(side(0), side(1), side(2));
        stage().target().place(local) + TABLE_CENTRE
    };
    (1..8).fold((corner(0), corner(0)), |(low, high), i| {
        (low.min(corner(i)), high.max(corner(i)))
    })
}

/// The target's surface, from cells of edge `cell` metres; the vertices are then moved onto the
/// surface.
pub(crate) fn mesh(stage: &Stage, cell: f64) -> Mesh {
    let target = stage.target();
    let (half, centre) = Subject::BOUNDS;
    let low = centre - half - 2.0 * cell;
    let counts = ((2.0 * half / cell).ceil() + 5.0).as_uvec3();
    let shape = RuntimeShape::<u32, 3>::new(counts.to_array());
    let at = |i: u32| low + DVec3::from(shape.delinearize(i).map(f64::from)) * cell;
    let distances: Vec<f32> = (0..shape.size())
        .into_par_iter()
        .map(|i| (target.local_sdf(at(i)) / cell) as f32)
        .collect();
    let mut buffer = SurfaceNetsBuffer::default();
    surface_nets(
        &distances,
        &shape,
        [0; 3],
        (counts - 1).to_array(),
        &mut buffer,
    );
    let positions = buffer
        .positions
        .par_iter()
        .map(|grid| {
            let mut p = target.place(low + DVec3::from(grid.map(f64::from)) * cell);
            for _ in 0..3 {
                // Bounded, because at creases the normal is not where the surface is.
                p -= target.normal(p) * target.sdf(p).clamp(-0.5 * cell, 0.5 * cell);
            }
            p + TABLE_CENTRE
        })
        .collect();
    let triangles = buffer
        .indices
        .chunks_exact(3)
        .map(|f| [f[0], f[1], f[2]])
        .collect();
    Mesh {
        positions,
        triangles,
        ..Mesh::default()
    }
    .completed()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_lies_on_the_surface_and_faces_outwards() {
        let mesh = mesh(stage(), 0.003);
        let off = mesh
            .positions
            .iter()
            .filter(|v| target_sdf(**v).abs() > 1e-4)
            .count();
        assert!(
            off * 50 < mesh.positions.len(),
            "{off} of {}",
            mesh.positions.len()
        );
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|f| {
                let [a, b, c] = f.map(|i| mesh.positions[i as usize] - TABLE_CENTRE);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!(volume > 1e-4, "{volume}");
    }

    #[test]
    fn the_target_has_holes() {
        let mesh = mesh(stage(), 0.0015);
        // A closed surface has 3 F = 2 E and V - E + F = 2 - 2 genus.
        let (v, f) = (mesh.positions.len() as i64, mesh.triangles.len() as i64);
        let euler = v - f / 2;
        assert_eq!(f % 2, 0);
        let genus = (2 - euler) / 2;
        assert!((3..=6).contains(&genus), "genus {genus}");
    }
}
