//! What goes on beyond the region in which it was found, and hangs together with too much in a larger one.
//!
//! There the ground may be told less well, so that the object, what stands behind it and the table are one. What the smaller look says of
//! its region is taken over; beyond it labels spread from there as they do from masks ([`spread`](super::spread)).

use glam::Vec3;

use super::judge::Saying;
use super::look::Look;
use super::part_set::PartSet;
use super::spread::{CREASES, spread};

/// Where a region's border begins, in its frame: what lies there may be learnt badly.
const BORDER: f32 = 0.94;
/// Voxels of the smaller look by which a surface may have been learnt elsewhere in the wider one.
const APART: f32 = 2.0;
/// The share of an object that has to lie beyond a region for it to have been followed there.
const LEAST_BEYOND: f32 = 0.005;

/// The object of the look `before` as far as `wider` shows it.
pub(super) fn spread_beyond(before: &Look, wider: &Look) -> Option<PartSet> {
    let apart = APART * 2.0 / before.data.map.resolution() as f32;
    let Look {
        data,
        depths,
        learnt,
        parts,
        ..
    } = wider;
    spread(data, depths, learnt, CREASES, |point| {
        let there = seen_from(before, wider, point);
        let is_known = is_within(there);
        let sure = |holds: bool| f32::from(u8::from(holds));
        let is_object = is_known && before.chosen.contains(there);
        let is_other = before.is_ground(there)
            || parts.keeps_out(point)
            || is_known && !is_near(&before.chosen, there, apart);
        Saying {
            inside: sure(is_object),
            outside: sure(is_other && !is_object),
            aside: false,
        }
    })
}

/// Whether some of the object of `wider` lies beyond the region of `before`.
pub(super) fn lies_beyond(before: &Look, wider: &Look) -> bool {
    let points = wider.chosen.points();
    let is_outside = |point: &&Vec3| seen_from(before, wider, **point).abs().max_element() > 1.0;
    let outside = points.iter().filter(is_outside).count();
    outside as f32 > LEAST_BEYOND * points.len() as f32
}

/// A point of the frame of `wider` in that of `before`.
pub(super) fn seen_from(before: &Look, wider: &Look, point: Vec3) -> Vec3 {
    let world = wider.data.frame.world_from_normalised(point);
    before.data.frame.normalised_from_world(world)
}

/// Whether a point of a look's frame lies within its region, away from the border.
pub(super) fn is_within(point: Vec3) -> bool {
    point.abs().max_element() < BORDER
}

/// Whether a point, or one of those at a distance from it along the axes, belongs to `parts`.
fn is_near(parts: &PartSet, point: Vec3, distance: f32) -> bool {
    let ways = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let beside = |way: &Vec3| {
        let off = distance * *way;
        parts.contains(point + off) || parts.contains(point - off)
    };
    ways.iter().any(beside)
}
