//! Pictures in memory: planes of alpha, masks, colours; and how they are read from files.
//!
//! Row-major, `width * height` values, pixel `(x, y)` at `y * width + x`. Values lie in 0..=1,
//! alpha is straight, colours are as stored (gamma encoded).

use crate::EvalError;
use image::{ColorType, DynamicImage, ImageReader, Limits};
use std::path::Path;

/// One channel, `[height, width]`, values in 0..=1.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values, row by row.
    pub values: Vec<f32>,
}

impl Plane {
    /// A plane from its values, row by row.
    ///
    /// # Panics
    /// If there are not `width * height` values.
    pub fn new(width: usize, height: usize, values: Vec<f32>) -> Self {
        assert_eq!(
            values.len(),
            width * height,
            "Plane::new: {width}x{height} pixels need as many values"
        );
        Self {
            width,
            height,
            values,
        }
    }

    /// A plane computed pixel by pixel from `(x, y)`.
    pub fn from_fn(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Self {
        let values = (0..width * height)
            .map(|i| value(i % width, i / width))
            .collect();
        Self {
            width,
            height,
            values,
        }
    }

    /// A plane of zeros: the matte that finds nothing.
    pub fn empty(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            values: vec![0.0; width * height],
        }
    }

    /// Pixels with `value >= threshold`.
    pub fn mask(&self, threshold: f32) -> Mask {
        Mask {
            width: self.width,
            height: self.height,
            inside: self.values.iter().map(|&v| v >= threshold).collect(),
        }
    }
}

/// A set of pixels, `[height, width]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` flags, row by row.
    pub inside: Vec<bool>,
}

impl Mask {
    /// Number of pixels in the set.
    pub fn count(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }
}

