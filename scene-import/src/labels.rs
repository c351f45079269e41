//! Pictures whose pixels are numbers of objects, grey or with a palette.

use crate::error::ImportError;
use image::{DynamicImage, GrayImage, Luma};
use io_colmap::Place;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// A picture of labels, row-major.
#[derive(Debug)]
pub(crate) struct Labels {
    width: u32,
    height: u32,
    values: Vec<u16>,
}

impl Labels {
    pub(crate) fn read(path: &Path) -> Result<Labels, ImportError> {
        let reader = image::ImageReader::open(path)
            .and_then(image::ImageReader::with_guessed_format)
            .map_err(|e| ImportError::io("read", path, e))?;
        if reader.format() == Some(image::ImageFormat::Png) {
            return png_labels(path);
        }
        match reader.decode() {
            Ok(DynamicImage::ImageLuma8(grey)) if !is_jpeg(path) => Ok(Labels {
                width: grey.width(),
                height: grey.height(),
                values: grey.iter().map(|v| u16::from(*v)).collect(),
            }),
            Ok(DynamicImage::ImageLuma16(grey)) => Ok(Labels {
                width: grey.width(),
                height: grey.height(),
                values: grey.into_raw(),
            }),
            Ok(_) => Err(no_labels(path, "its colours are no labels")),
            Err(e) => Err(no_labels(path, format!("it cannot be decoded ({e})"))),
        }
    }

    /// Width and height.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// White where the label is, black elsewhere.
    pub(crate) fn mask(&self, label: u32) -> GrayImage {
        GrayImage::from_fn(self.width, self.height, |x, y| {
            let i = y as usize * self.width as usize + x as usize;
            Luma([if u32::from(self.values[i]) == label {
                255
            } else {
                0
            }])
        })
    }

    /// All labels in the picture.
    pub(crate) fn all(&self) -> BTreeSet<u16> {
        self.values.iter().copied().collect()
    }
}

fn no_labels(path: &Path, what: impl Into<String>) -> ImportError {
    ImportError::Content {
        path: path.to_path_buf(),
        place: Place::File,
        what: what.into(),
        remedy: "labels must be a grey or palette PNG (or a grey TIFF); leave --label out for plain masks"
            .to_owned(),
    }
}

fn is_jpeg(path: &Path) -> bool {
    path.extension().is_some_and(|e| {
        ["jpg", "jpeg"]
            .iter()
            .any(|jpeg| e.eq_ignore_ascii_case(jpeg))
    })
}

/// The numbers in the file, where `image` would give a palette's colours.
fn png_labels(path: &Path) -> Result<Labels, ImportError> {
    let fail = |e: png::DecodingError| no_labels(path, format!("it cannot be decoded ({e})"));
    let file = File::open(path).map_err(|e| ImportError::io("read", path, e))?;
    let mut decoder = png::Decoder::new(BufReader::new(file));
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(fail)?;
    let size = reader
        .output_buffer_size()
        .filter(|size| *size <= 1 << 30)
        .ok_or_else(|| no_labels(path, "it is larger than any photo"))?;
    let mut bytes = vec![0; size];
    let info = reader.next_frame(&mut bytes).map_err(fail)?;
    let channels = match info.color_type {
        png::ColorType::Grayscale | png::ColorType::Indexed => 1,
        png::ColorType::GrayscaleAlpha => 2,
        png::ColorType::Rgb => 3,
        png::ColorType::Rgba => 4,
    };
    let bits = info.bit_depth as usize;
    let columns = info.width as usize * channels;
    let mut values = Vec::with_capacity(info.width as usize * info.height as usize);
    for row in bytes
        .chunks_exact(info.line_size)
        .take(info.height as usize)
    {
        let at = |i: usize| -> u16 {
            match bits {
                16 => u16::from_be_bytes([row[2 * i], row[2 * i + 1]]),
                8 => u16::from(row[i]),
                // Several to a byte, the first in the highest bits.
                _ => {
                    let byte = row[i * bits / 8];
                    let shift = 8 - bits - i * bits % 8;
                    u16::from(byte >> shift) & ((1 << bits) - 1)
                }
            }
        };
        for first in (0..columns).step_by(channels) {
            // Some tools write grey as three equal channels.
            if channels >= 3 && (at(first) != at(first + 1) || at(first) != at(first + 2)) {
                return Err(no_labels(path, "its colours are no labels"));
            }
            values.push(at(first));
        }
    }
    Ok(Labels {
        width: info.width,
        height: info.height,
        values,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn write(path: &Path, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) {
        let mut encoder = png::Encoder::new(File::create(path).unwrap(), 3, 2);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == png::ColorType::Indexed {
            encoder.set_palette(vec![0, 0, 0, 255, 0, 0, 0, 255, 0, 9, 9, 9]);
        }
        encoder
            .write_header()
            .unwrap()
            .write_image_data(data)
            .unwrap();
    }

    #[test]
    fn labels_of_every_depth_are_the_numbers_in_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        use png::{BitDepth, ColorType};
        let cases: [(ColorType, BitDepth, &[u8]); 5] = [
            (ColorType::Indexed, BitDepth::Eight, &[0, 1, 2, 2, 3, 0]),
            (
                ColorType::Indexed,
                BitDepth::Two,
                &[0b0001_1000, 0b1011_0000],
            ),
            (
                ColorType::Grayscale,
                BitDepth::Four,
                &[0x01, 0x20, 0x23, 0x00],
            ),
            (
                ColorType::Grayscale,
                BitDepth::Sixteen,
                &[0, 0, 0, 1, 0, 2, 0, 2, 0, 3, 0, 0],
            ),
            (
                ColorType::Rgb,
                BitDepth::Eight,
                &[0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 3, 3, 3, 0, 0, 0],
            ),
        ];
        for (colour, depth, data) in cases {
            write(&path, colour, depth, data);
            let labels = Labels::read(&path).unwrap();
            assert_eq!(labels.values, [0, 1, 2, 2, 3, 0], "{colour:?} {depth:?}");
            assert_eq!(labels.all().into_iter().collect::<Vec<_>>(), [0, 1, 2, 3]);
            assert_eq!(labels.mask(2).into_raw(), [0, 0, 255, 255, 0, 0]);
        }
        write(
            &path,
            ColorType::Rgb,
            BitDepth::Eight,
            &[7; 17]
                .map(|v: u8| v)
                .iter()
                .copied()
                .chain([8])
                .collect::<Vec<_>>(),
        );
        assert!(
            Labels::read(&path)
                .unwrap_err()
                .to_string()
                .contains("no labels")
        );
        std::fs::write(&path, b"\x89PNG\r\n\x1a\nxxxx").unwrap();
        assert!(
            Labels::read(&path)
                .unwrap_err()
                .to_string()
                .contains("--label")
        );
    }
}
