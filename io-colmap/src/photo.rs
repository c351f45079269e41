//! Photo files: their size, which way up they are, and their colours in 8 bits.

use crate::error::ColmapError;
use crate::scene::same_shape;
use crate::srgb::srgb_from_linear;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::path::Path;

/// A share of light below this is no alpha in 8 bits.
const LEAST_ALPHA: f32 = 0.5 / 255.0;

/// Pixels of no photo take more memory than this; a header that says so is damaged, or lies.
const MOST_BYTES: u64 = 4 << 30;

/// What a photo's header tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhotoHeader {
    /// Width and height of the pixels as they are stored.
    pub stored: (u32, u32),
    /// How a viewer turns or mirrors them (EXIF).
    pub orientation: Orientation,
    /// Whether there is an alpha channel.
    pub has_alpha: bool,
}

impl PhotoHeader {
    /// Reads a header, not the pixels.
    ///
    /// # Errors
    /// [`ColmapError::Scene`] for files that are missing or no pictures.
    pub fn read(path: &Path) -> Result<PhotoHeader, ColmapError> {
        let (mut decoder, _) = decoder(path)?;
        Ok(PhotoHeader {
            stored: decoder.dimensions(),
            orientation: orientation(&mut decoder),
            has_alpha: decoder.color_type().has_alpha(),
        })
    }

    /// Width and height as a viewer shows the photo.
    #[must_use]
    pub fn upright(&self) -> (u32, u32) {
        let (w, h) = self.stored;
        if is_sideways(self.orientation) {
            (h, w)
        } else {
            (w, h)
        }
    }

    /// Whether a camera of this size was made from the photo turned upright, and not as stored.
    ///
    /// COLMAP and most others read pixels as they are stored; where the shape says that a tool
    /// turned them first, so must we. A photo that is upside down has the shape of one that is not:
    /// such are taken as stored.
    #[must_use]
    pub fn is_turned_for(&self, camera: (u32, u32)) -> bool {
        !same_shape(self.stored, camera)
            && is_sideways(self.orientation)
            && same_shape(self.upright(), camera)
    }
}

/// Reads a photo for a camera of that size, turned upright if the camera is (see
/// [`PhotoHeader::is_turned_for`]). Its own resolution is kept. Alpha is straight, also where OpenEXR has it premultiplied.
///
/// # Errors
/// [`ColmapError::Scene`] for files that are missing or no pictures.
pub fn read_photo(path: &Path, camera: (u32, u32)) -> Result<DynamicImage, ColmapError> {
    let (mut decoder, format) = decoder(path)?;
    let header = PhotoHeader {
        stored: decoder.dimensions(),
        orientation: orientation(&mut decoder),
        has_alpha: decoder.color_type().has_alpha(),
    };
    let mut photo = decode_photo(path, decoder)?;
    if header.is_turned_for(camera) {
        photo.apply_orientation(header.orientation);
    }
    Ok(match photo {
        // Floating point formats (EXR) hold linear light; everything here is sRGB.
        DynamicImage::ImageRgb32F(mut linear) => {
            linear.iter_mut().for_each(|v| *v = srgb_from_linear(*v));
            DynamicImage::ImageRgb8(DynamicImage::ImageRgb32F(linear).into_rgb8())
        }
        DynamicImage::ImageRgba32F(mut linear) => {
            // The format says so; of others nothing is known.
            let premultiplied = format == Some(ImageFormat::OpenExr);
            for pixel in linear.pixels_mut() {
                if premultiplied {
                    pixel.0 = straight(pixel.0);
                }
                let [colour @ .., alpha] = &mut pixel.0;
                // No number is black and clear, where a rounded one would be white and opaque.
                *alpha = if alpha.is_nan() { 0.0 } else { *alpha };
                colour.iter_mut().for_each(|v| *v = srgb_from_linear(*v));
            }
            DynamicImage::ImageRgba8(DynamicImage::ImageRgba32F(linear).into_rgba8())
        }
        other => other,
    })
}

/// Decodes a photo's pixels, unless they would take more memory than any photo's.
///
/// # Errors
/// [`ColmapError::Scene`] for those, and for files that are damaged.
pub fn decode_photo(path: &Path, decoder: impl ImageDecoder) -> Result<DynamicImage, ColmapError> {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MOST_BYTES);
    if limits.reserve(decoder.total_bytes()).is_err() {
        let (width, height) = decoder.dimensions();
        return Err(ColmapError::scene(
            path,
            format!("the file says that it is {width}x{height}, which is larger than any photo"),
            "copy or convert it again, or take it away",
        ));
    }
    DynamicImage::from_decoder(decoder).map_err(|e| unreadable(path, &e))
}

/// With the format. The content decides on it, not the ending: phones name things as they like.
fn decoder(path: &Path) -> Result<(impl ImageDecoder, Option<ImageFormat>), ColmapError> {
    let reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|e| ColmapError::io("read", path, e))?;
    let format = reader.format();
    let decoder = reader.into_decoder().map_err(|e| unreadable(path, &e))?;
    Ok((decoder, format))
}

fn unreadable(path: &Path, error: &image::ImageError) -> ColmapError {
    ColmapError::scene(
        path,
        format!("the photo cannot be read ({error})"),
        "it must be a PNG, JPEG, WebP, TIFF or EXR file; copy or convert it again",
    )
}

/// Damaged metadata is no reason to refuse a photo.
fn orientation(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(Orientation::NoTransforms)
}

fn is_sideways(orientation: Orientation) -> bool {
    matches!(
        orientation,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    )
}

/// A pixel whose colour is light times alpha, with the light's own colour. Light without any alpha is a glow, and
/// stays.
fn straight([r, g, b, alpha]: [f32; 4]) -> [f32; 4] {
    let [r, g, b] = if alpha >= LEAST_ALPHA {
        [r, g, b].map(|v| v / alpha)
    } else if alpha > 0.0 {
        // Its rounded alpha will say that nothing is there; a colour would make it another backdrop than its neighbours'.
        [0.0; 3]
    } else {
        [r, g, b]
    };
    [r, g, b, alpha]
}

/// Endings of the files that are looked at as pictures, in small letters.
pub const PICTURE_ENDINGS: [&str; 7] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "exr"];

/// Whether a file's name ends like a picture's.
#[must_use]
pub fn is_picture(name: &str) -> bool {
    name.rsplit_once('.')
        .is_some_and(|(_, ending)| PICTURE_ENDINGS.contains(&&*ending.to_ascii_lowercase()))
}
