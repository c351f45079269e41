//! A mask: yes or no for each of a view's pixels, one bit each.

use image::{GrayImage, Luma};
use scene_doctor::ObjectMask;

use super::error::PrepareError;
use super::pixels::{PixelBytes, PixelStore};

/// Grey values from here on are the object in a picture of a mask.
const OBJECT: u8 = 128;

/// A set of a picture's pixels. Clones share it.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    width: u32,
    height: u32,
    /// Row-major, the lowest bit of each byte first.
    bits: PixelBytes,
}

impl Mask {
    /// The pixels of a picture that are white: the object.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for it.
    pub fn of_white(picture: &GrayImage, store: &PixelStore) -> Result<Self, PrepareError> {
        Self::from_level(picture, OBJECT, store)
    }

    /// The pixels of a picture that are not entirely black.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for it.
    pub fn of_not_black(picture: &GrayImage, store: &PixelStore) -> Result<Self, PrepareError> {
        Self::from_level(picture, 1, store)
    }

    fn from_level(
        picture: &GrayImage,
        least: u8,
        store: &PixelStore,
    ) -> Result<Self, PrepareError> {
        let byte = |values: &[u8]| {
            values.iter().enumerate().fold(0, |byte, (bit, value)| {
                byte | (u8::from(*value >= least) << bit)
            })
        };
        let bits = picture.as_raw().chunks(8).map(byte).collect();
        Ok(Self {
            width: picture.width(),
            height: picture.height(),
            bits: store.keep(bits)?,
        })
    }

    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Whether a pixel belongs to it; none does that lies outside the picture.
    #[must_use]
    pub fn contains(&self, x: u32, y: u32) -> bool {
        x < self.width && y < self.height && self.bit(y as usize * self.width as usize + x as usize)
    }

    fn bit(&self, i: usize) -> bool {
        (self.bits[i / 8] >> (i % 8)) & 1 == 1
    }

    /// The answers of all pixels, row-major.
    pub fn answers(&self) -> impl Iterator<Item = bool> {
        (0..self.width as usize * self.height as usize).map(|i| self.bit(i))
    }

    /// How many pixels it has.
    #[must_use]
    pub fn area(&self) -> usize {
        self.bits
            .iter()
            .map(|byte| byte.count_ones() as usize)
            .sum()
    }

    /// Columns and rows of its pixels, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (u32, u32)> {
        let at = |i: usize| (i as u32 % self.width, i as u32 / self.width);
        let answers = self.answers().enumerate();
        answers
            .filter(|(_, inside)| *inside)
            .map(move |(i, _)| at(i))
    }

    /// White where it is, else black.
    #[must_use]
    pub fn picture(&self) -> GrayImage {
        GrayImage::from_fn(self.width, self.height, |x, y| {
            Luma([if self.contains(x, y) { u8::MAX } else { 0 }])
        })
    }

    /// Bytes that take room in memory for good.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        self.bits.in_memory()
    }
}

impl ObjectMask for Mask {
    fn is_object(&self, x: u32, y: u32) -> bool {
        self.contains(x, y)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn store() -> PixelStore {
        PixelStore::new(&std::env::temp_dir())
    }

    #[test]
    fn a_mask_is_the_white_of_its_picture() {
        // 35 pixels: the last byte is not full.
        let picture = GrayImage::from_fn(7, 5, |x, y| Luma([(40 * x + y) as u8]));
        let mask = Mask::of_white(&picture, &store()).unwrap();
        assert_eq!((mask.width(), mask.height(), mask.in_memory()), (7, 5, 5));
        for (x, y, value) in picture.enumerate_pixels() {
            assert_eq!(mask.contains(x, y), value.0[0] >= 128, "({x}, {y})");
        }
        assert!(!mask.contains(7, 0) && !mask.contains(6, 5));
        assert_eq!(mask.answers().count(), 35);
        let inside: Vec<(u32, u32)> = mask.pixels().collect();
        assert_eq!(mask.area(), inside.len());
        assert_eq!(
            inside.len(),
            mask.answers().filter(|inside| *inside).count()
        );
        assert!(inside.iter().all(|&(x, y)| mask.contains(x, y)));
        assert_eq!(Mask::of_white(&mask.picture(), &store()).unwrap(), mask);
    }

    #[test]
    fn what_is_not_black_counts_where_that_is_asked() {
        let picture = GrayImage::from_fn(3, 1, |x, _| Luma([x as u8]));
        let mask = Mask::of_not_black(&picture, &store()).unwrap();
        assert_eq!(mask.answers().collect::<Vec<_>>(), [false, true, true]);
        assert_eq!(
            Mask::of_white(&picture, &store()).unwrap().pixels().count(),
            0
        );
    }
}
