//! What is measured of each photo: sharpness and light.

use io_colmap::linear_from_srgb;
use scene_capture::Grey;

/// At most about this many pixels are looked at for light: shares and means need no more.
const SAMPLES: u32 = 40_000;
/// 8-bit values from which on a channel counts as blown out, and up to which as black.
const WHITE: u8 = 254;
const BLACK: u8 = 1;

/// Measures of one photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PhotoMeasures {
    /// Variance of the Laplacian of the photo scaled down to 640 pixels, over the square of its mean
    /// luma: half the light is a quarter of that variance.
    pub(crate) sharpness: f64,
    /// Share of the scaled photo's detail that outlasts a blur by one pixel, as 1 where it has none:
    /// [`Grey::softness`].
    pub(crate) softness: f64,
    /// Mean linear luminance, 0..1.
    pub(crate) luminance: f64,
    /// Share of pixels with all channels blown out.
    pub(crate) blown: f64,
    /// Share of pixels with all channels black.
    pub(crate) black: f64,
}

impl PhotoMeasures {
    /// Measures an 8-bit sRGB photo, `[height, width, 3]`.
    ///
    /// # Panics
    /// When it has another number of bytes.
    pub(crate) fn of(photo: &[u8], width: u32, height: u32) -> Self {
        let pixels = photo.as_chunks::<3>().0;
        assert_eq!(
            pixels.len(),
            width as usize * height as usize,
            "PhotoMeasures::of: number of pixels"
        );
        let grey = Grey::of_rgb(photo, width as usize, height as usize);
        let step = (f64::from(width) * f64::from(height) / f64::from(SAMPLES))
            .sqrt()
            .ceil()
            .max(1.0) as usize;
        let (mut count, mut light, mut blown, mut black) = (0u32, 0.0, 0u32, 0u32);
        for y in (0..height).step_by(step) {
            for x in (0..width).step_by(step) {
                let [r, g, b] = pixels[(y * width + x) as usize];
                count += 1;
                let linear = [r, g, b].map(linear_from_srgb);
                light += 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
                blown += u32::from(r.min(g).min(b) >= WHITE);
                black += u32::from(r.max(g).max(b) <= BLACK);
            }
        }
        let n = f64::from(count.max(1));
        Self {
            sharpness: grey.sharpness() / grey.mean().max(1.0).powi(2),
            softness: grey.softness(),
            luminance: light / n,
            blown: f64::from(blown) / n,
            black: f64::from(black) / n,
        }
    }
}