/// Three channels, `[height, width, 3]`, values in 0..=1.
#[derive(Debug, Clone, PartialEq)]
pub struct RgbPlane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` colours, row by row.
    pub values: Vec<[f32; 3]>,
}

impl RgbPlane {
    /// A picture from its colours, row by row.
    ///
    /// # Panics
    /// If there are not `width * height` colours.
    pub fn new(width: usize, height: usize, values: Vec<[f32; 3]>) -> Self {
        assert_eq!(
            values.len(),
            width * height,
            "RgbPlane::new: {width}x{height} pixels need as many colours"
        );
        Self {
            width,
            height,
            values,
        }
    }

    /// A picture computed pixel by pixel from `(x, y)`.
    pub fn from_fn(width: usize, height: usize, colour: impl Fn(usize, usize) -> [f32; 3]) -> Self {
        let values = (0..width * height)
            .map(|i| colour(i % width, i / width))
            .collect();
        Self {
            width,
            height,
            values,
        }
    }
}

/// Anything with a width and a height, for the check that two of them fit.
pub(crate) trait Sized2d {
    fn size(&self) -> (usize, usize);
}

macro_rules! sized {
    ($($name:ty),*) => {$(
        impl Sized2d for $name {
            fn size(&self) -> (usize, usize) {
                (self.width, self.height)
            }
        }
    )*};
}
sized!(Plane, Mask, RgbPlane);

/// Panics, naming the operation and both sizes: unequal sizes here are the caller's bug; files
/// are checked before, with an [`EvalError`].
#[track_caller]
pub(crate) fn assert_same_size(op: &str, a: &impl Sized2d, b: &impl Sized2d) {
    let ((aw, ah), (bw, bh)) = (a.size(), b.size());
    assert!(
        (aw, ah) == (bw, bh),
        "{op}: pictures of {aw}x{ah} and {bw}x{bh} pixels"
    );
}

/// As large as a photo may be: the limit of the `image` crate is below a cut-out of 150 megapixels.
const MOST_BYTES: u64 = 4 << 30;

/// Opens a picture of any format.
pub(crate) fn open(path: &Path) -> Result<DynamicImage, EvalError> {
    let fail = |reason: String| EvalError::Picture {
        path: path.to_owned(),
        reason,
    };
    let mut reader = ImageReader::open(path)
        .and_then(|r| r.with_guessed_format())
        .map_err(|e| fail(e.to_string()))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    reader.decode().map_err(|e| fail(e.to_string()))
}

/// Reads an alpha matte or mask: the alpha channel if the file has one that is not opaque
/// everywhere, else the luma, unless it is in colour. 8 or 16 bits per channel.
///
/// # Errors
/// [`EvalError`] if it cannot be read, or is in colour.
pub fn read_alpha(path: &Path) -> Result<Plane, EvalError> {
    Plane::alpha_of(open(path)?, path)
}

impl Plane {
    /// The same of an open picture; `path` is for errors.
    pub(crate) fn alpha_of(picture: DynamicImage, path: &Path) -> Result<Self, EvalError> {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let unit = |v: u16| f32::from(v) / 65535.0;
        if picture.color().has_alpha() {
            let values: Vec<f32> = picture.to_rgba16().pixels().map(|p| unit(p.0[3])).collect();
            if values.iter().any(|&a| a < 1.0) {
                return Ok(Self::new(width, height, values));
            }
        }
        if picture.color().has_color() && is_colourful(&picture.to_rgb8()) {
            return Err(EvalError::NoMatte {
                path: path.to_owned(),
            });
        }
        let luma = picture.into_luma16().into_raw();
        Ok(Self::new(
            width,
            height,
            luma.into_iter().map(unit).collect(),
        ))
    }
}

/// The numbers in a grey picture.
pub(crate) struct Grey {
    /// The largest of them.
    pub(crate) largest: u16,
    /// Whether there are 16 bits for each.
    pub(crate) wide: bool,
}

impl Grey {
    /// Of a picture; `None` where alpha says more than its grey, or where numbers are fractions.
    pub(crate) fn range(picture: &DynamicImage) -> Option<Self> {
        if picture.color().has_alpha() && picture.to_rgba16().pixels().any(|p| p.0[3] < u16::MAX) {
            return None;
        }
        let wide = Self::is_wide(picture);
        let largest = if wide {
            picture.to_luma16().into_raw().into_iter().max()
        } else if picture.color().bytes_per_pixel() == picture.color().channel_count() {
            let bytes = picture.to_luma8().into_raw();
            bytes.into_iter().max().map(u16::from)
        } else {
            None
        };
        Some(Self {
            largest: largest?,
            wide,
        })
    }

    /// Whether a picture has whole numbers of 16 bits.
    pub(crate) fn is_wide(picture: &DynamicImage) -> bool {
        matches!(
            picture.color(),
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16
        )
    }
}

/// Whether a picture is a photo or a coloured drawing, not something grey in three channels, which JPEG may have
/// tinted a little.
fn is_colourful(picture: &image::RgbImage) -> bool {
    const TINT: u8 = 24;
    let coloured = |pixel: &&image::Rgb<u8>| {
        let [r, g, b] = pixel.0;
        r.max(g).max(b) - r.min(g).min(b) > TINT
    };
    let count = picture.pixels().filter(coloured).count();
    50 * count > picture.pixels().len()
}

/// Reads a picture's colours, as stored; an alpha channel is ignored.
pub fn read_rgb(path: &Path) -> Result<RgbPlane, EvalError> {
    let picture = open(path)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let values = picture
        .into_rgb16()
        .pixels()
        .map(|p| p.0.map(|v| f32::from(v) / 65535.0))
        .collect();
    Ok(RgbPlane {
        width,
        height,
        values,
    })
}

/// Reads a map of whole numbers from a grey picture, one per pixel, and tells which reach `least`.
pub(crate) fn read_counts_at_least(path: &Path, least: u8) -> Result<Mask, EvalError> {
    let picture = open(path)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let inside = match picture {
        DynamicImage::ImageLuma16(counts) => counts
            .into_raw()
            .into_iter()
            .map(|n| n >= u16::from(least))
            .collect(),
        other => other
            .into_luma8()
            .into_raw()
            .into_iter()
            .map(|n| n >= least)
            .collect(),
    };
    Ok(Mask {
        width,
        height,
        inside,
    })
}
