//! Depths of many views fused into one truncated signed distance (Curless and Levoy 1996).

use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use super::depth::DepthPicture;
use crate::prepare::Prepared;

/// Voxels over which distances are told apart.
const TRUNCATION_VOXELS: f32 = 4.0;
/// What a view counts that has a voxel behind its surface: thin parts must not be thickened by the
/// views from the other side.
const BEHIND_WEIGHT: f32 = 0.25;

/// Fuses `depths` of all views on the voxels of the cube `[-1, 1]^3`, x fastest: positive outside.
///
/// A voxel that no view sees before or just behind a surface is inside. Only voxels where `map`
/// reaches `threshold` are asked for; the others are outside.
#[must_use]
pub fn fuse(
    data: &Prepared,
    depths: &[DepthPicture],
    map: &ProbabilityMap,
    threshold: f32,
) -> Vec<f32> {
    let resolution = map.resolution();
    let truncation = TRUNCATION_VOXELS * 2.0 / resolution as f32;
    let origins: Vec<glam::Vec3> = data
        .views
        .iter()
        .map(|view| view.world_from_camera(&data.frame).translation.into())
        .collect();
    map.values()
        .par_iter()
        .enumerate()
        .map(|(cell, m)| {
            if *m < threshold {
                return truncation;
            }
            let point = ProbabilityMap::centre(resolution, cell);
            let world = data.frame.world_from_normalised(point);
            let (mut sum, mut weight) = (0.0, 0.0);
            for ((view, depth), origin) in data.views.iter().zip(depths).zip(&origins) {
                let Some((pixel, _)) = view.project(world) else {
                    continue;
                };
                let before = depth.at(pixel) - point.distance(*origin);
                if before.is_nan() || before < -truncation {
                    continue;
                }
                let w = if before < 0.0 { BEHIND_WEIGHT } else { 1.0 };
                sum += w * before.min(truncation);
                weight += w;
            }
            if weight > 0.0 {
                sum / weight
            } else {
                -truncation
            }
        })
        .collect()
}
