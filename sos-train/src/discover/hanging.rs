//! What holds a part that hangs in the air.
//!
//! Nothing does: a part that does not reach the ground is held by something that photos do not show well enough, a neck of
//! clear glass, a thin stem, a wire, or hangs on what it touches. What stands nearest holds it, if that is no farther away
//! than half of the part's own size; otherwise it is haze, or a thing on a wall.

use std::collections::VecDeque;

use glam::Vec3;

use crate::voxels::faces;

/// Voxels above the ground from which on a part does not stand on it: as many as the lowest hill has.
pub(super) const HANGS: f32 = 6.0;
/// How far away what holds a part may be, of the part's largest side.
const NEAR: f32 = 0.5;
/// Voxels this near touch.
const TOUCHING: f32 = 1.8;
/// Of the voxels of what it touches, how many a part may have that hangs on that. More is a thing whose foot no view
/// shows, and which was taken for one of its own although it touches.
const LIGHT: f32 = 0.5;

/// What is known of a part.
#[derive(Clone, Copy)]
struct Extent {
    voxels: usize,
    low: Vec3,
    high: Vec3,
    /// How high its lowest voxel is, in voxels.
    foot: f32,
    /// The nearest part that stands, and how many voxels away.
    nearest: (u32, f32),
}

impl Extent {
    const NOTHING: Self = Self {
        voxels: 0,
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        foot: f32::INFINITY,
        nearest: (0, f32::INFINITY),
    };

    fn hangs(&self) -> bool {
        self.foot > HANGS
    }

    /// The part that holds it, if one `of_all` does.
    fn holder(&self, of_all: &[Self]) -> Option<u32> {
        let size = (self.high - self.low + 1.0).max_element();
        let (part, gap) = self.nearest;
        let is_light = || self.voxels as f32 <= LIGHT * of_all[part as usize].voxels as f32;
        let is_near = gap <= NEAR * size && (gap > TOUCHING || is_light());
        (self.hangs() && is_near).then_some(part)
    }
}

/// For each part, which has the numbers from 1 on in `labels`, the one that holds it: itself, where it stands or nothing is
/// near. Those that `may_hold` do; `height` is that of a voxel above the ground, in voxels.
pub(super) fn holders(
    labels: &[u32],
    count: u32,
    may_hold: impl Fn(u32) -> bool,
    height: impl Fn(usize) -> f32,
    resolution: usize,
) -> Vec<u32> {
    let n = resolution;
    let place =
        |cell: usize| Vec3::from([cell % n, cell / n % n, cell / (n * n)].map(|v| v as f32));
    let mut extents = vec![Extent::NOTHING; count as usize + 1];
    for (cell, &label) in labels.iter().enumerate().filter(|(_, label)| **label != 0) {
        let extent = &mut extents[label as usize];
        extent.voxels += 1;
        extent.low = extent.low.min(place(cell));
        extent.high = extent.high.max(place(cell));
        extent.foot = extent.foot.min(height(cell));
    }
    // Outwards from all that stands, with the voxel from which each one is reached.
    let holds = |&cell: &usize| {
        let label = labels[cell];
        label != 0 && !extents[label as usize].hangs() && may_hold(label)
    };
    let mut queue: VecDeque<usize> = (0..labels.len()).filter(holds).collect();
    let mut reached: Vec<Option<usize>> = vec![None; labels.len()];
    for &cell in &queue {
        reached[cell] = Some(cell);
    }
    while let Some(cell) = queue.pop_front() {
        let source = reached[cell];
        for next in faces(cell, n) {
            if reached[next].is_some() {
                continue;
            }
            reached[next] = source;
            queue.push_back(next);
        }
        if let (Some(source), label @ 1..) = (source, labels[cell]) {
            let gap = place(cell).distance(place(source));
            let nearest = &mut extents[label as usize].nearest;
            if gap < nearest.1 {
                *nearest = (labels[source], gap);
            }
        }
    }
    let own = (0..=count).zip(&extents);
    own.map(|(part, extent)| extent.holder(&extents).unwrap_or(part))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::staged::labelled_boxes;
    use super::*;

    const N: usize = 40;
    /// A part of this number holds nothing.
    const SHELF: u32 = 4;

    /// Labels of boxes `[low, high)` along x, y and z, of which z is up, and who holds whom.
    fn held(boxes: &[[[usize; 2]; 3]]) -> Vec<u32> {
        let labels = labelled_boxes(boxes, N);
        let height = |cell: usize| (cell / (N * N)) as f32;
        let may_hold = |label: u32| label != SHELF;
        holders(&labels, boxes.len() as u32, may_hold, height, N)
    }

    const BODY: [[usize; 2]; 3] = [[6, 18], [10, 22], [0, 14]];
    const NEIGHBOUR: [[usize; 2]; 3] = [[24, 36], [10, 22], [0, 12]];

    #[test]
    fn what_hangs_is_held_by_what_stands_nearest() {
        let head = [[8, 22], [12, 20], [19, 25]];
        assert_eq!(held(&[BODY, NEIGHBOUR, head]), [0, 1, 2, 1]);
        let head = [[23, 37], [12, 20], [17, 23]];
        assert_eq!(held(&[head, BODY, NEIGHBOUR]), [0, 3, 2, 3]);
        // The shelf is nearer.
        let (head, shelf) = ([[8, 22], [12, 20], [19, 25]], [[8, 22], [22, 24], [0, 30]]);
        assert_eq!(held(&[BODY, NEIGHBOUR, head, shelf]), [0, 1, 2, 1, 4]);
    }

    #[test]
    fn what_stands_or_hangs_far_from_everything_is_by_itself() {
        let low = [[20, 22], [12, 20], [6, 12]];
        assert_eq!(held(&[BODY, low]), [0, 1, 2]);
        let small = [[8, 12], [12, 16], [18, 22]];
        assert_eq!(held(&[BODY, small]), [0, 1, 2]);
        assert_eq!(held(&[]), [0]);
    }

    #[test]
    fn what_touches_hangs_on_it_unless_it_is_heavy() {
        let leaning = [[18, 30], [12, 20], [10, 22]];
        assert_eq!(held(&[BODY, leaning]), [0, 1, 2]);
        let handle = [[18, 24], [14, 18], [8, 13]];
        assert_eq!(held(&[BODY, handle]), [0, 1, 1]);
    }
}
