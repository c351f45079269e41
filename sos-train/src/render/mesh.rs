//! The object's surface as a mesh in the scene's own frame.

use glam::Vec3;
use neus_render::field::SdfBatch;
use neus_render::intersect::Aabb;
use neus_render::isosurface::{
    Border, IsosurfaceConfig, IsosurfaceError, Measure, extract_isosurface,
};
use ply_mesh::Mesh;

use super::rays::FrozenScene;
use crate::config::Transparency;
use crate::export::byte;
use crate::prepare::Frame;
use crate::train::semantic::logit_at;

/// Parts with less than this share of the surface's area are crumbs.
const SMALLEST_PART: f64 = 0.02;
/// Distance reported where m^P rules the object out.
const OUTSIDE: f32 = 0.05;
/// Logarithm of a density, against that of the surface, reported there.
const NOTHING: f32 = 5.0;
/// No block of cells is too far from a surface for values that are no distances.
const ANY_OVERESTIMATE: f32 = 1e9;

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

/// Where a marching step stops half of the light, and a semantic field's share is above a half. Values are
/// logarithms of densities and no distances; negative inside.
struct DensityLevel<'a>(&'a FrozenScene);

impl SdfBatch for DensityLevel<'_> {
    fn sdf(&self, points: &[Vec3], out: &mut [f32]) {
        let scene = self.0;
        let threshold = scene.config.prepare.crop_threshold;
        let step = 2.0 / scene.config.sampling.object_steps as f32;
        let level = -(std::f32::consts::LN_2 / step).ln();
        let asked: Vec<usize> = (0..points.len())
            .filter(|&i| scene.map.at(points[i]) >= threshold)
            .collect();
        let flat: Vec<f32> = asked.iter().flat_map(|&i| points[i].to_array()).collect();
        let geometry = scene.object_field().geometry(&flat);
        out.fill(NOTHING);
        for (row, i) in asked.into_iter().enumerate() {
            let density = geometry.sdf(row) - level;
            out[i] = if scene.is_semantic() {
                density.max(-logit_at(&geometry, row))
            } else {
                density
            };
        }
    }
}

/// The object's surface, sdf = 0 or a level of density, with vertex colours, at `resolution` cells across the box.
///
/// # Errors
/// When the box contains no surface.
pub fn extract(
    scene: &FrozenScene,
    frame: &Frame,
    resolution: u32,
) -> Result<Mesh, IsosurfaceError> {
    let config = IsosurfaceConfig {
        resolution,
        border: Border::Closed,
        ..IsosurfaceConfig::default()
    };
    let mut mesh = match scene.config.model.object_transparency() {
        Transparency::Sdf => extract_isosurface(&ObjectSdf(scene), &Aabb::UNIT, &config)?,
        Transparency::Density => {
            let config = IsosurfaceConfig {
                overestimate: ANY_OVERESTIMATE,
                ..config
            };
            extract_isosurface(&DensityLevel(scene), &Aabb::UNIT, &config)?
        }
    };
    mesh.keep_large_parts(Measure::Area, SMALLEST_PART);
    let points: Vec<f32> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
    // Seen from straight above the surface.
    let directions: Vec<f32> = mesh.normals.iter().flat_map(|n| (-*n).to_array()).collect();
    let field = scene.object_field();
    let geometry = field.geometry(&points);
    let colours = field.colour(&geometry, &points, &directions, &[]);
    let outputs = colours.len().checked_div(mesh.positions.len()).unwrap_or(4);
    let world = |p: &Vec3| frame.world_from_normalised(*p);
    Ok(Mesh {
        positions: mesh.positions.iter().map(world).collect(),
        normals: mesh.normals,
        colours: colours
            .chunks_exact(outputs)
            .map(|c| [0, 1, 2].map(|k| byte(c[k])))
            .collect(),
        triangles: mesh.triangles,
    })
}
