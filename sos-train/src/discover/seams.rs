//! Where the object ends on a surface that it shares with what it touches: the ground at its foot, a thing beside it.
//!
//! Parts end at planes and watersheds, which are where they are to within a few voxels. Near there labels
//! [spread](super::spread) from what is sure, and end where colours change and surfaces crease.

use glam::Vec3;

use super::judge::Saying;
use super::look::Look;
use super::part_set::{PartSet, voxel};
use super::spread::spread;
use crate::distance::signed_distance;

/// Voxels on both sides of a part's end that may be the other's.
const UNSURE: f32 = 5.0;

/// The object of a look with its ends where colours and creases have them.
pub(super) fn settled(look: &Look) -> Option<PartSet> {
    let n = look.data.map.resolution();
    let unseen = look.learnt.iter().copied().fold(0.0, f32::min);
    let on_surface = |distance: f32| distance < 0.0 && distance > 0.999 * unseen;
    let surface = |of_object: bool| -> Vec<bool> {
        let cells = look.learnt.iter().enumerate();
        cells
            .map(|(cell, distance)| on_surface(*distance) && look.chosen.holds(cell) == of_object)
            .collect()
    };
    let away_from =
        |of_object: bool| signed_distance(&surface(of_object), &[n; 3], UNSURE as usize + 1);
    let (from_object, from_others) = (away_from(true), away_from(false));
    spread(&look.data, &look.depths, &look.learnt, |point: Vec3| {
        let Some(cell) = voxel(point, n) else {
            return Saying::default();
        };
        let sure = |holds: bool| f32::from(u8::from(holds));
        let is_object = look.chosen.holds(cell);
        Saying {
            inside: sure(is_object && from_others[cell] > UNSURE),
            outside: sure(
                !is_object && (from_object[cell] > UNSURE || look.solid[cell].is_infinite()),
            ),
            aside: false,
        }
    })
}
