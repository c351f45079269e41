//! The object's surface as a mesh in the scene's own frame.

use glam::Vec3;
use neus_render::field::SdfBatch;
use neus_render::intersect::Aabb;
use neus_render::isosurface::{
    Border, IsosurfaceConfig, IsosurfaceError, Measure, extract_isosurface,
};

use super::rays::FrozenScene;
use crate::export::WorldMesh;
use crate::prepare::Frame;

/// Parts with less than this share of the surface's area are crumbs.
const SMALLEST_PART: f64 = 0.02;
/// Distance reported where m^P rules the object out.
const OUTSIDE: f32 = 0.05;

/// FoCoR's distance, limited to where the object may be: elsewhere no photo ever shaped it.
struct ObjectSdf<'a>(&'a FrozenScene);

impl SdfBatch for ObjectSdf<'_> {
    fn sdf(&self, points: &[Vec3], out: &mut [f32]) {
        let flat: Vec<f32> = points.iter().flat_map(|p| p.to_array()).collect();
        let geometry = self.0.fields.object.geometry(&flat);
        let threshold = self.0.config.prepare.crop_threshold;
        for (i, (value, point)) in out.iter_mut().zip(points).enumerate() {
            let sdf = geometry.sdf(i);
            *value = if self.0.map.at(*point) >= threshold {
                sdf
            } else {
                sdf.max(OUTSIDE)
            };
        }
    }
}

/// The surface sdf = 0 with vertex colours, at `resolution` cells across the box.
///
/// # Errors
/// When the box contains no surface.
pub fn extract(
    scene: &FrozenScene,
    frame: &Frame,
    resolution: u32,
) -> Result<WorldMesh, IsosurfaceError> {
    let config = IsosurfaceConfig {
        resolution,
        border: Border::Closed,
        ..IsosurfaceConfig::default()
    };
    let mut mesh = extract_isosurface(&ObjectSdf(scene), &Aabb::UNIT, &config)?;
    mesh.keep_large_parts(Measure::Area, SMALLEST_PART);
    let points: Vec<f32> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
    // Seen from straight above the surface.
    let directions: Vec<f32> = mesh.normals.iter().flat_map(|n| (-*n).to_array()).collect();
    let geometry = scene.fields.object.geometry(&points);
    let colours = scene
        .fields
        .object
        .colour(&geometry, &points, &directions, &[]);
    Ok(WorldMesh {
        positions: mesh
            .positions
            .iter()
            .map(|p| frame.world_from_normalised(*p).to_array())
            .collect(),
        normals: mesh.normals.iter().map(Vec3::to_array).collect(),
        colours: colours
            .chunks_exact(4)
            .map(|c| [0, 1, 2].map(|k| (255.0 * c[k].clamp(0.0, 1.0) + 0.5) as u8))
            .collect(),
        triangles: mesh.triangles,
    })
}
