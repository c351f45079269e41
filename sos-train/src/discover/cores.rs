//! Where parts of a scene hang together by thin bridges.
//!
//! Surfaces that were learnt for a few minutes have streaks between things and crumbs around them, so that an object
//! may be one part with its neighbours, up to the region's border. With layers of voxels taken off all around, streaks
//! are gone and what is massive is left: cores. Every voxel belongs to the core that it is nearest to through what is solid
//! (opening by reconstruction, Vincent 1993, with several markers).

use std::collections::VecDeque;

use crate::voxels::{components, neighbours};

/// For each voxel that is `of_part`, the number of the core it belongs to, from 1 on, and how many cores there are; 0 for
/// other voxels, and where no core is reached. `solid` is what may be massive: all parts, and what nobody saw
/// within them. Cores are what is left of it with `layers` of voxels taken off.
pub(super) fn cores(
    solid: &[bool],
    of_part: impl Fn(usize) -> bool,
    resolution: usize,
    layers: usize,
) -> (Vec<u32>, u32) {
    let mut massive = solid.to_vec();
    for _ in 0..layers {
        massive = eroded(&massive, resolution);
    }
    let (mut labels, count) = components(&massive, |cell| neighbours(cell, resolution));
    // Outwards from all cores at once.
    let mut queue: VecDeque<usize> = (0..labels.len())
        .filter(|&cell| labels[cell] != 0)
        .collect();
    while let Some(cell) = queue.pop_front() {
        for next in neighbours(cell, resolution) {
            if solid[next] && labels[next] == 0 {
                labels[next] = labels[cell];
                queue.push_back(next);
            }
        }
    }
    for (cell, label) in labels.iter_mut().enumerate() {
        if !of_part(cell) {
            *label = 0;
        }
    }
    (labels, count)
}

/// Voxels whose neighbours by faces are all `inside`. Beyond the border everything is.
fn eroded(inside: &[bool], resolution: usize) -> Vec<bool> {
    let n = resolution;
    let steps = [1, n, n * n];
    (0..inside.len())
        .map(|cell| {
            inside[cell]
                && steps.iter().all(|step| {
                    let along = cell / step % n;
                    (along == 0 || inside[cell - step]) && (along + 1 == n || inside[cell + step])
                })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 24;

    /// Voxels of boxes `[low, high)` along x, y and z.
    fn boxes(all: &[[[usize; 2]; 3]]) -> Vec<bool> {
        (0..N * N * N)
            .map(|cell| {
                let at = [cell % N, cell / N % N, cell / (N * N)];
                all.iter().any(|of| {
                    at.iter()
                        .zip(of)
                        .all(|(at, [low, high])| (low..high).contains(&at))
                })
            })
            .collect()
    }

    fn at(x: usize, y: usize, z: usize) -> usize {
        (z * N + y) * N + x
    }

    #[test]
    fn what_hangs_together_by_a_streak_falls_apart_and_keeps_its_thin_parts() {
        let (left, right) = ([[2, 9], [2, 9], [2, 9]], [[15, 22], [2, 9], [2, 9]]);
        let (streak, handle) = ([[9, 15], [4, 6], [4, 6]], [[4, 6], [9, 15], [4, 6]]);
        let solid = boxes(&[left, right, streak, handle]);
        assert_eq!(components(&solid, |cell| neighbours(cell, N)).1, 1);
        let (labels, count) = cores(&solid, |cell| solid[cell], N, 2);
        assert_eq!(count, 2);
        let (a, b) = (labels[at(5, 5, 5)], labels[at(18, 5, 5)]);
        assert!(a != 0 && b != 0 && a != b);
        // The streak is parted in its middle; the handle has nowhere else to go.
        assert_eq!((labels[at(10, 5, 5)], labels[at(13, 5, 5)]), (a, b));
        assert_eq!(labels[at(5, 14, 5)], a);
        assert_eq!(labels[at(0, 0, 0)], 0);
    }

    #[test]
    fn what_goes_on_beyond_the_border_is_massive_there() {
        let slab = boxes(&[[[0, 4], [0, N], [0, N]]]);
        let (labels, count) = cores(&slab, |cell| slab[cell], N, 2);
        assert_eq!(count, 1);
        assert!((0..slab.len()).all(|cell| (labels[cell] == 1) == slab[cell]));
        assert_eq!(cores(&vec![false; N * N * N], |_| true, N, 1).1, 0);
    }
}
