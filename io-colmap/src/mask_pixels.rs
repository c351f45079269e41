//! The numbers in a mask file, and how they become black and white.

use crate::error::ColmapError;
use crate::mask_kind::MaskKind;
use crate::masks::GreyImage;
use crate::photo_likeness::is_in_many_colours;
use image::{DynamicImage, ImageBuffer, Luma};
use std::path::Path;

/// How the numbers in a folder's files become black and white: alike in all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reading {
    /// White is the largest number that a file has room for.
    Full,
    /// White is 255, also in files of 16 bits: some tools store 8-bit masks, or labels, in them without rescaling.
    Bytes,
    /// 0 and 1 are black and white.
    Labels,
}

impl Reading {
    pub(crate) const ALL: [Reading; 3] = [Reading::Full, Reading::Bytes, Reading::Labels];

    /// `is_wide` says whether the number is of a file of 16 bits.
    pub(crate) fn byte(self, value: u16, is_wide: bool) -> u8 {
        match self {
            Reading::Full if is_wide => eight_bits(value),
            Reading::Full | Reading::Bytes => value.min(255) as u8,
            Reading::Labels if value > 0 => 255,
            Reading::Labels => 0,
        }
    }
}

/// The numbers in a file.
#[derive(Debug)]
pub(crate) enum MaskPixels {
    /// An alpha channel.
    Alpha(GreyImage),
    /// The brightness, where it has 8 bits.
    Narrow(GreyImage),
    /// The same with 16 bits.
    Wide(ImageBuffer<Luma<u16>, Vec<u16>>),
}

impl MaskPixels {
    /// The alpha channel of an `image` where that differs from place to place, else its brightness. In a folder `of_cutouts`
    /// a photo's alpha is taken that is the same everywhere, too: its object is out of view, or fills it.
    pub(crate) fn of(image: &DynamicImage, of_cutouts: bool) -> MaskPixels {
        if image.color().has_alpha() {
            let alpha = image.to_rgba16();
            let first = alpha.pixels().next().map(|p| p.0[3]);
            let differs = || alpha.pixels().any(|p| Some(p.0[3]) != first);
            if differs() || (of_cutouts && is_in_many_colours(image)) {
                return MaskPixels::Alpha(GreyImage::from_fn(
                    alpha.width(),
                    alpha.height(),
                    |x, y| Luma([eight_bits(alpha.get_pixel(x, y).0[3])]),
                ));
            }
        }
        if image.color().bytes_per_pixel() / image.color().channel_count() == 1 {
            MaskPixels::Narrow(image.to_luma8())
        } else {
            MaskPixels::Wide(image.to_luma16())
        }
    }

    pub(crate) fn is_alpha(&self) -> bool {
        matches!(self, MaskPixels::Alpha(_))
    }

    pub(crate) fn size(&self) -> (u32, u32) {
        match self {
            MaskPixels::Alpha(grey) | MaskPixels::Narrow(grey) => grey.dimensions(),
            MaskPixels::Wide(wide) => wide.dimensions(),
        }
    }

    pub(crate) fn is_wide(&self) -> bool {
        matches!(self, MaskPixels::Wide(_))
    }

    pub(crate) fn largest(&self) -> u16 {
        let largest = match self {
            MaskPixels::Alpha(grey) | MaskPixels::Narrow(grey) => {
                grey.iter().max().copied().map(u16::from)
            }
            MaskPixels::Wide(wide) => wide.iter().max().copied(),
        };
        largest.unwrap_or(0)
    }

    /// A pixel in black and white.
    pub(crate) fn byte(&self, x: u32, y: u32, reading: Reading) -> u8 {
        let value = match self {
            MaskPixels::Alpha(grey) | MaskPixels::Narrow(grey) => {
                u16::from(grey.get_pixel(x, y).0[0])
            }
            MaskPixels::Wide(wide) => wide.get_pixel(x, y).0[0],
        };
        reading.byte(value, self.is_wide())
    }

    /// The same where no other file helps to tell how they are meant.
    fn into_grey_alone(self) -> GreyImage {
        let reading = match self.largest() {
            0 | 1 | 255 => Reading::Bytes,
            _ => Reading::Full,
        };
        self.into_grey(reading)
    }

    /// All of them in black and white.
    pub(crate) fn into_grey(self, reading: Reading) -> GreyImage {
        match self {
            MaskPixels::Alpha(grey) | MaskPixels::Narrow(grey) if reading != Reading::Labels => {
                grey
            }
            other => {
                let (width, height) = other.size();
                GreyImage::from_fn(width, height, |x, y| Luma([other.byte(x, y, reading)]))
            }
        }
    }
}

/// A mask file as it is, whatever its polarity: its alpha where that says something, else its brightness.
///
/// What was stored in 16 bits without rescaling keeps its values: masks of 255, and the labels 0 and 1. What is as dark
/// throughout, but neither, is a matte with next to nothing in it, for all that one file can tell.
///
/// # Errors
/// [`ColmapError`] if the file cannot be read or decoded.
pub fn read_mask(path: &Path) -> Result<GreyImage, ColmapError> {
    Ok(MaskPixels::of(&decode(path, MaskKind::Masks)?, false).into_grey_alone())
}

pub(crate) fn decode(path: &Path, kind: MaskKind) -> Result<DynamicImage, ColmapError> {
    image::ImageReader::open(path)
        .and_then(image::ImageReader::with_guessed_format)
        .map_err(|e| ColmapError::io("read", path, e))?
        .decode()
        .map_err(|e| {
            ColmapError::mask(
                path,
                format!("the {} cannot be decoded ({e})", kind.one()),
                "it must be a PNG, JPEG, WebP or TIFF file; export it again",
            )
        })
}

fn eight_bits(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wide(values: [u16; 2]) -> MaskPixels {
        MaskPixels::Wide(ImageBuffer::from_fn(2, 1, |x, _| {
            Luma([values[x as usize]])
        }))
    }

    #[test]
    fn sixteen_bits_are_scaled_unless_they_hold_bytes_or_labels() {
        let read = |values, reading| wide(values).into_grey(reading).into_raw();
        assert_eq!(read([257, 65535], Reading::Full), [1, 255]);
        assert_eq!(read([2, 255], Reading::Bytes), [2, 255]);
        assert_eq!(read([0, 1], Reading::Labels), [0, 255]);
        let narrow = |reading| {
            let grey = GreyImage::from_fn(2, 1, |x, _| Luma([x as u8]));
            MaskPixels::Narrow(grey).into_grey(reading).into_raw()
        };
        assert_eq!(narrow(Reading::Full), [0, 1]);
        assert_eq!(narrow(Reading::Bytes), [0, 1]);
        assert_eq!(narrow(Reading::Labels), [0, 255]);
        assert_eq!(wide([3, 300]).largest(), 300);
        let alone = |values| wide(values).into_grey_alone().into_raw();
        assert_eq!(alone([0, 1]), [0, 1]);
        assert_eq!(alone([0, 255]), [0, 255]);
        // Noise of a matte with nothing in it.
        assert_eq!(alone([0, 200]), [0, 1]);
        assert_eq!(alone([0, 65535]), [0, 255]);
    }
}
