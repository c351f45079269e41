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
/// Voxels before and behind a surface within which it is the surface of a voxel, and from how many on before it a view
/// sees past that voxel.
const BEFORE_SURFACE: f32 = 0.3;
const BEHIND_SURFACE: f32 = 1.5;
const PAST: f32 = 1.0;
/// Share of the views that see a voxel's surface or past it that must see its surface for it to be solid, and how many there
/// must be.
const THIN_SHARE: f32 = 0.5;
const THIN_VIEWS: usize = 3;
/// How far inside, in voxels, what is solid by these alone is taken to be.
const THIN_DEPTH: f32 = 0.25;

/// Fuses `depths` of all views on the voxels of the cube `[-1, 1]^3`, x fastest: positive outside.
///
/// A voxel that no view sees before or just behind a surface is inside, unless the nearest surface that hides it is more
/// than `deepest` before it: seen from one side, what a thing hides has no end. Only voxels where `map` reaches
/// `threshold` are asked for; the others are outside.
#[must_use]
pub fn fuse(
    data: &Prepared,
    depths: &[DepthPicture],
    map: &ProbabilityMap,
    threshold: f32,
    deepest: f32,
) -> Vec<f32> {
    let resolution = map.resolution();
    let truncation = TRUNCATION_VOXELS * 2.0 / resolution as f32;
    let origins: Vec<glam::Vec3> = data
        .views
        .iter()
        .map(|view| view.camera_centre(&data.frame))
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
            let seen = data.views.iter().zip(depths).zip(&origins);
            let before = seen.filter_map(|((view, depth), origin)| {
                let (pixel, _) = view.project(world)?;
                let before = depth.at(pixel) - point.distance(*origin);
                (!before.is_nan()).then_some(before)
            });
            fused(before, truncation, deepest)
        })
        .collect()
}

/// Tells of the distances `fused` which are of surfaces that views saw, rather than before these or of what nobody saw.
pub(crate) fn seen_surface(fused: &[f32]) -> impl Fn(f32) -> bool + use<> {
    let unseen = fused.iter().copied().fold(0.0, f32::min);
    move |distance| distance < 0.0 && distance > 0.999 * unseen
}

/// The distance of one voxel, from how far `before` each view's surface it is.
fn fused(before: impl Iterator<Item = f32>, truncation: f32, deepest: f32) -> f32 {
    let voxel = truncation / TRUNCATION_VOXELS;
    let (mut sum, mut weight) = (0.0, 0.0);
    let (mut at_surface, mut past) = (0, 0);
    let mut hidden = None::<f32>;
    for before in before {
        if before < -truncation {
            hidden = Some(hidden.map_or(-before, |least| least.min(-before)));
            continue;
        }
        let w = if before < 0.0 { BEHIND_WEIGHT } else { 1.0 };
        sum += w * before.min(truncation);
        weight += w;
        if (-BEHIND_SURFACE * voxel..=BEFORE_SURFACE * voxel).contains(&before) {
            at_surface += 1;
        } else if before > PAST * voxel {
            past += 1;
        }
    }
    // What is no thicker than a voxel has views past its edges on all sides, each of which tells of a truncation's
    // distance where those that meet it tell of a voxel's: a mean would take it away.
    let is_thin =
        at_surface >= THIN_VIEWS && at_surface as f32 >= THIN_SHARE * (at_surface + past) as f32;
    if is_thin && sum > 0.0 {
        -THIN_DEPTH * voxel
    } else if weight > 0.0 {
        sum / weight
    } else if hidden.is_some_and(|least| least > deepest) {
        truncation
    } else {
        -truncation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(before: &[f32]) -> f32 {
        fused(before.iter().copied(), 0.1, 1.0)
    }

    #[test]
    fn who_sees_a_voxel_says_where_it_is() {
        assert_eq!(of(&[0.05]), 0.05);
        // No farther than the truncation, and less by whom it is hidden from.
        assert!((of(&[0.7, -0.1]) - 0.075 / 1.25).abs() < 1e-6);
        assert!((of(&[0.05, -0.5]) - 0.05).abs() < 1e-6);
    }

    #[test]
    fn what_half_of_the_views_meet_is_solid_however_far_the_others_see_past_it() {
        // Voxels are 0.025 wide.
        let met = [-0.02, -0.01, 0.005];
        let with = |past: &[f32]| of(&[&met[..], past].concat());
        assert!(with(&[0.9, 0.9, 0.9]) < 0.0);
        assert!(with(&[0.9; 4]) > 0.0);
        // Two views may err alike.
        assert!(of(&[-0.02, -0.01, 0.9]) > 0.0);
        // Where all agree, a surface is where they say, and a voxel before it is none of it.
        assert!((of(&[0.02; 6]) - 0.02).abs() < 1e-6);
    }

    #[test]
    fn what_nobody_sees_is_inside_but_not_without_end() {
        assert_eq!(of(&[]), -0.1);
        assert_eq!(of(&[-0.9, -3.0]), -0.1);
        assert_eq!(of(&[-1.1, -3.0]), 0.1);
    }
}
