//! A signed distance has a gradient of length one.

use burn::tensor::Tensor;

use crate::{
    reduction::weighted_mean,
    shape::{expect_shape, expect_weights},
};

/// Added to the squared length under the root. Changes a length of 1 by less than its last bit, and
/// makes the gradient at a length of 0 the number 0 rather than 0/0.
pub(crate) const LENGTH_OFFSET: f32 = 1e-12;

/// The Eikonal loss of `normals` `[n, 3]`, the unnormalised gradients of a signed distance.
///
/// ```text
/// L = sum_i w_i (|n_i| - 1)^2 / sum_i w_i
/// ```
///
/// L_eikonal of the paper, from Gropp et al. 2020, "Implicit geometric regularization". Lengths are
/// `sqrt(n . n + 1e-12)`; the gradient at length 0, where no direction is better than another, is 0.
/// `weights` `[n]` are optional.
///
/// # Panics
/// When a shape is wrong.
///
/// ```
/// use burn::tensor::{Device, Tensor};
///
/// let device = Device::flex();
/// let normals = Tensor::<2>::from_floats([[0.6, 0.8, 0.0], [0.0, 3.0, 0.0]], &device);
/// let loss = losses::eikonal_loss(normals, None);
/// assert!((loss.into_scalar::<f32>() - (0.0 + 4.0) / 2.0).abs() < 1e-6);
/// ```
pub fn eikonal_loss(normals: Tensor<2>, weights: Option<Tensor<1>>) -> Tensor<1> {
    let [n, _] = normals.dims();
    expect_shape("eikonal_loss", "normals", &normals, [n, 3]);
    expect_weights("eikonal_loss", weights.as_ref(), n);
    let length = normals.square().sum_dim(1).add_scalar(LENGTH_OFFSET).sqrt();
    eikonal_loss_of_lengths(length.reshape([n]), weights)
}

/// [`eikonal_loss`] of normals whose `lengths` `[n]` are known already.
///
/// # Panics
/// When a shape is wrong.
pub fn eikonal_loss_of_lengths(lengths: Tensor<1>, weights: Option<Tensor<1>>) -> Tensor<1> {
    let [n] = lengths.dims();
    expect_weights("eikonal_loss_of_lengths", weights.as_ref(), n);
    weighted_mean((lengths - 1.0).square(), weights)
}
