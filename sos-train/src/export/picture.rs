//! PNG encoding. The crate `png` and not `image`, which cannot state the colour space or leave a
//! remark in the file.

use super::ExportError;
use crate::run_folder::RunFolder;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, SrgbRenderingIntent};
use scene_export::encoding_error;
use std::io::Write;
use std::path::Path;

/// What the numbers of a picture mean.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Colours: the file says sRGB.
    Colour,
    /// Measurements: the file claims no colour space.
    Data,
}

/// A picture ready to be encoded.
pub(super) struct Picture<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) kind: ColorType,
    pub(super) depth: BitDepth,
    pub(super) meaning: Meaning,
    /// For people who wonder what they have before them.
    pub(super) remark: &'a str,
    /// Rows from the top; 16-bit samples are big-endian.
    pub(super) bytes: &'a [u8],
}

impl Picture<'_> {
    pub(super) fn write(&self, run: &RunFolder, path: &Path) -> Result<(), ExportError> {
        Ok(run.write(path, |out| self.encode(out).map_err(encoding_error))?)
    }

    fn encode(&self, out: &mut impl Write) -> Result<(), EncodingError> {
        let mut encoder = Encoder::new(out, self.width, self.height);
        encoder.set_color(self.kind);
        encoder.set_depth(self.depth);
        encoder.set_compression(Compression::Fast);
        if self.meaning == Meaning::Colour {
            encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
        }
        encoder.add_text_chunk("Description".to_owned(), self.remark.to_owned())?;
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.bytes)?;
        writer.finish()
    }
}

/// 0..=1 as 0..=255; what is not a number is 0.
pub(crate) fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// 0..=1 as 0..=65535; what is not a number is 0.
pub(super) fn word(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0).round() as u16
}

/// Writes `preview.png` from sRGB bytes `[height][width][3]`.
///
/// # Errors
/// [`ExportError::Run`].
///
/// # Panics
/// If the number of bytes does not fit the size.
pub fn write_preview(
    run: &RunFolder,
    width: u32,
    height: u32,
    rgb: &[u8],
) -> Result<(), ExportError> {
    assert_eq!(
        rgb.len(),
        width as usize * height as usize * 3,
        "write_preview: argument rgb does not have {width} x {height} x 3 bytes"
    );
    Picture {
        width,
        height,
        kind: ColorType::Rgb,
        depth: BitDepth::Eight,
        meaning: Meaning::Colour,
        remark: "preview of a run in progress",
        bytes: rgb,
    }
    .write(run, &run.preview_path())
}
