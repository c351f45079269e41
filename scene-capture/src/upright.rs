//! Photos the way up that people see them, in the pixels themselves.
//!
//! Phones store what the sensor saw and note how to turn it (EXIF). COLMAP reads pixels as they are stored, so that
//! mattes and plates would lie on their sides beside the photos, and a pixel that someone points at would be another.

use crate::error::CaptureError;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageEncoder, ImageFormat, ImageReader};
use io_colmap::{decode_photo, picture_error};
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// Of JPEG files that are written: their losses are below those of the photo.
const QUALITY: u8 = 97;

/// Writes a photo turned as its EXIF says, with the rest of the EXIF, in its own format. `false`, and nothing is
/// written, where no turned file of this format can be.
pub(crate) fn write(photo: &Path, to: &Path) -> Result<bool, CaptureError> {
    let unreadable = |e: image::ImageError| {
        CaptureError::bad(
            photo,
            format!("the photo cannot be read ({e})"),
            "copy or convert it again, or take it away",
        )
    };
    let reader = ImageReader::open(photo)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|e| CaptureError::io("read", photo, e))?;
    let format = reader.format();
    if !matches!(format, Some(ImageFormat::Jpeg | ImageFormat::Png)) {
        return Ok(false);
    }
    let mut decoder = reader.into_decoder().map_err(unreadable)?;
    // Focal length, lens and position are there; damaged metadata is no reason to refuse a photo.
    let mut exif = decoder.exif_metadata().ok().flatten();
    let profile = decoder.icc_profile().ok().flatten();
    let orientation = exif
        .as_mut()
        .and_then(|chunk| Orientation::remove_from_exif_chunk(chunk))
        .unwrap_or(Orientation::NoTransforms);
    let mut picture = decode_photo(photo, decoder)?;
    picture.apply_orientation(orientation);

    let file = File::create(to).map_err(|e| CaptureError::io("create", to, e))?;
    let mut out = BufWriter::new(file);
    let written = if format == Some(ImageFormat::Jpeg) {
        encode(
            JpegEncoder::new_with_quality(&mut out, QUALITY),
            &picture,
            exif,
            profile,
        )
    } else {
        encode(PngEncoder::new(&mut out), &picture, exif, profile)
    };
    written
        .map_err(picture_error)
        .and_then(|()| out.flush())
        .map_err(|e| CaptureError::io("write", to, e))?;
    Ok(true)
}

fn encode(
    mut encoder: impl ImageEncoder,
    picture: &DynamicImage,
    exif: Option<Vec<u8>>,
    profile: Option<Vec<u8>>,
) -> image::ImageResult<()> {
    // What a format has no place for is left out.
    if let Some(exif) = exif {
        let _ = encoder.set_exif_metadata(exif);
    }
    if let Some(profile) = profile {
        let _ = encoder.set_icc_profile(profile);
    }
    picture.write_with_encoder(encoder)
}
