//! PNG encoding. The crate `png` and not `image`, which cannot state the colour space or leave a
//! remark in the file.

use super::ExportError;
use crate::run_folder::RunFolder;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, SrgbRenderingIntent};
use std::io::{self, Write};
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
        Ok(run.write(path, |out| self.encode(out).map_err(io_error))?)
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

/// What the operating system said, with its kind, by which the remedy is chosen and which `png`'s own conversion drops.
fn io_error(error: EncodingError) -> io::Error {
    match error {
        EncodingError::IoError(error) => error,
        other => other.into(),
    }
}

/// 0..=1 as 0..=255; what is not a number is 0.
pub(super) fn byte(value: f32) -> u8 {
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_stays_a_full_disk() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let picture = Picture {
            width: 1,
            height: 1,
            kind: ColorType::Grayscale,
            depth: BitDepth::Eight,
            meaning: Meaning::Data,
            remark: "",
            bytes: &[7],
        };
        let error = picture.encode(&mut Full).map_err(io_error).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    }
}
