//! Pixels along a mask's outline, and what their votes count.

use rayon::prelude::*;

use super::mask::Mask;
use super::mask_shift::outline_distance;

/// Whether each pixel, row-major, has one of the other kind within `band` pixels, in the sense of a square window.
pub(super) fn near_edge(mask: &Mask, band: u32) -> Vec<bool> {
    let (w, h) = (mask.width() as usize, mask.height() as usize);
    let band = band as usize;
    // Counts of object pixels in windows, first along rows, then along columns.
    let window =
        |values: &[u32], length: usize, lines: usize, at: &dyn Fn(usize, usize) -> usize| {
            let mut sums = vec![0u32; values.len()];
            for line in 0..lines {
                let mut prefix = vec![0u32; length + 1];
                for i in 0..length {
                    prefix[i + 1] = prefix[i] + values[at(line, i)];
                }
                for i in 0..length {
                    sums[at(line, i)] =
                        prefix[(i + band + 1).min(length)] - prefix[i.saturating_sub(band)];
                }
            }
            sums
        };
    let ones: Vec<u32> = mask.answers().map(u32::from).collect();
    let rows = window(&ones, w, h, &|line, i| line * w + i);
    let sums = window(&rows, h, w, &|line, i| i * w + line);
    (0..w * h)
        .map(|i| {
            let (x, y) = (i % w, i / w);
            let span = |p: usize, n: usize| ((p + band + 1).min(n) - p.saturating_sub(band)) as u32;
            let full = span(x, w) * span(y, h);
            sums[i] > 0 && sums[i] < full
        })
        .collect()
}

/// What the vote of each pixel counts, from 0 to 1, row-major: within `band` pixels of the mask's outline in proportion to
/// the distance from it, but in full in the middle of what is thin; 1 farther away.
///
/// Rough masks err most at the outline. But a place beside the object is close to it in most views, and masks that take the place
/// in have it well inside: votes along outlines must be able to outvote those.
pub(super) fn vote_weights(mask: &Mask, band: u32) -> Vec<f32> {
    let distances = outline_distance(mask, band + 1);
    let middles = middles(mask, &distances, band);
    let full = band as f32 + 0.5;
    let weight = |(distance, middle): (&f32, bool)| match middle {
        true => 1.0,
        false => (distance.abs() / full).min(1.0),
    };
    distances.iter().zip(middles).map(weight).collect()
}

/// Pixels within `band` of the mask's outline that nothing around them lies farther from, on their side: the middle of
/// what is thin.
fn middles(mask: &Mask, distances: &[f32], band: u32) -> Vec<bool> {
    /// Pixels to each side that are compared.
    const AROUND: usize = 2;
    /// Distances that count as equal, in pixels: in a part of an even width no pixel lies in the middle.
    const SLACK: f32 = 0.25;
    let (w, h) = (mask.width() as usize, mask.height() as usize);
    (0..w * h)
        .into_par_iter()
        .map(|i| {
            let (x, y, own) = (i % w, i / w, distances[i]);
            if own.abs() > band as f32 + 0.5 {
                return false;
            }
            let mut rows = y.saturating_sub(AROUND)..(y + AROUND + 1).min(h);
            let columns = x.saturating_sub(AROUND)..(x + AROUND + 1).min(w);
            rows.all(|y| {
                let row = &distances[y * w..][columns.clone()];
                row.iter()
                    .all(|other| other * own.signum() <= own.abs() + SLACK)
            })
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use image::{GrayImage, Luma};

    use super::super::pixels::PixelStore;
    use super::*;

    fn mask(size: (u32, u32), object: impl Fn(u32, u32) -> bool) -> Mask {
        let white = |x, y| Luma([255 * u8::from(object(x, y))]);
        let picture = GrayImage::from_fn(size.0, size.1, white);
        Mask::of_white(&picture, &PixelStore::new(&std::env::temp_dir())).unwrap()
    }

    #[test]
    fn votes_count_more_the_farther_from_the_outline_they_are() {
        let half = mask((40, 20), |x, _| x >= 20);
        let (near, weights) = (near_edge(&half, 4), vote_weights(&half, 4));
        let row = |x: usize| 10 * 40 + x;
        assert!((0..40).all(|x| near[row(x)] == (16..24).contains(&x)));
        for away in 0..4 {
            let expected = (away as f32 + 0.5) / 4.5;
            for x in [19 - away, 20 + away] {
                let weight = weights[row(x)];
                assert!((weight - expected).abs() < 1e-3, "{x}: {weight}");
            }
        }
        assert_eq!([0, 15, 24, 39].map(|x| weights[row(x)]), [1.0; 4]);
    }

    #[test]
    fn thin_parts_and_gaps_have_a_middle_and_outlines_of_large_ones_none() {
        // A block with bars of three and two pixels on it, and a slit of three pixels in it.
        let object = |x: u32, y: u32| match (x, y) {
            (20..=22, 30..=59) => false,
            (10..=39, 20..=59) => true,
            (12..=14, 4..=19) | (24..=25, 4..=19) => true,
            _ => false,
        };
        let mask = mask((50, 70), object);
        let middles = middles(&mask, &outline_distance(&mask, 4), 3);
        let is_middle = |x: u32, y: u32| middles[(y * 50 + x) as usize];
        for y in 8..16 {
            let row: Vec<u32> = (10..30).filter(|&x| is_middle(x, y)).collect();
            assert_eq!(row, [13, 24, 25], "bars, row {y}");
        }
        for y in 36..54 {
            let row: Vec<u32> = (0..50).filter(|&x| is_middle(x, y)).collect();
            assert_eq!(row, [21], "slit, row {y}");
        }
        assert!((26..36).all(|x| !is_middle(x, 59) && !is_middle(x, 60)));
    }
}
