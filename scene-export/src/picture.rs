//! Pictures: mattes and cut-outs in memory, PNG files that say what they hold.
//!
//! The crate `png` and not `image`, which cannot state the colour space or leave a remark in the file.

use crate::draft::Draft;
use crate::error::ExportError;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, SrgbRenderingIntent};
use std::io::{self, Write};

/// From this value of 65535 on, a pixel is the object's.
pub(crate) const HALF: u16 = 1 << 15;

/// Coverage by the object, `[height * width]`, rows from the top, 0..=65535.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Matte {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) values: Vec<u16>,
}

/// A matte with the object's own colours, sRGB, straight.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Cutout {
    pub(crate) alpha: Matte,
    pub(crate) colours: Vec<[u8; 3]>,
}

impl Matte {
    /// One byte a pixel: `inside` where the object covers at least half of it, else `outside`.
    pub(crate) fn binary(&self, inside: u8, outside: u8) -> Vec<u8> {
        let byte = |value: &u16| if *value >= HALF { inside } else { outside };
        self.values.iter().map(byte).collect()
    }

    /// Where the object covers at least half of a pixel, in a sixteenth of the memory.
    pub(crate) fn silhouette(&self) -> Silhouette {
        let word = |values: &[u16]| {
            let bits = values.iter().enumerate();
            bits.fold(0, |word, (bit, value)| {
                word | u64::from(*value >= HALF) << bit
            })
        };
        Silhouette {
            width: self.width,
            height: self.height,
            words: self.values.chunks(64).map(word).collect(),
        }
    }
}

/// Which pixels are the object's, a bit each: there may be hundreds of large ones at once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Silhouette {
    width: u32,
    height: u32,
    words: Vec<u64>,
}

impl Silhouette {
    /// Whether a point lies in a pixel that is the object's; `None` outside the picture.
    pub(crate) fn holds(&self, x: f64, y: f64) -> Option<bool> {
        let inside =
            x >= 0.0 && y >= 0.0 && x < f64::from(self.width) && y < f64::from(self.height);
        inside.then(|| {
            let at = y as usize * self.width as usize + x as usize;
            self.words[at / 64] >> (at % 64) & 1 == 1
        })
    }
}

/// 0..=65535 as 0..=255, rounded.
pub(crate) fn byte(word: u16) -> u8 {
    ((u32::from(word) + 128) / 257) as u8
}

/// A colour, with which the file says sRGB, or a measurement, with which it claims no colour space.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// One channel, a measurement.
    Grey,
    /// sRGB.
    Rgb,
    /// sRGB and alpha.
    Rgba,
}

/// An 8-bit picture ready to be encoded, rows from the top.
#[derive(Debug)]
pub struct Picture<'a> {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// What a pixel holds.
    pub kind: Kind,
    /// For people who wonder what they have before them.
    pub remark: &'a str,
    /// `[height * width * channels]`.
    pub bytes: &'a [u8],
}

impl Picture<'_> {
    /// Writes a PNG file into a folder in the making.
    ///
    /// # Errors
    /// [`ExportError::Io`].
    pub fn write(&self, draft: &Draft, name: &str) -> Result<(), ExportError> {
        draft.write(name, |out| self.encode(out).map_err(encoding_error))
    }

    fn encode(&self, out: &mut impl Write) -> Result<(), EncodingError> {
        let mut encoder = Encoder::new(out, self.width, self.height);
        encoder.set_color(match self.kind {
            Kind::Grey => ColorType::Grayscale,
            Kind::Rgb => ColorType::Rgb,
            Kind::Rgba => ColorType::Rgba,
        });
        encoder.set_depth(BitDepth::Eight);
        encoder.set_compression(Compression::Fast);
        if self.kind != Kind::Grey {
            encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
        }
        encoder.add_text_chunk("Description".to_owned(), self.remark.to_owned())?;
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.bytes)?;
        writer.finish()
    }
}

/// What the operating system said, with its kind, by which a remedy is chosen and which `png`'s own conversion drops.
#[must_use]
pub fn encoding_error(error: EncodingError) -> io::Error {
    match error {
        EncodingError::IoError(error) => error,
        other => other.into(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_rounded() {
        assert_eq!((byte(0), byte(65535), byte(257)), (0, 255, 1));
        for value in 0..=u16::MAX {
            let exact = (f64::from(value) / 257.0).round();
            assert_eq!(f64::from(byte(value)), exact, "{value}");
        }
    }

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
            kind: Kind::Grey,
            remark: "",
            bytes: &[7],
        };
        let error = picture
            .encode(&mut Full)
            .map_err(encoding_error)
            .unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    }

    #[test]
    fn points_fall_into_pixels() {
        let matte = Matte {
            width: 2,
            height: 1,
            values: vec![HALF - 1, HALF],
        };
        assert_eq!(matte.binary(255, 0), [0, 255]);
        let silhouette = matte.silhouette();
        assert_eq!(silhouette.holds(0.99, 0.5), Some(false));
        assert_eq!(silhouette.holds(1.0, 0.5), Some(true));
        for (x, y) in [(2.0, 0.5), (-0.1, 0.5), (0.5, 1.0), (f64::NAN, 0.5)] {
            assert_eq!(silhouette.holds(x, y), None);
        }
        let (width, height) = (50, 3);
        let values: Vec<u16> = (0..width * height)
            .map(|i| if i % 7 < 3 { HALF } else { HALF - 1 })
            .collect();
        let matte = Matte {
            width: width as u32,
            height: height as u32,
            values,
        };
        let silhouette = matte.silhouette();
        for i in 0..width * height {
            let at = [i % width, i / width].map(|v| v as f64 + 0.5);
            assert_eq!(silhouette.holds(at[0], at[1]), Some(i % 7 < 3), "{i}");
        }
    }
}
