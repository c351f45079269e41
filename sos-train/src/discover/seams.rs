//! Where the object ends on a surface that it shares with what it touches: the ground at its foot, a thing beside it.
//!
//! Parts end at planes and watersheds, which are where they are to within some voxels. Near there what parts say counts for
//! little: labels [spread](super::spread) from what is sure, and end where colours change and surfaces crease.

use glam::Vec3;
use scene_decomp::probability::ProbabilityMap;

use super::judge::Saying;
use super::look::Look;
use super::part_set::{PartSet, voxel};
use super::spread::spread;
use crate::distance::signed_distance;
use crate::train::carve::fusion::seen_surface;

/// Voxels on both sides of a part's end that may be the other's.
const UNSURE: f32 = 12.0;
/// The same above the ground, which a plane tells better: what stands higher is no ground, whatever its colour.
const UNSURE_ABOVE_GROUND: f32 = 5.0;
/// How much what parts say counts there, over what it counts elsewhere. At nothing, an object that nowhere is farther from its
/// end would be lost.
const GUESS: f32 = 1e-3;
/// How badly creases conduct: worse than where what is known is far away, and creases of the object's own lie between.
const CREASES: f32 = 12.0;

/// The object of a look with its ends where colours and creases have them.
pub(super) fn settled(look: &Look) -> Option<PartSet> {
    let n = look.data.map.resolution();
    let on_surface = seen_surface(&look.learnt);
    let surface = |is_wanted: &dyn Fn(usize) -> bool| -> Vec<bool> {
        let cells = look.learnt.iter().enumerate();
        cells
            .map(|(cell, distance)| on_surface(*distance) && is_wanted(cell))
            .collect()
    };
    let away_from = |is_wanted: &dyn Fn(usize) -> bool| {
        signed_distance(&surface(is_wanted), &[n; 3], UNSURE as usize + 1)
    };
    let is_object = |cell: usize| look.chosen.holds(cell);
    let is_ground =
        |cell: usize| !is_object(cell) && look.is_ground(ProbabilityMap::centre(n, cell));
    let from_object = away_from(&is_object);
    let from_ground = away_from(&is_ground);
    let from_things = away_from(&|cell| !is_object(cell) && !is_ground(cell));
    let said = |point: Vec3| {
        let Some(cell) = voxel(point, n) else {
            return Saying::default();
        };
        let is_object = is_object(cell);
        let is_sure = if is_object {
            from_things[cell] > UNSURE && from_ground[cell] > UNSURE_ABOVE_GROUND
        } else {
            from_object[cell] > UNSURE
        };
        let counts = if is_sure { 1.0 } else { GUESS };
        let count_of = |holds: bool| if holds { counts } else { 0.0 };
        Saying {
            inside: count_of(is_object),
            outside: count_of(!is_object),
            aside: false,
        }
    };
    spread(&look.data, &look.depths, &look.learnt, CREASES, said)
}
