//! Which parts stand beside a thing, by themselves.
//!
//! Thin things come apart, so that small parts within the bounds of a thing belong to it. But what has its own foot on the
//! ground is a thing of its own where it stands next to the other, and a leg or a wheel where that is above it.

use std::collections::HashSet;

use glam::Vec3;
use scene_decomp::probability::ProbabilityMap;

use super::hanging::HANGS;
use super::plane::{Plane, height_above};

/// The side of a footprint's squares, in voxels: the grid is not aligned with the ground.
const SQUARE: f32 = 2.0;
/// The share of a part's voxels that have the thing above or below them from which on it does not stand beside it.
const UNDER: f32 = 0.5;

#[derive(Clone, Copy)]
struct Stand {
    voxels: usize,
    /// Of them, those with the thing above or below them.
    under: usize,
    /// How high the lowest is above the ground, in voxels.
    foot: f32,
}

/// For each number in `labels`, up to `count`, whether its part stands on the ground beside those numbered in `thing`.
pub(super) fn standing_beside(
    labels: &[u32],
    count: u32,
    thing: &[usize],
    ground: &Plane,
    resolution: usize,
) -> Vec<bool> {
    let (east, north) = ground.normal.any_orthonormal_pair();
    let squares = 0.5 * resolution as f32 / SQUARE;
    let square = |cell: usize| {
        let p: Vec3 = squares * ProbabilityMap::centre(resolution, cell);
        [east, north].map(|axis| p.dot(axis).floor() as i32)
    };
    let parts = || labels.iter().map(|label| *label as usize).enumerate();
    let footprint: HashSet<[i32; 2]> = parts()
        .filter(|(_, label)| thing.contains(label))
        .map(|(cell, _)| square(cell))
        .collect();
    let nothing = Stand {
        voxels: 0,
        under: 0,
        foot: f32::INFINITY,
    };
    let mut stands = vec![nothing; count as usize + 1];
    let height = height_above(ground, resolution);
    for (cell, label) in parts().filter(|(_, label)| *label != 0) {
        let stand = &mut stands[label];
        stand.voxels += 1;
        stand.under += usize::from(footprint.contains(&square(cell)));
        stand.foot = stand.foot.min(height(cell));
    }
    let is_beside =
        |stand: &Stand| stand.foot <= HANGS && (stand.under as f32) < UNDER * stand.voxels as f32;
    stands.iter().map(is_beside).collect()
}

#[cfg(test)]
mod tests {
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
        let label = |cell: usize| {
            let at = [cell % N, cell / N % N, cell / (N * N)];
            let holds = |of: &[[usize; 2]; 3]| {
                let mut axes = at.iter().zip(of);
                axes.all(|(at, [low, high])| (low..high).contains(&at))
            };
            boxes.iter().position(holds).map_or(0, |i| i as u32 + 1)
        };
        let labels: Vec<u32> = (0..N * N * N).map(label).collect();
        let beside = standing_beside(&labels, 4, &[1], &GROUND, N);
        assert_eq!(beside, [false, false, false, true, false]);
    }
}
