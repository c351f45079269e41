//! Holes of mattes, filled: what is left is the outer outline.

use crate::picture::Plane;
use crate::report::MASK_THRESHOLD;

/// The matte without holes: 1 wherever alpha is below 0.5 with no way out of the picture, from neighbour to
/// neighbour in rows and columns, through such pixels alone; and in the soft rims of such holes, that is, in the
/// eight pixels around each of theirs.
///
/// Annotations of one object differ in which of its openings they leave out. Scored like this, on both sides,
/// they do not count, and what an outline loses to them shows as the difference.
#[must_use]
pub fn fill_holes(matte: &Plane) -> Plane {
    let (width, height) = (matte.width, matte.height);
    let outside = |i: usize| matte.values[i] < MASK_THRESHOLD;
    let mut reached = vec![false; matte.values.len()];
    let on_edge = |i: usize| {
        let (x, y) = (i % width, i / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let mut open: Vec<usize> = (0..reached.len())
        .filter(|&i| on_edge(i) && outside(i))
        .collect();
    for &i in &open {
        reached[i] = true;
    }
    while let Some(i) = open.pop() {
        let x = i % width;
        let near = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then(|| i + 1),
            i.checked_sub(width),
            (i + width < reached.len()).then(|| i + width),
        ];
        for j in near.into_iter().flatten() {
            if !reached[j] && outside(j) {
                reached[j] = true;
                open.push(j);
            }
        }
    }
    let mut filled = matte.clone();
    for i in (0..reached.len()).filter(|&i| outside(i) && !reached[i]) {
        // A hole is never at the picture's edge, so all eight are there.
        for start in [i - width, i, i + width] {
            filled.values[start - 1..=start + 1].fill(1.0);
        }
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(radius: f32, hole: f32) -> Plane {
        Plane::from_fn(64, 48, |x, y| {
            let r = (x as f32 - 30.0).hypot(y as f32 - 24.0);
            f32::from(u8::from(r < radius && r >= hole))
        })
    }

    #[test]
    fn a_ring_becomes_a_disc() {
        assert_eq!(fill_holes(&ring(20.0, 8.0)), ring(20.0, 0.0));
    }

    #[test]
    fn a_soft_rim_goes_with_its_hole() {
        let disc = |radius: f32, x: usize, y: usize| {
            let r = (x as f32 - 30.3).hypot(y as f32 - 24.4);
            (radius + 0.5 - r).clamp(0.0, 1.0)
        };
        let soft = Plane::from_fn(64, 48, |x, y| disc(20.0, x, y) - disc(8.0, x, y));
        let whole = Plane::from_fn(64, 48, |x, y| disc(20.0, x, y));
        assert_eq!(fill_holes(&soft), whole);
    }

    #[test]
    fn what_is_open_to_the_outside_stays_open() {
        let mut horseshoe = ring(20.0, 8.0);
        for y in 0..24 {
            horseshoe.values[y * 64 + 30] = 0.0;
        }
        assert_eq!(fill_holes(&horseshoe), horseshoe);
        // A ring that the picture cuts off: its inside reaches the picture's edge.
        let cut = ring(40.0, 30.0);
        assert_eq!(fill_holes(&cut), cut);
    }

    #[test]
    fn soft_edges_stay_as_they_are() {
        let soft = Plane::from_fn(40, 40, |x, y| {
            let r = (x as f32 - 20.0).hypot(y as f32 - 20.0);
            (15.0 - r).clamp(0.0, 0.9)
        });
        assert_eq!(fill_holes(&soft), soft);
        assert_eq!(fill_holes(&Plane::empty(3, 2)), Plane::empty(3, 2));
        assert_eq!(fill_holes(&Plane::empty(0, 0)), Plane::empty(0, 0));
    }
}
