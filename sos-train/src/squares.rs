//! Large pictures in squares of pixels.
//!
//! What has a width in pixels, such as the blur of an outline, is wider in larger photos: they are soft. So widths are those of
//! squares, of which a picture has about as many as a small photo has pixels.

use image::Rgb;

use crate::prepare::pixels::Photo;

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

/// Squares of a picture's pixels.
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
        let side = width.max(height).div_ceil(longest).max(1);
        Self {
            side,
            width,
            height,
            columns: width.div_ceil(side),
            rows: height.div_ceil(side),
        }
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
    pub(crate) fn means(&self, values: &[f32]) -> Vec<f32> {
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

    /// The largest value in each square.
    pub(crate) fn largest(&self, values: &[f32]) -> Vec<f32> {
        let mut largest = vec![f32::NEG_INFINITY; (self.columns * self.rows) as usize];
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
}
