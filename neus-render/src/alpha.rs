//! The rungs of volume rendering on plain slices, each usable alone: opacities from signed
//! distances, transmittances, weights, sums along a ray.
//!
//! Notation: `s` is the sharpness `b` of `Phi_b(x) = 1 / (1 + exp(-b x))`; `slope` the derivative
//! of the signed distance along the ray; `dt` the length of an interval around its midpoint.

use tensor_slices::elementary::softplus;

/// `x`, or zero where it is less. What is no number stays none: `f32::max` would make it zero, and a broken field
/// empty space with a loss that looks sound.
#[inline(always)]
pub(crate) fn at_least_zero(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// `x`, or zero where it is more; as [`at_least_zero`] with what is no number.
#[inline(always)]
pub(crate) fn at_most_zero(x: f32) -> f32 {
    if x > 0.0 { 0.0 } else { x }
}

/// What turns signed distances to opacities, the same for all samples of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeusParameters {
    /// `b` of `Phi_b`, one over the width of the zone around the surface.
    pub sharpness: f32,
    /// NeuS's annealing in [0, 1]; 1 is the formula proper.
    pub cos_anneal: f32,
    /// The small constant of NeuS's code, 1e-5 there; 0 for the paper's formula.
    pub epsilon: f32,
}

impl NeusParameters {
    /// The slope that the opacity is computed with, never above zero:
    /// `-(relu(-slope/2 + 1/2) (1 - anneal) + relu(-slope) anneal)`.
    #[inline(always)]
    pub(crate) fn annealed_slope(&self, slope: f32) -> f32 {
        let soft = at_least_zero(0.5 - 0.5 * slope);
        let hard = at_least_zero(-slope);
        -(soft * (1.0 - self.cos_anneal) + hard * self.cos_anneal)
    }

    /// The derivative of [`annealed_slope`](Self::annealed_slope).
    #[inline]
    pub(crate) fn annealed_slope_derivative(&self, slope: f32) -> f32 {
        let soft = if slope < 1.0 { 0.5 } else { 0.0 };
        let hard = if slope < 0.0 { 1.0 } else { 0.0 };
        soft * (1.0 - self.cos_anneal) + hard * self.cos_anneal
    }

    /// [`neus_log_survival`] with the constant's logarithm taken once for many samples.
    #[inline(always)]
    pub(crate) fn log_survival(&self, sdf: f32, slope: f32, dt: f32, log_epsilon: f32) -> f32 {
        let half = 0.5 * dt * self.annealed_slope(slope);
        let s = self.sharpness;
        let before = softplus::<false>(-s * (sdf - half));
        let after = softplus::<false>(-s * (sdf + half));
        let floor = if log_epsilon == f32::NEG_INFINITY {
            0.0
        } else {
            softplus::<false>(before + log_epsilon)
        };
        at_most_zero(before - after - floor)
    }

    /// Logarithm of the small constant; -inf (no effect) for zero.
    #[inline]
    pub(crate) fn log_epsilon(&self) -> f32 {
        self.epsilon.ln()
    }
}

/// The logarithm of what an interval lets through, `log(1 - alpha)`, by NeuS.
///
/// With `u, v` the sharpness times the signed distance at the interval's two ends (estimated from
/// the midpoint and the slope, `u >= v`), `1 - alpha = Phi(v) / Phi(u)` up to the small constant
/// `e`, which multiplies it by `1 / (1 + e / Phi(u))`. As `log Phi(x) = -softplus(-x)`:
///
/// `log(1 - alpha) = softplus(-u) - softplus(-v) - softplus(softplus(-u) + log e)`,
///
/// which has no division and neither overflows nor cancels at either end.
#[inline]
pub fn neus_log_survival(sdf: f32, slope: f32, dt: f32, parameters: &NeusParameters) -> f32 {
    parameters.log_survival(sdf, slope, dt, parameters.log_epsilon())
}

/// The opacity of an interval by NeuS (Wang et al. 2021, eq. 13), in [0, 1]; NaN if an argument is.
///
/// ```
/// use neus_render::alpha::{NeusParameters, neus_alpha};
///
/// let parameters = NeusParameters { sharpness: 100.0, cos_anneal: 1.0, epsilon: 0.0 };
/// // The surface lies in the middle: (Phi(5) - Phi(-5)) / Phi(5).
/// assert!((neus_alpha(0.0, -1.0, 0.1, &parameters) - 0.99326).abs() < 1e-5);
/// // Leaving the surface is no crossing.
/// assert_eq!(neus_alpha(0.0, 1.0, 0.1, &parameters), 0.0);
/// ```
#[inline]
pub fn neus_alpha(sdf: f32, slope: f32, dt: f32, parameters: &NeusParameters) -> f32 {
    -neus_log_survival(sdf, slope, dt, parameters).exp_m1()
}

/// The opacity of an interval of constant density, `1 - exp(-density * dt)`; zero for negative densities, NaN if an
/// argument is.
#[inline]
pub fn density_alpha(density: f32, dt: f32) -> f32 {
    -(-at_least_zero(density) * dt).exp_m1()
}

/// Transmittance up to each interval of one ray: `T_i = prod_{j<i} (1 - alpha_j)`; `[n]` to `[n]`.
///
/// ```
/// use neus_render::alpha::transmittance;
///
/// assert_eq!(transmittance(&[0.5, 0.5, 1.0, 0.5]), [1.0, 0.5, 0.25, 0.0]);
/// ```
pub fn transmittance(alphas: &[f32]) -> Vec<f32> {
    alphas
        .iter()
        .scan(1.0, |t, &alpha| {
            let before = *t;
            *t *= 1.0 - alpha;
            Some(before)
        })
        .collect()
}

/// Weights of the intervals of one ray: `w_i = T_i alpha_i`; `[n]` to `[n]`.
///
/// ```
/// use neus_render::alpha::weights_from_alphas;
///
/// assert_eq!(weights_from_alphas(&[0.5, 0.5, 1.0, 0.5]), [0.5, 0.25, 0.25, 0.0]);
/// ```
pub fn weights_from_alphas(alphas: &[f32]) -> Vec<f32> {
    let mut weights = transmittance(alphas);
    for (weight, &alpha) in weights.iter_mut().zip(alphas) {
        *weight *= alpha;
    }
    weights
}

/// Weighted sum along each ray: weights `[n]` and values `[n, C]`, packed by `ray_offsets`
/// `[rays + 1]`, to `[rays, C]`; zero for rays without intervals.
///
/// ```
/// use neus_render::alpha::accumulate;
///
/// // Two rays with two and zero intervals.
/// assert_eq!(accumulate(&[0.5, 0.25], &[[1.0, 0.0], [0.0, 2.0]], &[0, 2, 2]), [[0.5, 0.5], [0.0, 0.0]]);
/// ```
///
/// # Panics
/// When there are not as many weights as values, or an offset lies beyond them.
pub fn accumulate<const C: usize>(
    weights: &[f32],
    values: &[[f32; C]],
    ray_offsets: &[u32],
) -> Vec<[f32; C]> {
    assert_eq!(
        weights.len(),
        values.len(),
        "accumulate: {} weights but {} values",
        weights.len(),
        values.len()
    );
    ray_offsets
        .windows(2)
        .map(|range| {
            let mut sum = [0.0; C];
            for i in range[0] as usize..range[1] as usize {
                for (total, value) in sum.iter_mut().zip(values[i]) {
                    *total += weights[i] * value;
                }
            }
            sum
        })
        .collect()
}
