//! Small pictures inside the page.

use super::ReportError;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{DynamicImage, GrayImage, ImageEncoder as _, Rgb, RgbImage, RgbaImage, imageops};
use std::path::Path;

/// Visibly good, and about 20 kB for 480 pixels.
const JPEG_QUALITY: u8 = 82;
/// Edge of a square of the checkerboard, in pixels of the thumbnail.
const CHECKER: u32 = 8;
/// Neither so light nor so dark that a white or a black object is lost in it.
const CHECKER_GREYS: [f32; 2] = [178.0, 146.0];

/// A picture ready for `src="…"`, with its size.
#[derive(Debug, Clone)]
pub(super) struct Thumbnail {
    pub(super) uri: String,
    pub(super) width: u32,
    pub(super) height: u32,
}

/// Reads a picture of any kind.
pub(super) fn open(path: &Path) -> Result<DynamicImage, ReportError> {
    // The content decides, not the ending: phones name things as they like.
    image::ImageReader::open(path)
        .and_then(image::ImageReader::with_guessed_format)
        .map_err(image::ImageError::IoError)
        .and_then(image::ImageReader::decode)
        .map_err(|e| ReportError::Picture {
            path: path.to_path_buf(),
            reason: e
                .to_string()
                .split_whitespace()
                .collect::<Vec<_>>()
                .join(" "),
        })
}

/// A photograph.
pub(super) fn photo(picture: &DynamicImage, width: u32) -> Thumbnail {
    jpeg(&shrink_rgb(&picture.to_rgb8(), width))
}

/// A matte or mask, without loss: its edges are what one looks at.
pub(super) fn matte(picture: &GrayImage, width: u32) -> Thumbnail {
    let (w, h) = fitted(picture.dimensions(), width);
    let small = if (w, h) == picture.dimensions() {
        picture.clone()
    } else {
        imageops::thumbnail(picture, w, h)
    };
    let mut bytes = Vec::new();
    // Writing to memory cannot fail for a picture whose size fits its content.
    let _ =
        PngEncoder::new(&mut bytes).write_image(small.as_raw(), w, h, image::ExtendedColorType::L8);
    embed("png", &bytes, w, h)
}

/// A cut-out with straight alpha, over a checkerboard.
pub(super) fn cut_out(picture: &DynamicImage, width: u32) -> Thumbnail {
    let mut full = picture.to_rgba8();
    for pixel in full.pixels_mut() {
        let alpha = u32::from(pixel.0[3]);
        for channel in &mut pixel.0[..3] {
            *channel = ((u32::from(*channel) * alpha + 127) / 255) as u8;
        }
    }
    let (w, h) = fitted(full.dimensions(), width);
    let small: RgbaImage = if (w, h) == full.dimensions() {
        full
    } else {
        imageops::thumbnail(&full, w, h)
    };
    jpeg(&RgbImage::from_fn(w, h, |x, y| {
        let [r, g, b, a] = small.get_pixel(x, y).0.map(f32::from);
        let grey = CHECKER_GREYS[((x / CHECKER + y / CHECKER) % 2) as usize];
        // Premultiplied by now.
        Rgb([r, g, b].map(|c| (c + grey * (1.0 - a / 255.0)).round().clamp(0.0, 255.0) as u8))
    }))
}

fn shrink_rgb(picture: &RgbImage, width: u32) -> RgbImage {
    let (w, h) = fitted(picture.dimensions(), width);
    if (w, h) == picture.dimensions() {
        picture.clone()
    } else {
        imageops::thumbnail(picture, w, h)
    }
}

/// The size at no more than `width`; never larger than the picture.
fn fitted((w, h): (u32, u32), width: u32) -> (u32, u32) {
    if w <= width {
        return (w.max(1), h.max(1));
    }
    let height = (f64::from(h) * f64::from(width) / f64::from(w)).round() as u32;
    (width, height.max(1))
}

fn jpeg(picture: &RgbImage) -> Thumbnail {
    let mut bytes = Vec::new();
    // As above.
    let _ = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(picture);
    embed("jpeg", &bytes, picture.width(), picture.height())
}

fn embed(kind: &str, bytes: &[u8], width: u32, height: u32) -> Thumbnail {
    Thumbnail {
        uri: format!("data:image/{kind};base64,{}", STANDARD.encode(bytes)),
        width,
        height,
    }
}
