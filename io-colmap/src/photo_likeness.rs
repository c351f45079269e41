//! Whether a picture that is given as a mask is a photo.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use image::{DynamicImage, GenericImageView as _};

use crate::error::ColmapError;
use crate::mask_files::MaskFiles;
use crate::mask_kind::MaskKind;
use crate::mask_pixels::{MaskPixels, decode};

/// Looked at are no more than this many pixels a side.
const GRID: u32 = 256;

/// Channels that differ by no more belong to something grey, which JPEG may have tinted a little.
const TINT: u8 = 24;

/// A picture with a smaller share of coloured pixels is a mask with a stain.
const COLOURED: f64 = 0.05;

/// Drawn masks, one colour a label, have no more colours than this, ...
const DRAWN_COLOURS: usize = 64;

/// ... apart from this share of their coloured pixels, for JPEG adds colours along edges.
const UNDRAWN: f64 = 0.1;

/// Of masks that are not read anyway, as many are looked at, here and there among them.
const LOOKED_AT: usize = 9;

impl MaskFiles {
    /// Refuses photos that were taken for masks: they bear the right names too, where the wrong folder was named. Looks
    /// into a few of the files of `dir`.
    ///
    /// # Errors
    /// [`ColmapError`] where most of them look like photos, or one cannot be decoded.
    pub fn refuse_photos(&self, dir: &Path) -> Result<(), ColmapError> {
        let kind = MaskKind::Masks;
        let paths: Vec<&PathBuf> = self.paths.iter().flatten().collect();
        let every = paths.len().div_ceil(LOOKED_AT).max(1);
        let looked_at = paths.into_iter().step_by(every).map(|path| {
            let picture = decode(path, kind)?;
            Ok((
                path,
                is_like_photo(&MaskPixels::of(&picture, false), &picture),
            ))
        });
        refuse_photos(dir, &looked_at.collect::<Result<Vec<_>, _>>()?, kind)
    }
}

/// Refuses the files of `place` if most of those looked at are like photos.
pub(crate) fn refuse_photos(
    place: &Path,
    looked_at: &[(&PathBuf, bool)],
    kind: MaskKind,
) -> Result<(), ColmapError> {
    let mut alike = looked_at.iter().filter(|(_, is_like_photo)| *is_like_photo);
    let count = alike.clone().count();
    match alike.next() {
        Some((first, _)) if 2 * count > looked_at.len() => Err(ColmapError::mask(
            place,
            format!(
                "{count} of the {} {} looked at are in many colours, such as {}, so they look like photos",
                looked_at.len(),
                kind.many(),
                first.display()
            ),
            kind.remedy_for_photos(),
        )),
        _ => Ok(()),
    }
}

/// Whether a mask is one of the colours of a photo: cut-outs, whose alpha counts, are not.
pub(crate) fn is_like_photo(pixels: &MaskPixels, picture: &DynamicImage) -> bool {
    !pixels.is_alpha() && is_in_many_colours(picture)
}

/// Masks are grey, or drawn in a few.
pub(crate) fn is_in_many_colours(picture: &DynamicImage) -> bool {
    if !picture.color().has_color() {
        return false;
    }
    let grid = |length: u32| (0..length).step_by(length.div_ceil(GRID).max(1) as usize);
    let (width, height) = picture.dimensions();
    let (mut samples, mut coloured) = (0_usize, 0_usize);
    let mut counts: HashMap<[u8; 3], usize> = HashMap::new();
    for y in grid(height) {
        for x in grid(width) {
            let [r, g, b, _] = picture.get_pixel(x, y).0;
            samples += 1;
            if r.max(g).max(b) - r.min(g).min(b) > TINT {
                coloured += 1;
                *counts.entry([r / 4, g / 4, b / 4]).or_default() += 1;
            }
        }
    }
    let mut counts: Vec<usize> = counts.into_values().collect();
    counts.sort_unstable_by(|a, b| b.cmp(a));
    let rest: usize = counts.iter().skip(DRAWN_COLOURS).sum();
    coloured as f64 > COLOURED * samples as f64 && rest as f64 > UNDRAWN * coloured as f64
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use image::{GrayImage, ImageFormat, Luma, Rgb, RgbImage};
    use std::io::Cursor;

    /// A scene in many colours, with a grey wall above.
    fn photo() -> RgbImage {
        RgbImage::from_fn(128, 96, |x, y| {
            Rgb(if y < 40 {
                [180, 182, 179]
            } else {
                [(90 + x) as u8, (2 * y) as u8, (x * y % 60) as u8]
            })
        })
    }

    fn as_jpeg(picture: &DynamicImage) -> DynamicImage {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
        image::load_from_memory(bytes.get_ref()).unwrap()
    }

    /// A disc in the middle, or one of several in a row.
    fn is_inside(x: u32, y: u32) -> bool {
        (x % 64).abs_diff(32).pow(2) + y.abs_diff(48).pow(2) < 24 * 24
    }

    #[test]
    fn photos_are_in_many_colours() {
        let picture = DynamicImage::from(photo());
        assert!(is_in_many_colours(&picture));
        assert!(is_in_many_colours(&as_jpeg(&picture)));
        assert!(is_in_many_colours(&picture.to_rgb16().into()));
        // Without colours they cannot be told from mattes.
        assert!(!is_in_many_colours(&picture.to_luma8().into()));
    }

    #[test]
    fn drawn_masks_are_not_photos() {
        let grey = GrayImage::from_fn(128, 96, |x, y| Luma([255 * u8::from(is_inside(x, y))]));
        let grey = DynamicImage::from(grey);
        let red = DynamicImage::from(RgbImage::from_fn(128, 96, |x, y| {
            Rgb([255 * u8::from(is_inside(x, y)), 0, 0])
        }));
        let labels = DynamicImage::from(RgbImage::from_fn(128, 96, |x, y| {
            let label = (x / 32 + 4 * (y / 24)) as u8;
            Rgb([61, 97, 13].map(|step| label.wrapping_mul(step)))
        }));
        for mask in [&grey.to_rgb8().into(), &red, &labels] {
            assert!(!is_in_many_colours(mask));
            assert!(!is_in_many_colours(&as_jpeg(mask)));
        }
    }
}
