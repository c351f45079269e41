//! Errors of alpha mattes as in the matting benchmark (Rhemann et al., "A perceptually motivated
//! online benchmark for image matting", CVPR 2009), over the whole picture instead of a trimap's
//! unknown region. `a` is the predicted alpha, `a*` the true one, both `[height, width]`.

use crate::filter::{Border, separable};
use crate::picture::{Plane, assert_same_size};

/// Standard deviation of the Gaussian in [`gradient_error`], pixels.
pub const GRADIENT_SIGMA: f64 = 1.4;
/// Distance below which [`connectivity_error`] counts a pixel as fully connected.
pub const CONNECTIVITY_THETA: f64 = 0.15;

/// `SAD = sum |a - a*| / 1000`.
///
/// ```
/// use sos_eval::{Plane, sad};
/// let truth = Plane::empty(100, 100);
/// let pred = Plane::from_fn(100, 100, |_, _| 0.5);
/// assert_eq!(sad(&pred, &truth), 5.0);
/// ```
///
/// # Panics
/// If the sizes differ, as all functions here.
pub fn sad(pred: &Plane, truth: &Plane) -> f64 {
    assert_same_size("sad", pred, truth);
    differences(pred, truth).map(f64::abs).sum::<f64>() / 1000.0
}

/// `MSE = 1000 * mean (a - a*)^2`.
pub fn mse(pred: &Plane, truth: &Plane) -> f64 {
    assert_same_size("mse", pred, truth);
    let sum: f64 = differences(pred, truth).map(|d| d * d).sum();
    1000.0 * sum / truth.values.len().max(1) as f64
}

fn differences(pred: &Plane, truth: &Plane) -> impl Iterator<Item = f64> {
    pred.values
        .iter()
        .zip(&truth.values)
        .map(|(&p, &t)| f64::from(p) - f64::from(t))
}

/// `grad = sum (|∇a| - |∇a*|)^2 / 1000`, `∇` by first derivatives of a Gaussian of
/// [`GRADIENT_SIGMA`] pixels.
///
/// The 9x9 filters are scaled to unit energy (sum of squares 1) and see the nearest pixel beyond
/// the border, as in the Matlab code in common use; unlike there, alpha is not stretched
/// to 0..1 first, because a matte that is grey everywhere is an error too.
pub fn gradient_error(pred: &Plane, truth: &Plane) -> f64 {
    assert_same_size("gradient_error", pred, truth);
    let sum: f64 = gradient_magnitude(pred)
        .iter()
        .zip(&gradient_magnitude(truth))
        .map(|(p, t)| (p - t) * (p - t))
        .sum();
    sum / 1000.0
}

fn gradient_magnitude(alpha: &Plane) -> Vec<f64> {
    // Radius where the Gaussian falls below 0.01, as in the benchmark's code: 4 for sigma 1.4.
    let height_at_0 = 1.0 / (GRADIENT_SIGMA * (2.0 * std::f64::consts::PI).sqrt());
    let radius = (GRADIENT_SIGMA * (-2.0 * (0.01 / height_at_0).ln()).sqrt()).ceil() as i32;
    let gauss = |u: i32| (-0.5 * (f64::from(u) / GRADIENT_SIGMA).powi(2)).exp();
    let unit_energy = |taps: Vec<f64>| -> Vec<f64> {
        let norm = taps.iter().map(|t| t * t).sum::<f64>().sqrt();
        taps.into_iter().map(|t| t / norm).collect()
    };
    let smooth = unit_energy((-radius..=radius).map(gauss).collect());
    let derive = unit_energy(
        (-radius..=radius)
            .map(|u| f64::from(u) * gauss(u))
            .collect(),
    );

    let values: Vec<f64> = alpha.values.iter().map(|&v| f64::from(v)).collect();
    let size = (alpha.width, alpha.height);
    let dx = separable(&values, size, &derive, &smooth, Border::Replicate);
    let dy = separable(&values, size, &smooth, &derive, Border::Replicate);
    dx.iter().zip(&dy).map(|(x, y)| x.hypot(*y)).collect()
}

/// `conn = sum |phi(a) - phi(a*)| / 1000`: penalises pieces of the matte that hang loose.
///
/// With `Omega_t` the largest 4-connected component of `{a >= t and a* >= t}` for t = 0.1, 0.2 … 1,
/// `l` of a pixel is the last `t` up to which it has been in every `Omega_t` (0 if in none), and
/// `phi(a) = 1 - d` if `d = a - l >= theta` ([`CONNECTIVITY_THETA`]), else 1. Of components of equal
/// size the first in reading order is taken. NaN if a value is.
pub fn connectivity_error(pred: &Plane, truth: &Plane) -> f64 {
    assert_same_size("connectivity_error", pred, truth);
    let both: Vec<f32> = pred
        .values
        .iter()
        .zip(&truth.values)
        .map(|(p, t)| p.min(*t))
        .collect();
    let mut level = vec![0.0_f32; both.len()];
    let mut connected = vec![true; both.len()];
    let mut component = LargestComponent::new(truth.width, truth.height);
    for step in 1..=10_u8 {
        let threshold = f32::from(step) / 10.0;
        let omega = component.of(|i| both[i] >= threshold);
        for (i, still) in connected.iter_mut().enumerate() {
            *still &= omega.is_some_and(|label| component.labels[i] == label);
            if *still {
                level[i] = threshold;
            }
        }
    }
    let phi = |alpha: f32, level: f32| {
        let distance = f64::from(alpha) - f64::from(level);
        // What is no number is not less either, and stays none.
        if distance < CONNECTIVITY_THETA {
            1.0
        } else {
            1.0 - distance
        }
    };
    let sum: f64 = (0..both.len())
        .map(|i| (phi(pred.values[i], level[i]) - phi(truth.values[i], level[i])).abs())
        .sum();
    sum / 1000.0
}

/// Flood fill on flat arrays that are reused between thresholds.
struct LargestComponent {
    width: usize,
    height: usize,
    /// 0 = background or not visited yet, else the component's number.
    labels: Vec<u32>,
    stack: Vec<usize>,
}

impl LargestComponent {
    fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            labels: vec![0; width * height],
            stack: Vec::new(),
        }
    }

    /// Labels the 4-connected components of the pixels that are `inside`; the label of the largest.
    fn of(&mut self, inside: impl Fn(usize) -> bool) -> Option<u32> {
        self.labels.fill(0);
        let (mut last, mut best) = (0, None);
        for seed in 0..self.labels.len() {
            if self.labels[seed] != 0 || !inside(seed) {
                continue;
            }
            last += 1;
            let size = self.fill(seed, last, &inside);
            if best.is_none_or(|(largest, _)| size > largest) {
                best = Some((size, last));
            }
        }
        best.map(|(_, label)| label)
    }

    fn fill(&mut self, seed: usize, label: u32, inside: &impl Fn(usize) -> bool) -> usize {
        let (width, height) = (self.width, self.height);
        let mut size = 0;
        self.labels[seed] = label;
        self.stack.push(seed);
        while let Some(i) = self.stack.pop() {
            size += 1;
            let (x, y) = (i % width, i / width);
            let neighbours = [
                (x > 0, i.wrapping_sub(1)),
                (x + 1 < width, i + 1),
                (y > 0, i.wrapping_sub(width)),
                (y + 1 < height, i + width),
            ];
            for (exists, j) in neighbours {
                if exists && self.labels[j] == 0 && inside(j) {
                    self.labels[j] = label;
                    self.stack.push(j);
                }
            }
        }
        size
    }
}
