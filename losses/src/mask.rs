//! Rendered opacity against a coarse mask.

use burn::tensor::Tensor;

use crate::{
    reduction::weighted_mean,
    shape::{expect_shape, expect_weights},
};

/// Added to the opacity under the logarithm: bounds the loss of an empty ray that should be opaque
/// (6.9) and its gradient (1000), without the dead zone of a clamp.
pub const OPACITY_OFFSET: f32 = 1e-3;

/// Far below what a renderer adds up that takes logarithms from densities or distances (a wall's density of 1.6e5 along a
/// backdrop of 1e4 gives -1.6e9), so that only an infinite sum, or one as good as infinite, ends here, without a gradient.
/// Far enough above the least number that a batch of a hundred million such rays still adds up to one.
const LEAST_LOG_TRANSMITTANCE: f32 = -1e30;

/// The mask loss: binary cross entropy of the rendered opacity and a coarse mask, per ray.
///
/// ```text
/// L = sum_r w_r l_r / sum_r w_r,     l = -(1 - M) log T - M log(A + 0.001)
/// ```
///
/// - `opacity` `[rays]`: the object's opacity `A` in [0, 1];
/// - `log_transmittance` `[rays]`: `log T = sum_i log(1 - a_i)` over the object's samples on the ray.
///   With `A = 1 - T` it says the same as the opacity, but as `A` goes to 1 its logarithm form keeps
///   the digits, and the gradient, that `log(1 - A)` has lost;
/// - `mask` `[rays]`: `M`, 1 for the object, 0 for the rest, or soft in between;
/// - `weights` `[rays]`: confidence, 0 to ignore a ray (see [`ignore_band`]).
///
/// L_mask of the paper. Where M = 1 a clamped logarithm would have no gradient on the rays that need
/// one most, those that see nothing yet; the offset ([`OPACITY_OFFSET`]) leaves them a large one.
///
/// # Panics
/// When a shape is wrong.
///
/// ```
/// use burn::tensor::{Device, Tensor};
///
/// let device = Device::flex();
/// let opacity = Tensor::<1>::from_floats([0.75, 0.0, 0.5], &device);
/// let log_transmittance = (-opacity.clone()).log1p();
/// let mask = Tensor::<1>::from_floats([0.0, 1.0, 1.0], &device);
/// let weights = Tensor::<1>::from_floats([1.0, 1.0, 0.0], &device);
///
/// let loss = losses::mask_loss(opacity, log_transmittance, mask, Some(weights));
/// let expected = (-(0.25_f32).ln() - (0.001_f32).ln()) / 2.0;
/// assert!((loss.into_scalar::<f32>() - expected).abs() < 1e-5);
/// ```
pub fn mask_loss(
    opacity: Tensor<1>,
    log_transmittance: Tensor<1>,
    mask: Tensor<1>,
    weights: Option<Tensor<1>>,
) -> Tensor<1> {
    let [rays] = opacity.dims();
    let name = "mask_loss";
    expect_shape(name, "log_transmittance", &log_transmittance, [rays]);
    expect_shape(name, "mask", &mask, [rays]);
    expect_weights(name, weights.as_ref(), rays);
    let empty = log_transmittance.clamp_min(LEAST_LOG_TRANSMITTANCE);
    let filled = opacity.add_scalar(OPACITY_OFFSET).log();
    let outside = mask.clone().neg().add_scalar(1.0);
    weighted_mean((outside * empty + mask * filled).neg(), weights)
}

/// Weights `[rays]` for [`mask_loss`] that ignore a band around the coarse mask's outline.
///
/// `edge_distance` `[rays]` is how far each pixel is from the outline, of either sign and in any unit;
/// the weight is 0 where `|edge_distance| < half_width` and 1 elsewhere. Coarse masks are right
/// away from their outline: about 3 % of the object's size is a good band.
///
/// ```
/// use burn::tensor::{Device, Tensor};
///
/// let device = Device::flex();
/// let edge_distance = Tensor::<1>::from_floats([-9.0, -2.0, 0.0, 3.0], &device); // pixels
/// let weights = losses::ignore_band(edge_distance, 3.0).into_data();
/// assert_eq!(weights.as_slice::<f32>().expect("f32"), &[1.0, 0.0, 0.0, 1.0]);
/// ```
pub fn ignore_band(edge_distance: Tensor<1>, half_width: f32) -> Tensor<1> {
    edge_distance.abs().greater_equal_elem(half_width).float()
}
