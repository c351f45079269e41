//! How sharp a picture is, and how much changed since another.
//!
//! The measure is the variance of the Laplacian: a blurred edge has a small second derivative. It
//! is taken of a picture scaled down by averaging: blur of a pixel or two at full size is noise of
//! sensor and compression, which would outweigh the edges. What the picture shows matters more for
//! its value than how sharp it is; so only pictures of the same view, taken within a moment, are
//! compared, and there is no threshold.

/// The longer side is scaled down to no more than this, in pixels.
const LONGER_SIDE: usize = 640;
/// Pictures are compared for changes at this size, where noise has averaged out.
const THUMBNAIL: usize = 64;
/// The share of a picture that may have changed without counting. A thing on a turntable is in
/// more than that.
const MAY_CHANGE: f64 = 0.02;
/// A larger change in the rest, of 255, means that something moved: on the edges of usual
/// pictures, the camera by a quarter of a thumbnail's pixel. Noise stays well below.
const MOVED: f32 = 3.0;

/// A grey picture with values 0..255.
#[derive(Debug, Clone, PartialEq)]
pub struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Grey {
    /// Of 8-bit RGB `[height, width, 3]`, averaged over blocks so that it is no larger than needed.
    #[must_use]
    pub fn of_rgb(rgb: &[u8], width: usize, height: usize) -> Grey {
        let luma = |pixel: &[u8]| {
            // Rec. 601, which is precise enough for this.
            0.299 * f32::from(pixel[0]) + 0.587 * f32::from(pixel[1]) + 0.114 * f32::from(pixel[2])
        };
        let side = width.max(height).div_ceil(LONGER_SIDE).max(1);
        average(width, height, side, |x, y| {
            luma(&rgb[3 * (y * width + x)..][..3])
        })
    }

    /// Variance of the Laplacian: the higher, the sharper.
    #[must_use]
    pub fn sharpness(&self) -> f64 {
        let (w, v) = (self.width, &self.values);
        let (mut count, mut sum, mut squares) = (0_u64, 0.0, 0.0);
        for y in 1..self.height.saturating_sub(1) {
            for x in 1..w.saturating_sub(1) {
                let i = y * w + x;
                let laplacian = f64::from(v[i - 1] + v[i + 1] + v[i - w] + v[i + w] - 4.0 * v[i]);
                count += 1;
                sum += laplacian;
                squares += laplacian * laplacian;
            }
        }
        if count == 0 {
            return 0.0;
        }
        let mean = sum / count as f64;
        squares / count as f64 - mean * mean
    }

    /// The share of differences between neighbours that outlasts a blur by one pixel: what is sharp
    /// loses much, what is blurred already next to nothing. 1 for a plain picture.
    ///
    /// It depends less on what a picture shows than [`Grey::sharpness`] does: on pictures of some 640
    /// pixels 0.4 to 0.87 where they are sharp, above 0.9 with a blur of a pixel or more.
    #[must_use]
    pub fn softness(&self) -> f64 {
        let blurred = self.turned_and_blurred().turned_and_blurred();
        let before = self.roughness();
        if before > 0.0 {
            blurred.roughness() / before
        } else {
            1.0
        }
    }

    /// Sum of absolute differences between neighbours.
    fn roughness(&self) -> f64 {
        let (w, v) = (self.width.max(1), &self.values);
        let step = |i: usize, j: usize| {
            v.get(j)
                .map_or(0.0, |other| f64::from((other - v[i]).abs()))
        };
        (0..v.len())
            .map(|i| {
                let across = if (i + 1) % w > 0 { step(i, i + 1) } else { 0.0 };
                across + step(i, i + w)
            })
            .sum()
    }

    /// Rows become columns, each blurred by a binomial with a deviation of one pixel; edges go on.
    fn turned_and_blurred(&self) -> Grey {
        const WEIGHTS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
        let (w, h) = (self.width, self.height);
        let mut values = vec![0.0; w * h];
        for (i, value) in values.iter_mut().enumerate() {
            let (x, y) = (i / h, i % h);
            for (k, weight) in WEIGHTS.iter().enumerate() {
                let near = (x + k).saturating_sub(2).min(w - 1);
                *value += weight * self.values[y * w + near];
            }
        }
        Grey {
            width: h,
            height: w,
            values,
        }
    }

    /// Mean of the values; sharpness grows with its square.
    #[must_use]
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.values.iter().map(|v| f64::from(*v)).sum();
        sum / self.values.len().max(1) as f64
    }

    pub(crate) fn thumbnail(&self) -> Grey {
        let side = self.width.max(self.height).div_ceil(THUMBNAIL).max(1);
        average(self.width, self.height, side, |x, y| {
            self.values[y * self.width + x]
        })
    }

    /// Whether this thumbnail shows something else than the other.
    pub(crate) fn differs_from(&self, other: &Grey) -> bool {
        if (self.width, self.height) != (other.width, other.height) {
            return true;
        }
        let changed = self
            .values
            .iter()
            .zip(&other.values)
            .filter(|(a, b)| (**a - **b).abs() > MOVED)
            .count();
        changed as f64 > MAY_CHANGE * self.values.len() as f64
    }
}

