//! Which parts stand beside a thing, by themselves.
//!
//! Thin things come apart, so that small parts within the bounds of a thing belong to it. But what has its own foot on the
//! ground is a thing of its own where it stands next to the other, and a leg or a wheel where that is above it.

use std::collections::HashSet;

use scene_decomp::probability::ProbabilityMap;

use super::columns::Columns;
use super::hanging::HANGS;
use super::plane::{Plane, height_above};

/// How wide columns are, in voxels: those of the grid are not aligned with the ground, so that narrower ones have gaps.
const WIDTH: usize = 2;
/// The share of a part's voxels that have the thing above or below them from which on it does not stand beside it.
const UNDER: f32 = 0.5;

/// Whether a part stands on the `ground` beside the `thing`, by the voxels of both in a grid of `resolution^3`.
pub(super) fn stands_beside(
    part: &[usize],
    thing: &[usize],
    ground: &Plane,
    resolution: usize,
) -> bool {
    let height = height_above(ground, resolution);
    let foot = part
        .iter()
        .map(|&cell| height(cell))
        .fold(f32::INFINITY, f32::min);
    if foot > HANGS {
        return false;
    }
    let columns = Columns::new(ground, resolution.div_ceil(WIDTH));
    let column = |cell: &usize| columns.of(ProbabilityMap::centre(resolution, *cell));
    let footprint: HashSet<Option<usize>> = thing.iter().map(column).collect();
    let under = part
        .iter()
        .filter(|cell| footprint.contains(&column(cell)))
        .count();
    (under as f32) < UNDER * part.len() as f32
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::staged::labelled_boxes;
    use super::*;

    const N: usize = 40;
    const GROUND: Plane = Plane {
        normal: Vec3::Z,
        offset: -1.0,
        thickness: 0.0,
    };

    #[test]
    fn a_leg_stands_under_a_thing_and_a_neighbour_beside_it() {
        let top = [[4, 30], [4, 30], [20, 24]];
        let leg = [[6, 9], [6, 9], [0, 16]];
        let neighbour = [[28, 36], [10, 16], [0, 10]];
        let hanging = [[31, 36], [20, 24], [12, 18]];
        let boxes = [top, leg, neighbour, hanging];
        let labels = labelled_boxes(&boxes, N);
        let of = |number: u32| -> Vec<usize> {
            let cells = 0..labels.len();
            cells.filter(|&cell| labels[cell] == number).collect()
        };
        let beside = |number| stands_beside(&of(number), &of(1), &GROUND, N);
        assert_eq!([2, 3, 4].map(beside), [false, true, false]);
    }
}
