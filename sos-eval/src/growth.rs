//! Regions that grow over a picture, cheapest pixel first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The first `count` pixels that a region reaches which starts at `seeds` and spreads over the pixels
/// that `open` names, nearest first (Dijkstra over the eight neighbours).
///
/// A step's length is 1, or the square root of 2 diagonally, times `resistance(pixel)` of where it
/// leads, which is positive. Seeds count as reached if they are open. Fewer pixels come back where there
/// are no more to reach.
pub(crate) fn grow(
    (width, height): (usize, usize),
    seeds: impl IntoIterator<Item = usize>,
    open: impl Fn(usize) -> bool,
    resistance: impl Fn(usize) -> f32,
    count: usize,
) -> Vec<usize> {
    let mut cost = vec![f32::INFINITY; width * height];
    let mut queue = BinaryHeap::new();
    for seed in seeds {
        cost[seed] = 0.0;
        queue.push(Reverse((0, seed)));
    }
    let mut reached = Vec::with_capacity(count.min(width * height));
    while reached.len() < count {
        let Some(Reverse((bits, pixel))) = queue.pop() else {
            break;
        };
        // Costs are not negative, so that their bits are ordered as they are.
        let at = f32::from_bits(bits);
        if at > cost[pixel] {
            continue;
        }
        if open(pixel) {
            reached.push(pixel);
        }
        let (x, y) = (pixel % width, pixel / width);
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                let next = v * width + u;
                if next == pixel || !open(next) {
                    continue;
                }
                let length = if u == x || v == y {
                    1.0
                } else {
                    std::f32::consts::SQRT_2
                };
                let there = at + length * resistance(next);
                if there < cost[next] {
                    cost[next] = there;
                    queue.push(Reverse((there.to_bits(), next)));
                }
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_open_ground_a_region_is_round() {
        let reached = grow((41, 41), [20 * 41 + 20], |_| true, |_| 1.0, 600);
        assert_eq!(reached.len(), 600);
        // The disc of that area has radius 13.8; eight directions make an octagon of it.
        for pixel in reached {
            let (x, y) = ((pixel % 41) as f32 - 20.0, (pixel / 41) as f32 - 20.0);
            assert!(x.hypot(y) < 15.0, "{x} {y}");
        }
    }

    #[test]
    fn a_region_goes_where_it_is_easy_and_stays_where_it_is_open() {
        // A cheap lane along the top row, beyond a wall.
        let reached = grow(
            (10, 10),
            [0],
            |pixel| pixel / 10 != 1,
            |pixel| if pixel < 10 { 0.1 } else { 1.0 },
            50,
        );
        assert_eq!(reached, (0..10).collect::<Vec<_>>());
    }
}
