//! Which things stand on the ground by themselves.
//!
//! Things that stand close to each other hang together at their feet in what was learnt: shadows, streaks, what no view
//! showed between them. Looked at from above they are hills, and what joins them is a pass
//! (watersheds, Beucher and Lantuéjoul 1979): two hills are two things where the pass is low, for an object's own parts come
//! together higher up, and where it is narrow, for what stands on a common base is one thing.

use std::collections::BTreeMap;

use super::parts::LEAST_VOXELS;
use crate::voxels::neighbours;

/// How high a pass is, of the lower hill's height, from which on both hills are one thing.
const HIGH_PASS: f32 = 0.7;
/// How wide a border is, of the smaller hill's voxels to the power of 2/3, from which on both hills are one thing. Of things
/// that only stood close it was 0.002 to 0.1, of parts of one thing 0.18 to 1.4 (docs/decisions/without-masks.md).
const WIDE_BORDER: f32 = 0.12;
/// Voxels above the ground that the lowest hill has.
const LEAST_HEIGHT: f32 = 6.0;

/// Hills: sets of voxels that are united step by step.
struct Hills {
    /// The hill that each one became a part of, itself for those that are none's.
    part_of: Vec<u32>,
    voxels: Vec<usize>,
    peak: Vec<f32>,
}

impl Hills {
    /// One without voxels, which stands for none.
    fn none() -> Self {
        Self {
            part_of: vec![0],
            voxels: vec![0],
            peak: vec![0.0],
        }
    }

    /// A new one, of no voxels yet.
    fn add(&mut self, peak: f32) -> u32 {
        let hill = self.part_of.len() as u32;
        self.part_of.push(hill);
        self.voxels.push(0);
        self.peak.push(peak);
        hill
    }

    /// The whole that a hill is part of.
    fn whole(&mut self, mut hill: u32) -> u32 {
        while self.part_of[hill as usize] != hill {
            let above = self.part_of[self.part_of[hill as usize] as usize];
            self.part_of[hill as usize] = above;
            hill = above;
        }
        hill
    }

    /// Makes two wholes one, by the name of the higher.
    fn unite(&mut self, a: u32, b: u32) -> u32 {
        let (stays, goes) = if self.peak[a as usize] >= self.peak[b as usize] {
            (a, b)
        } else {
            (b, a)
        };
        self.part_of[goes as usize] = stays;
        self.voxels[stays as usize] += self.voxels[goes as usize];
        stays
    }

    /// Whether two wholes that meet at `height` are one by it alone.
    fn meet_high(&self, a: u32, b: u32, height: f32) -> bool {
        let [a, b] = [a, b].map(|hill| hill as usize);
        let lower = self.peak[a].min(self.peak[b]);
        height > HIGH_PASS * lower
            || lower < LEAST_HEIGHT
            || self.voxels[a].min(self.voxels[b]) < LEAST_VOXELS
    }

    /// Whether the border between two wholes, of so many faces of voxels, is too wide for two things.
    fn meet_wide(&self, a: u32, b: u32, faces: usize) -> bool {
        let smaller = self.voxels[a as usize].min(self.voxels[b as usize]) as f32;
        faces as f32 > WIDE_BORDER * smaller.powf(2.0 / 3.0)
    }
}