/// Means over blocks of `side` by `side` pixels; what is left over at the far edges is dropped.
fn average(width: usize, height: usize, side: usize, value: impl Fn(usize, usize) -> f32) -> Grey {
    let (w, h) = (width / side, height / side);
    let mut values = vec![0.0; w * h];
    for (i, mean) in values.iter_mut().enumerate() {
        let (left, top) = (i % w * side, i / w * side);
        for y in top..top + side {
            for x in left..left + side {
                *mean += value(x, y);
            }
        }
        *mean /= (side * side) as f32;
    }
    Grey {
        width: w,
        height: h,
        values,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vertical stripes whose edges are `blur` pixels wide, moved by `shift`.
    fn stripes(width: usize, height: usize, blur: f32, shift: f32) -> Vec<u8> {
        (0..width * height)
            .flat_map(|i| {
                let phase = ((i % width) as f32 + shift) / 40.0 * std::f32::consts::TAU;
                let value = 127.0 + 100.0 * (phase.sin() * 40.0 / blur).clamp(-1.0, 1.0);
                [value as u8; 3]
            })
            .collect()
    }

    fn sharpness(blur: f32) -> f64 {
        Grey::of_rgb(&stripes(800, 200, blur, 0.0), 800, 200).sharpness()
    }

    #[test]
    fn blur_lowers_sharpness() {
        let [sharp, soft, blurred] = [2.0, 16.0, 64.0].map(sharpness);
        assert!(sharp > 1.5 * soft, "{sharp} {soft}");
        assert!(soft > 1.5 * blurred, "{soft} {blurred}");
        let plain = Grey::of_rgb(&[80; 300], 10, 10);
        assert_eq!((plain.sharpness(), plain.mean()), (0.0, 80.0));
        assert_eq!(plain.softness(), 1.0);
        // Half the light.
        let bright = stripes(800, 200, 16.0, 0.0);
        let dark: Vec<u8> = bright.iter().map(|v| v / 2).collect();
        let [bright, dark] = [bright, dark].map(|rgb| Grey::of_rgb(&rgb, 800, 200));
        let relative = |grey: &Grey| grey.sharpness() / grey.mean().powi(2);
        assert!((relative(&dark) / relative(&bright) - 1.0).abs() < 0.1);
        assert!(dark.sharpness() < 0.3 * bright.sharpness());
    }

    #[test]
    fn softness_tells_blur_whatever_the_picture_shows() {
        // Rubble, and the same blurred again and again.
        let rubble: Vec<u8> = (0..64 * 48_u64)
            .flat_map(|i| [(i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8; 3])
            .collect();
        let mut grey = Grey::of_rgb(&rubble, 64, 48);
        let mut before = grey.softness();
        assert!(before < 0.5, "{before}");
        for _ in 0..16 {
            grey = grey.turned_and_blurred().turned_and_blurred();
            let softness = grey.softness();
            assert!(softness > before, "{softness} {before}");
            before = softness;
        }
        assert!(before > 0.9, "{before}");
    }

    #[test]
    fn small_and_odd_pictures_are_no_trouble() {
        for (width, height) in [(0, 0), (1, 1), (2, 9), (641, 3), (3, 641)] {
            let grey = Grey::of_rgb(&vec![9; 3 * width * height], width, height);
            assert!(grey.sharpness().is_finite(), "{width} {height}");
            assert!(grey.softness().is_finite(), "{width} {height}");
            assert!(!grey.thumbnail().differs_from(&grey.thumbnail()));
        }
        assert_eq!(Grey::of_rgb(&vec![9; 3 * 1300 * 4], 1300, 4).width, 433);
    }

    #[test]
    fn a_camera_that_moves_is_told_from_noise() {
        let thumbnail = |shift, noise: u8| {
            let mut rgb = stripes(640, 360, 20.0, shift);
            for (i, value) in rgb.iter_mut().enumerate() {
                // A value per pixel without a pattern.
                let dice = (i as u64 / 3).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 60;
                *value = value.saturating_add(dice as u8 % (noise + 1));
            }
            Grey::of_rgb(&rgb, 640, 360).thumbnail()
        };
        let first = thumbnail(0.0, 0);
        assert!(!thumbnail(0.0, 4).differs_from(&first));
        assert!(thumbnail(4.0, 0).differs_from(&first));
    }
}
