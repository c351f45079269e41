//! Squares of a photo's pixels, of which the middle is looked at for all.

use crate::cells::neighbours;
use crate::prepare::TrainView;
use crate::prepare::spans::PixelSpans;

/// Squares of a view's pixels, row by row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Raster {
    /// Pixels along a side.
    stride: u32,
    columns: u32,
    rows: u32,
    width: u32,
    height: u32,
}

impl Raster {
    /// Squares of `stride` pixels a side, at least one.
    pub(super) fn of(view: &TrainView, stride: u32) -> Self {
        Self::over((view.width(), view.height()), stride)
    }

    fn over((width, height): (u32, u32), stride: u32) -> Self {
        let stride = stride.max(1);
        Self {
            stride,
            columns: width.div_ceil(stride),
            rows: height.div_ceil(stride),
            width,
            height,
        }
    }

    /// The same pixels in squares of which so many are as long as one of these, at least of one pixel.
    pub(super) fn closer(&self, times: u32) -> Self {
        Self::over((self.width, self.height), self.stride / times)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        (self.columns * self.rows) as usize
    }

    /// The pixel in the middle of square number `i`.
    pub(super) fn middle(&self, i: usize) -> (u32, u32) {
        let middle = |v: u32, size: u32| (v * self.stride + self.stride / 2).min(size - 1);
        let (column, row) = (i as u32 % self.columns, i as u32 / self.columns);
        (middle(column, self.width), middle(row, self.height))
    }

    /// The number of the square that a pixel is in.
    pub(super) fn square(&self, (x, y): (u32, u32)) -> usize {
        (y / self.stride * self.columns + x / self.stride) as usize
    }

    /// The squares of which `holds` is said, as of those beside them.
    pub(super) fn well_inside(&self, holds: &[bool]) -> Vec<bool> {
        let beside = |i| neighbours(i, self.columns as usize, self.len());
        let all = |i: usize| holds[i] && beside(i).all(|j| j.is_none_or(|j| holds[j]));
        (0..self.len()).map(all).collect()
    }

    /// The squares of which `holds` is said, but for what is less than three of them wide, or a corner.
    pub(super) fn opened(&self, holds: &[bool]) -> Vec<bool> {
        let inside = self.well_inside(holds);
        let beside = |i| neighbours(i, self.columns as usize, self.len());
        let any = |i: usize| inside[i] || beside(i).any(|j| j.is_some_and(|j| inside[j]));
        (0..self.len()).map(any).collect()
    }

    /// The pixels of squares.
    pub(super) fn pixels(&self, squares: &[bool]) -> PixelSpans {
        let mut pixels = PixelSpans::default();
        if !squares.contains(&true) {
            return pixels;
        }
        for pixel in 0..self.width * self.height {
            if squares[self.square((pixel % self.width, pixel / self.width))] {
                pixels.push(pixel);
            }
        }
        pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_cover_a_picture_that_they_do_not_fit() {
        // 3 x 2 squares, the last ones cut off.
        let raster = Raster::over((9, 6), 4);
        assert_eq!(raster.closer(2).len(), 15);
        assert_eq!(raster.closer(8).len(), 54);
        let middles: Vec<_> = (0..raster.len()).map(|i| raster.middle(i)).collect();
        assert_eq!(middles, [(2, 2), (6, 2), (8, 2), (2, 5), (6, 5), (8, 5)]);
        assert!((0..raster.len()).all(|i| raster.square(raster.middle(i)) == i));
        let last = raster.pixels(&[false, false, true, false, false, false]);
        assert_eq!(last.iter().collect::<Vec<_>>(), [8, 17, 26, 35]);
        let all = raster.pixels(&[true; 6]);
        assert_eq!(all.len(), 54);
        assert!(raster.pixels(&[false; 6]).is_empty());
        let inside = raster.well_inside(&[true, true, true, true, true, false]);
        assert_eq!(inside, [true, true, false, true, false, false]);
    }

    #[test]
    fn opening_leaves_out_what_is_thin() {
        // A block of 3 x 3 squares, of which the corners are thin, and a line beside it.
        let raster = Raster::over((8, 5), 1);
        let block = |i: usize| (1..4).contains(&(i % 8)) && (1..4).contains(&(i / 8));
        let corner = |i: usize| i % 8 != 2 && i / 8 != 2;
        let line = |i: usize| i % 8 == 6;
        let holds: Vec<bool> = (0..40).map(|i| block(i) || line(i)).collect();
        let opened = raster.opened(&holds);
        let thick = (0..40).map(|i| block(i) && !corner(i));
        assert_eq!(opened, thick.collect::<Vec<_>>());
    }
}
