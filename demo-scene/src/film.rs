//! From samples to 8-bit pictures: reconstruction filter, tone curve, sensor noise.

use glam::DVec2;

use crate::noise::Rng;

/// What one camera ray saw, linear.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    /// Photo, plate with the target's shadow, plate without: RGB each.
    pub(crate) layers: [[f32; 3]; 3],
    /// 1 when the first thing met is the target.
    pub(crate) target: f32,
    /// Position inside its pixel, in `[0, 1)`.
    pub(crate) x: f32,
    pub(crate) y: f32,
}

/// Filter radius in pixels: samples of the eight neighbours count too.
const RADIUS: f32 = 1.2;

/// A developed pixel: three RGB layers and coverage, still linear.
pub(crate) type Developed = ([[f32; 3]; 3], f32);

/// Weighted mean of the samples around pixel `(x, y)`; `samples` holds `per_pixel` consecutive
/// ones for each pixel, row by row.
pub(crate) fn gather(
    samples: &[Sample],
    per_pixel: usize,
    size: (usize, usize),
    (x, y): (usize, usize),
) -> Developed {
    let (mut layers, mut coverage, mut total) = ([[0.0_f32; 3]; 3], 0.0_f32, 0.0_f32);
    for row in y.saturating_sub(1)..(y + 2).min(size.1) {
        for column in x.saturating_sub(1)..(x + 2).min(size.0) {
            let first = (row * size.0 + column) * per_pixel;
            for sample in &samples[first..first + per_pixel] {
                let dx = column as f32 + sample.x - (x as f32 + 0.5);
                let dy = row as f32 + sample.y - (y as f32 + 0.5);
                let fall = 1.0 - (dx * dx + dy * dy) / (RADIUS * RADIUS);
                if fall <= 0.0 {
                    continue;
                }
                let weight = fall * fall;
                total += weight;
                coverage += weight * sample.target;
                for (sum, layer) in layers.iter_mut().zip(&sample.layers) {
                    for (sum, value) in sum.iter_mut().zip(layer) {
                        *sum += weight * value;
                    }
                }
            }
        }
    }
    let scale = 1.0 / total.max(1e-6);
    for value in layers.iter_mut().flatten() {
        *value *= scale;
    }
    (layers, (coverage * scale).clamp(0.0, 1.0))
}

/// Filmic tone curve followed by the sRGB curve, tabulated over `[0, SHOULDER]`.
pub(crate) struct ToneCurve(Vec<f32>);

/// Linear value that the curve maps to (almost) white.
const SHOULDER: f32 = 8.0;
const TABLE: usize = 4096;

impl ToneCurve {
    pub(crate) fn new() -> Self {
        let curve = |i: usize| {
            // The table is quadratic in its index: fine where the curve is steep.
            let s = i as f64 / TABLE as f64;
            let x = 0.62 * f64::from(SHOULDER) * s * s;
            // Narkowicz's fit of the ACES reference curve.
            let film = (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0);
            let srgb = if film <= 0.003_130_8 {
                12.92 * film
            } else {
                1.055 * libm::pow(film, 1.0 / 2.4) - 0.055
            };
            srgb as f32
        };
        Self((0..=TABLE).map(curve).collect())
    }

    /// Display value in `[0, 1]`.
    pub(crate) fn apply(&self, linear: f32) -> f32 {
        let s = (linear.clamp(0.0, SHOULDER) / SHOULDER).sqrt() * TABLE as f32;
        let i = (s as usize).min(TABLE - 1);
        let f = s - i as f32;
        self.0[i] + (self.0[i + 1] - self.0[i]) * f
    }
}

/// Deviation of the sensor noise in 8-bit steps at a display value: shot noise over a floor.
fn noise_deviation(display: f32) -> f64 {
    0.8 + 0.9 * f64::from(display * (1.0 - 0.5 * display))
}

/// Rounds to 8 bits, with sensor noise from `noise` if given.
pub(crate) fn quantise(display: f32, noise: Option<&mut Rng>) -> u8 {
    let grain = noise.map_or(0.0, |rng| rng.normal() * noise_deviation(display));
    (f64::from(display) * 255.0 + grain + 0.5).clamp(0.0, 255.0) as u8
}

/// Stratified position of sample `index` of `count` in its pixel: a lattice that fills the square
/// evenly for any count, shifted per pixel.
pub(crate) fn jitter(index: usize, count: usize, shift: DVec2) -> DVec2 {
    // Fractions of the plastic number; the first `count` points are well spread.
    let first = (index as f64 + 0.5) / count as f64;
    let second = index as f64 * 0.569_840_290_998_053_3;
    let p = DVec2::new(first, second) + shift;
    p - p.floor()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tone_curve_rises_from_black_to_white() {
        let curve = ToneCurve::new();
        assert_eq!(curve.apply(0.0), 0.0);
        assert!(curve.apply(8.0) > 0.97);
        let rising =
            (1..800).all(|i| curve.apply(i as f32 * 0.01) >= curve.apply((i - 1) as f32 * 0.01));
        assert!(rising);
    }

    #[test]
    fn a_constant_picture_stays_constant() {
        let sample = |x, y| Sample {
            layers: [[0.25; 3]; 3],
            target: 1.0,
            x,
            y,
        };
        let samples: Vec<_> = (0..18)
            .map(|i| sample((i % 5) as f32 * 0.19, (i % 7) as f32 * 0.13))
            .collect();
        for pixel in [(0, 0), (1, 1), (2, 2)] {
            let (layers, coverage) = gather(&samples, 2, (3, 3), pixel);
            assert!((coverage - 1.0).abs() < 1e-6);
            assert!(layers.iter().flatten().all(|v| (v - 0.25).abs() < 1e-6));
        }
    }
}
