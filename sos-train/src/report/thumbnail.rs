//! Small pictures inside the page.

use super::ReportError;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{DynamicImage, GrayImage, ImageEncoder as _, Rgb, RgbImage, RgbaImage, imageops};
use std::path::Path;

/// Visibly good, and about 20 kB for 480 by 320 pixels.
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
pub(crate) fn open(path: &Path) -> Result<DynamicImage, ReportError> {
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
pub(super) fn photo(picture: &DynamicImage, room: u32) -> Thumbnail {
    jpeg(&shrink_rgb(&picture.to_rgb8(), room))
}

/// A matte or mask, without loss: its edges are what one looks at.
pub(super) fn matte(picture: &GrayImage, room: u32) -> Thumbnail {
    let (w, h) = fitted(picture.dimensions(), room);
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

/// A measurement in colours from black over violet and orange to light yellow: what is little stays
/// dark, and greys keep their order where colours cannot be told apart.
pub(super) fn heat(picture: &GrayImage, room: u32) -> Thumbnail {
    const STOPS: [[f32; 3]; 5] = [
        [10.0, 10.0, 18.0],
        [84.0, 24.0, 110.0],
        [188.0, 55.0, 84.0],
        [246.0, 140.0, 32.0],
        [252.0, 250.0, 180.0],
    ];
    let (w, h) = fitted(picture.dimensions(), room);
    let small = imageops::thumbnail(picture, w, h);
    jpeg(&RgbImage::from_fn(w, h, |x, y| {
        let at = f32::from(small.get_pixel(x, y).0[0]) / 255.0 * (STOPS.len() - 1) as f32;
        let first = (at as usize).min(STOPS.len() - 2);
        let share = at - first as f32;
        Rgb([0, 1, 2].map(|c| {
            (STOPS[first][c] + share * (STOPS[first + 1][c] - STOPS[first][c])).round() as u8
        }))
    }))
}

/// What a matte changed about a mask, over the greyed photo: blue is the object now and was not,
/// orange was and is not any more. All three pictures have one size.
pub(super) fn change(
    photo: &RgbImage,
    mask: &GrayImage,
    matte: &GrayImage,
    room: u32,
) -> Thumbnail {
    const ADDED: [f32; 3] = [40.0, 130.0, 255.0];
    const REMOVED: [f32; 3] = [255.0, 120.0, 20.0];
    const KEPT: f32 = 0.85;
    const REST: f32 = 0.4;
    let (w, h) = fitted(photo.dimensions(), room);
    let photo = imageops::thumbnail(photo, w, h);
    let [mask, matte] = [mask, matte].map(|grey| imageops::thumbnail(grey, w, h));
    jpeg(&RgbImage::from_fn(w, h, |x, y| {
        let [r, g, b] = photo.get_pixel(x, y).0.map(f32::from);
        let grey = 0.299 * r + 0.587 * g + 0.114 * b;
        let [was, is] = [&mask, &matte].map(|p| f32::from(p.get_pixel(x, y).0[0]) / 255.0);
        let shown = grey * (REST + (KEPT - REST) * is.max(was));
        let (tint, share) = if is > was {
            (ADDED, is - was)
        } else {
            (REMOVED, was - is)
        };
        Rgb(tint.map(|t| {
            (shown + 0.75 * share * (t - shown))
                .round()
                .clamp(0.0, 255.0) as u8
        }))
    }))
}

/// A cut-out with straight alpha, over a checkerboard.
pub(super) fn cut_out(picture: &DynamicImage, room: u32) -> Thumbnail {
    let mut full = picture.to_rgba8();
    for pixel in full.pixels_mut() {
        let alpha = u32::from(pixel.0[3]);
        for channel in &mut pixel.0[..3] {
            *channel = ((u32::from(*channel) * alpha + 127) / 255) as u8;
        }
    }
    let (w, h) = fitted(full.dimensions(), room);
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

fn shrink_rgb(picture: &RgbImage, room: u32) -> RgbImage {
    let (w, h) = fitted(picture.dimensions(), room);
    if (w, h) == picture.dimensions() {
        picture.clone()
    } else {
        imageops::thumbnail(picture, w, h)
    }
}

/// The size at no more than about `room` pixels; never larger than the picture.
fn fitted((w, h): (u32, u32), room: u32) -> (u32, u32) {
    let scale = (f64::from(room) / (f64::from(w) * f64::from(h)).max(1.0)).sqrt();
    [w, h]
        .map(|side| (f64::from(side) * scale.min(1.0)).round().max(1.0) as u32)
        .into()
}

fn jpeg(picture: &RgbImage) -> Thumbnail {
    embed(
        "jpeg",
        &jpeg_bytes(picture),
        picture.width(),
        picture.height(),
    )
}

/// A picture as a JPEG file.
pub(crate) fn jpeg_bytes(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Writing to memory cannot fail.
    let _ = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(picture);
    bytes
}

fn embed(kind: &str, bytes: &[u8], width: u32, height: u32) -> Thumbnail {
    Thumbnail {
        uri: format!("data:image/{kind};base64,{}", STANDARD.encode(bytes)),
        width,
        height,
    }
}
