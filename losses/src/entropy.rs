//! A ray sees the object or it does not.

use burn::tensor::Tensor;

use crate::{reduction::weighted_mean, shape::expect_weights};

/// Opacities are kept this far from 0 and 1, where the entropy's slope is infinite. Beyond, a ray is
/// as decided as it needs to be: no gradient.
const MARGIN: f32 = 1e-5;

/// The entropy of `opacity` `[rays]`: favours rays that are opaque or empty over those in between.
///
/// ```text
/// L = sum_r w_r (-A_r ln A_r - (1 - A_r) ln(1 - A_r)) / sum_r w_r,     0 <= L <= ln 2
/// ```
///
/// For use late in training, with a small weight: early on it freezes whatever is there. Opacities
/// are clamped to [0.00001, 0.99999], which leaves 0.00013 at 0 and 1. `weights` `[rays]` are optional.
///
/// # Panics
/// When a shape is wrong.
///
/// ```
/// use burn::tensor::{Device, Tensor};
///
/// let device = Device::flex();
/// let opacity = Tensor::<1>::from_floats([0.5, 1.0], &device);
/// let loss = losses::opacity_entropy(opacity, None);
/// assert!((loss.into_scalar::<f32>() - 2.0_f32.ln() / 2.0).abs() < 1e-4);
/// ```
pub fn opacity_entropy(opacity: Tensor<1>, weights: Option<Tensor<1>>) -> Tensor<1> {
    let [rays] = opacity.dims();
    expect_weights("opacity_entropy", weights.as_ref(), rays);
    let a = opacity.clamp(MARGIN, 1.0 - MARGIN);
    let b = a.clone().neg().add_scalar(1.0);
    let entropy = (a.clone() * a.log() + b.clone() * b.log()).neg();
    weighted_mean(entropy, weights)
}
