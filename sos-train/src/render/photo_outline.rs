//! Mattes that end where their photo does.
//!
//! The surface is one for all views, and ends where most of them agree. Each view's own photo then moves its matte's outline
//! by a few pixels where it shows plainly that it lies elsewhere ([`snap`](crate::snap)); there the matte's soft edge is made
//! anew.

use image::RgbImage;

use crate::cells::grown;
use crate::prepare::TrainView;
use crate::snap::{self, snap};
use crate::squares::Squares;

/// How far around what has moved the matte's edge is made anew, along both axes, as a share of how far it may move: what is left of the old
/// edge, which may be soft, would be a thin line beside the new one.
const REACH: f32 = 0.75;

/// Moves the outline of a view's matte to where its photo shows it. `alpha` has a value in `[0, 1]` for each pixel,
/// row-major.
///
/// Photos larger than [`snap::LONGEST`] are looked at in squares of so many pixels that they are not; what has moved is as
/// soft as a square there.
pub(super) fn follow_photo(view: &TrainView, alpha: &mut [f32]) {
    let (width, height) = (view.width(), view.height());
    let squares = Squares::new(width, height, snap::LONGEST);
    let coverage = squares.means(alpha);
    let inside: Vec<bool> = coverage.iter().map(|coverage| *coverage > 0.5).collect();
    let (columns, rows) = (squares.columns, squares.rows);
    let band = snap::band(columns, rows);
    let Some(part) = squares.around(&inside, snap::surroundings(band)) else {
        return;
    };
    let photo = RgbImage::from_fn(part.width, part.height, |x, y| {
        squares.colour(&view.photo, part.x + x, part.y + y)
    });
    let usable: Vec<bool> = part
        .places()
        .map(|(x, y)| !view.ignores(x * squares.side, y * squares.side))
        .collect();
    let number = |(x, y): (u32, u32)| (y * columns + x) as usize;
    let before: Vec<bool> = part.places().map(|place| inside[number(place)]).collect();
    let after = snap(&photo, &before, &usable, band);
    let mut now = inside.clone();
    for (place, after) in part.places().zip(after) {
        now[number(place)] = after;
    }
    let moved: Vec<bool> = now.iter().zip(&inside).map(|(a, b)| a != b).collect();
    if !moved.contains(&true) {
        return;
    }
    let near = grown(&moved, columns as usize, (REACH * band).ceil() as usize);
    let edge: Vec<f32> = (0..coverage.len())
        .map(|i| {
            if !near[i] {
                return coverage[i];
            }
            let smooth = binomial(&now, columns as usize, i);
            match (moved[i], now[i]) {
                (true, true) => smooth.max(0.5),
                (true, false) => smooth.min(0.5),
                _ => smooth,
            }
        })
        .collect();
    for (i, alpha) in (0..width * height).zip(alpha) {
        let (x, y) = (i % width, i / width);
        if near[squares.of(x, y)] {
            *alpha = squares.between(&edge, x, y);
        }
    }
}

/// Pixel `i` and its neighbours, weighed 1, 2, 1 along both axes; beyond the border the picture goes on.
fn binomial(inside: &[bool], width: usize, i: usize) -> f32 {
    let (x, y, height) = (i % width, i / width, inside.len() / width);
    let mut sum = 0.0;
    for (dy, wy) in [(0, 1.0), (1, 2.0), (2, 1.0)] {
        for (dx, wx) in [(0, 1.0), (1, 2.0), (2, 1.0)] {
            let (x, y) = (
                (x + dx).saturating_sub(1).min(width - 1),
                (y + dy).saturating_sub(1).min(height - 1),
            );
            sum += wx * wy * f32::from(u8::from(inside[y * width + x]));
        }
    }
    sum / 16.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::disc;

    /// How far mattes of a disc are from the truth in all, before and after, where one is given that is `off` pixels too
    /// large on its right side.
    fn errors(width: u32, height: u32, radius: f32, off: f32) -> (f32, f32) {
        let view = disc::view(width, height, radius);
        let matte = |off: f32| -> Vec<f32> {
            let distance = |i: u32| {
                let x = (i % width) as f32 - 0.5 * width as f32;
                let y = (i / width) as f32 - 0.5 * height as f32;
                let off = off * (1.0 - y.atan2(x).abs()).max(0.0);
                x.hypot(y) - radius - off
            };
            (0..width * height)
                .map(|i| (0.5 - 0.5 * distance(i)).clamp(0.0, 1.0))
                .collect()
        };
        let (truth, given) = (matte(0.0), matte(off));
        let mut found = given.clone();
        follow_photo(&view, &mut found);
        let error = |matte: &[f32]| -> f32 {
            let both = matte.iter().zip(&truth);
            both.map(|(matte, truth)| (matte - truth).abs()).sum()
        };
        (error(&given), error(&found))
    }

    #[test]
    fn a_matte_with_a_rim_of_the_ground_loses_it() {
        let (before, after) = errors(300, 240, 70.0, 3.0);
        assert!(after < 0.5 * before, "{before} {after}");
    }

    #[test]
    fn large_photos_are_looked_at_in_squares() {
        let (before, after) = errors(1999, 1201, 300.0, 14.0);
        assert!(after < 0.5 * before, "{before} {after}");
    }

    #[test]
    fn a_matte_that_is_right_stays_to_the_bit() {
        let (before, after) = errors(200, 160, 50.0, 0.0);
        assert_eq!((before, after), (0.0, 0.0));
    }
}
