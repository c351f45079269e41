//! Mattes that end where their photo does.
//!
//! The surface is one for all views, and ends where most of them agree. Each view's own photo then moves its matte's outline
//! by a few pixels where it shows plainly that it lies elsewhere ([`snap`](crate::snap)); there the matte's soft edge is made
//! anew.

use image::{Rgb, RgbImage};

use crate::grown::grown;
use crate::prepare::TrainView;
use crate::prepare::pixels::Photo;
use crate::snap::{self, snap};

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
    let squares = Squares::new(width, height);
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

/// A rectangle of squares.
struct Part {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Part {
    /// Columns and rows, row by row.
    fn places(&self) -> impl Iterator<Item = (u32, u32)> {
        let (x0, width) = (self.x, self.width);
        (self.y..self.y + self.height).flat_map(move |y| (x0..x0 + width).map(move |x| (x, y)))
    }
}

/// Squares of a picture's pixels.
struct Squares {
    side: u32,
    width: u32,
    columns: u32,
    rows: u32,
}

impl Squares {
    fn new(width: u32, height: u32) -> Self {
        let side = width.max(height).div_ceil(snap::LONGEST).max(1);
        Self {
            side,
            width,
            columns: width.div_ceil(side),
            rows: height.div_ceil(side),
        }
    }

    /// The square that holds a pixel.
    fn of(&self, x: u32, y: u32) -> usize {
        (y / self.side * self.columns + x / self.side) as usize
    }

    /// What lies within `margin` of the squares that are `inside`; `None` where none is.
    fn around(&self, inside: &[bool], margin: u32) -> Option<Part> {
        let all = (0..).zip(inside).filter(|(_, inside)| **inside);
        let places = all.map(|(i, _): (u32, _)| (i % self.columns, i / self.columns));
        let [x0, y0, x1, y1] = places.fold([u32::MAX, u32::MAX, 0, 0], |all, (x, y)| {
            [all[0].min(x), all[1].min(y), all[2].max(x), all[3].max(y)]
        });
        let part = |first: u32, last: u32, count: u32| {
            let first = first.saturating_sub(margin);
            (first, (last + margin + 1).min(count) - first)
        };
        (x0 <= x1).then(|| {
            let ((x, width), (y, height)) = (part(x0, x1, self.columns), part(y0, y1, self.rows));
            Part {
                x,
                y,
                width,
                height,
            }
        })
    }

    /// The mean colour of a square.
    fn colour(&self, photo: &Photo, column: u32, row: u32) -> Rgb<u8> {
        let span = |first: u32, end: u32| first * self.side..((first + 1) * self.side).min(end);
        let (mut sums, mut count) = ([0u32; 3], 0);
        for y in span(row, photo.height()) {
            for x in span(column, photo.width()) {
                for (sum, value) in sums.iter_mut().zip(photo.get_pixel(x, y).0) {
                    *sum += u32::from(value);
                }
                count += 1;
            }
        }
        Rgb(sums.map(|sum| (sum / count.max(1)) as u8))
    }

    /// The mean value of each square.
    fn means(&self, values: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0f32, 0u32); (self.columns * self.rows) as usize];
        for (i, value) in (0..).zip(values) {
            let sum = &mut sums[self.of(i % self.width, i / self.width)];
            sum.0 += value;
            sum.1 += 1;
        }
        sums.into_iter()
            .map(|(sum, n)| sum / n.max(1) as f32)
            .collect()
    }

    /// The value at a pixel's centre, between those of the squares' centres.
    fn between(&self, values: &[f32], x: u32, y: u32) -> f32 {
        let along = |pixel: u32, count: u32| {
            let at = (pixel as f32 + 0.5) / self.side as f32 - 0.5;
            let at = at.clamp(0.0, (count - 1) as f32);
            let first = at as u32;
            (first, (first + 1).min(count - 1), at - first as f32)
        };
        let ((x0, x1, tx), (y0, y1, ty)) = (along(x, self.columns), along(y, self.rows));
        let row = |y: u32| {
            let at = |x: u32| values[(y * self.columns + x) as usize];
            at(x0) + tx * (at(x1) - at(x0))
        };
        row(y0) + ty * (row(y1) - row(y0))
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
