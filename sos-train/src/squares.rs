//! Large pictures in squares of pixels.
//!
//! What has a width in pixels, such as the blur of an outline, is wider in larger photos: they are soft. So widths are those of
//! squares, of which a picture has about as many as a small photo has pixels. Where a colour or a ray of each is enough,
//! it is that of the middle.

use image::Rgb;

use crate::prepare::pixels::Photo;
use crate::prepare::spans::PixelSpans;

/// A rectangle of squares.
pub(crate) struct Part {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl Part {
    /// Columns and rows, row by row.
    pub(crate) fn places(&self) -> impl Iterator<Item = (u32, u32)> {
        let (x0, width) = (self.x, self.width);
        (self.y..self.y + self.height).flat_map(move |y| (x0..x0 + width).map(move |x| (x, y)))
    }
}

/// Squares of a picture's pixels, by number row by row; the last ones of a row or column may be cut off.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Squares {
    /// Pixels along one.
    pub(crate) side: u32,
    width: u32,
    height: u32,
    pub(crate) columns: u32,
    pub(crate) rows: u32,
}

impl Squares {
    /// Of a picture's size: no more than `longest` along its longer side.
    pub(crate) fn new(width: u32, height: u32, longest: u32) -> Self {
        Self::of_side(width, height, width.max(height).div_ceil(longest))
    }

    /// Of a picture's size, with so many pixels along one, at least one.
    pub(crate) fn of_side(width: u32, height: u32, side: u32) -> Self {
        let side = side.max(1);
        Self {
            side,
            width,
            height,
            columns: width.div_ceil(side),
            rows: height.div_ceil(side),
        }
    }

    /// The same pixels in squares of which so many are as long as one of these, at least of one pixel.
    pub(crate) fn closer(&self, times: u32) -> Self {
        Self::of_side(self.width, self.height, self.side / times)
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        (self.columns * self.rows) as usize
    }

    /// The pixel in the middle of square number `i`.
    pub(crate) fn middle(&self, i: usize) -> (u32, u32) {
        let middle = |v: u32, size: u32| (v * self.side + self.side / 2).min(size - 1);
        let (column, row) = (i as u32 % self.columns, i as u32 / self.columns);
        (middle(column, self.width), middle(row, self.height))
    }

    /// Columns and rows of the pixels of square number `i`, row by row.
    pub(crate) fn pixels_of(&self, i: usize) -> impl Iterator<Item = (u32, u32)> {
        let (column, row) = (i as u32 % self.columns, i as u32 / self.columns);
        let span = |first: u32, end: u32| first * self.side..((first + 1) * self.side).min(end);
        let (columns, rows) = (span(column, self.width), span(row, self.height));
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }

    /// The pixels of the squares that are `marked`.
    pub(crate) fn pixels(&self, marked: &[bool]) -> PixelSpans {
        let mut pixels = PixelSpans::default();
        if !marked.contains(&true) {
            return pixels;
        }
        for pixel in 0..self.width * self.height {
            if marked[self.of(pixel % self.width, pixel / self.width)] {
                pixels.push(pixel);
            }
        }
        pixels
    }

    /// The square that holds a pixel.
    pub(crate) fn of(&self, x: u32, y: u32) -> usize {
        (y / self.side * self.columns + x / self.side) as usize
    }

    /// What lies within `margin` of the squares that are `inside`; `None` where none is.
    pub(crate) fn around(&self, inside: &[bool], margin: u32) -> Option<Part> {
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
    pub(crate) fn colour(&self, photo: &Photo, column: u32, row: u32) -> Rgb<u8> {
        let (mut sums, mut count) = ([0u32; 3], 0);
        for (x, y) in self.pixels_of((row * self.columns + column) as usize) {
            for (sum, value) in sums.iter_mut().zip(photo.get_pixel(x, y).0) {
                *sum += u32::from(value);
            }
            count += 1;
        }
        Rgb(sums.map(|sum| (sum / count.max(1)) as u8))
    }

    /// The mean value of each square.
    pub(crate) fn means(&self, values: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0f32, 0u32); self.len()];
        for (i, value) in (0..).zip(values) {
            let sum = &mut sums[self.of(i % self.width, i / self.width)];
            sum.0 += value;
            sum.1 += 1;
        }
        sums.into_iter()
            .map(|(sum, n)| sum / n.max(1) as f32)
            .collect()
    }

    /// The largest value in each square.
    pub(crate) fn largest(&self, values: &[f32]) -> Vec<f32> {
        let mut largest = vec![f32::NEG_INFINITY; self.len()];
        for (i, value) in (0..).zip(values) {
            let square = &mut largest[self.of(i % self.width, i / self.width)];
            *square = square.max(*value);
        }
        largest
    }

    /// A value for each pixel, between those of the squares.
    pub(crate) fn spread(&self, values: &[f32]) -> Vec<f32> {
        if self.side == 1 {
            return values.to_vec();
        }
        let pixels = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        pixels.map(|(x, y)| self.between(values, x, y)).collect()
    }

    /// The value at a pixel's centre, between those of the squares' centres.
    pub(crate) fn between(&self, values: &[f32], x: u32, y: u32) -> f32 {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_of_one_pixel_are_the_picture() {
        let squares = Squares::new(5, 3, 10);
        let values: Vec<f32> = (0..15u8).map(|i| f32::from(i * i)).collect();
        assert_eq!(squares.side, 1);
        assert_eq!(squares.means(&values), values);
        assert_eq!(squares.largest(&values), values);
        for (i, value) in (0..).zip(&values) {
            assert_eq!(squares.between(&values, i % 5, i / 5), *value);
        }
    }

    #[test]
    fn a_square_has_the_largest_of_its_pixels() {
        let (width, height) = (20, 3);
        let squares = Squares::new(width, height, 10);
        assert_eq!((squares.side, squares.columns, squares.rows), (2, 10, 2));
        let mut values = vec![0.0; (width * height) as usize];
        values[(2 * width + 5) as usize] = 0.5;
        let largest = squares.largest(&values);
        assert_eq!(largest[12], 0.5);
        assert_eq!(largest.iter().sum::<f32>(), 0.5);
    }

    #[test]
    fn squares_cover_a_picture_that_they_do_not_fit() {
        // 3 x 2 squares, the last ones cut off.
        let squares = Squares::of_side(9, 6, 4);
        assert_eq!(squares.closer(2).len(), 15);
        assert_eq!(squares.closer(8).len(), 54);
        let middles: Vec<_> = (0..squares.len()).map(|i| squares.middle(i)).collect();
        assert_eq!(middles, [(2, 2), (6, 2), (8, 2), (2, 5), (6, 5), (8, 5)]);
        for (i, (x, y)) in middles.into_iter().enumerate() {
            assert_eq!(squares.of(x, y), i);
            assert!(squares.pixels_of(i).all(|(x, y)| squares.of(x, y) == i));
            let numbers = squares.pixels_of(i).map(|(x, y)| y * 9 + x);
            let marked: Vec<bool> = (0..squares.len()).map(|j| j == i).collect();
            assert!(squares.pixels(&marked).iter().eq(numbers));
        }
        assert_eq!(squares.pixels_of(2).count(), 4);
        assert_eq!(squares.pixels(&[true; 6]).len(), 54);
        assert!(squares.pixels(&[false; 6]).is_empty());
    }
}