/// The number of the thing that each voxel `inside` belongs to, from 1 on, and how many things there are; 0 is none.
/// `height` is that of a voxel above the ground, in voxels.
pub(super) fn things(
    inside: &[bool],
    height: impl Fn(usize) -> f32,
    resolution: usize,
) -> (Vec<u32>, u32) {
    let mut downwards: Vec<(f32, usize)> = (0..inside.len())
        .filter(|&cell| inside[cell])
        .map(|cell| (height(cell), cell))
        .collect();
    downwards.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut labels = vec![0; inside.len()];
    let mut hills = Hills::none();
    let mut around: Vec<(u32, usize)> = Vec::new();
    for &(height, cell) in &downwards {
        around.clear();
        for next in neighbours(cell, resolution).filter(|next| labels[*next] != 0) {
            let hill = hills.whole(labels[next]);
            match around.iter_mut().find(|(known, _)| *known == hill) {
                Some((_, count)) => *count += 1,
                None => around.push((hill, 1)),
            }
        }
        // The one that most of what is around belongs to.
        around.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let mut found = match around.first() {
            Some((hill, _)) => *hill,
            None => hills.add(height),
        };
        for (other, _) in around.drain(..).skip(1) {
            if hills.meet_high(found, other, height) {
                found = hills.unite(found, other);
            }
        }
        labels[cell] = found;
        hills.voxels[found as usize] += 1;
    }
    for ((a, b), faces) in borders(&labels, &mut hills, resolution) {
        let (a, b) = (hills.whole(a), hills.whole(b));
        if a != b && hills.meet_wide(a, b, faces) {
            hills.unite(a, b);
        }
    }
    let mut numbers = vec![0; hills.part_of.len()];
    let mut count = 0;
    for label in labels.iter_mut().filter(|label| **label != 0) {
        let number = &mut numbers[hills.whole(*label) as usize];
        if *number == 0 {
            count += 1;
            *number = count;
        }
        *label = *number;
    }
    (labels, count)
}

/// How many faces of voxels two wholes have in common, for each two that have any.
fn borders(labels: &[u32], hills: &mut Hills, resolution: usize) -> BTreeMap<(u32, u32), usize> {
    let mut faces = BTreeMap::new();
    for cell in 0..labels.len() {
        for step in [1, resolution, resolution * resolution] {
            let is_last = cell / step % resolution + 1 == resolution;
            if labels[cell] == 0 || is_last || labels[cell + step] == 0 {
                continue;
            }
            let [a, b] = [cell, cell + step].map(|cell| hills.whole(labels[cell]));
            if a != b {
                *faces.entry((a.min(b), a.max(b))).or_default() += 1;
            }
        }
    }
    faces
}

#[cfg(test)]
mod tests {
    use super::super::staged::labelled_boxes;
    use super::*;

    const N: usize = 40;

    /// Things of boxes `[low, high)` along x, y and z, of which z is up.
    fn of_boxes(all: &[[[usize; 2]; 3]]) -> (Vec<u32>, u32) {
        let labels = labelled_boxes(all, N);
        let inside: Vec<bool> = labels.iter().map(|label| *label != 0).collect();
        things(&inside, |cell| (cell / (N * N)) as f32, N)
    }

    fn at(x: usize, y: usize, z: usize) -> usize {
        (z * N + y) * N + x
    }

    const LEFT: [[usize; 2]; 3] = [[2, 14], [2, 14], [0, 20]];
    const RIGHT: [[usize; 2]; 3] = [[22, 36], [2, 14], [0, 16]];

    #[test]
    fn things_that_touch_at_their_feet_are_two() {
        let streak = [[14, 22], [6, 9], [0, 2]];
        let (labels, count) = of_boxes(&[LEFT, RIGHT, streak]);
        assert_eq!(count, 2);
        assert_ne!(labels[at(5, 5, 1)], labels[at(30, 5, 1)]);
        assert_eq!(labels[at(5, 5, 1)], labels[at(5, 5, 19)]);
        assert_eq!(labels[at(0, 0, 0)], 0);
        // All that is inside belongs to one of them.
        assert!(labels[at(18, 7, 1)] != 0);
    }

    #[test]
    fn what_comes_together_higher_up_or_on_a_common_base_is_one() {
        let bridge = [[14, 22], [6, 9], [12, 14]];
        assert_eq!(of_boxes(&[LEFT, RIGHT, bridge]).1, 1, "legs of a table");
        let base = [[14, 22], [2, 14], [0, 4]];
        assert_eq!(of_boxes(&[LEFT, RIGHT, base]).1, 1, "a common base");
    }

    #[test]
    fn low_and_small_hills_are_none_of_their_own() {
        let streak = [[14, 22], [6, 9], [0, 1]];
        let flat = [[22, 36], [2, 14], [0, 4]];
        assert_eq!(of_boxes(&[LEFT, flat, streak]).1, 1);
        let thin = [[22, 24], [6, 8], [0, 9]];
        assert_eq!(of_boxes(&[LEFT, thin, streak]).1, 1);
        assert_eq!(of_boxes(&[]).1, 0);
    }
}
