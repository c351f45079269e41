//! Smoothness of the surface: neighbouring normals agree.

use burn::tensor::Tensor;

use crate::{
    eikonal::LENGTH_OFFSET,
    reduction::weighted_mean,
    shape::{expect_shape, expect_weights},
};

/// The curvature loss: how much normals differ between points and their neighbours.
///
/// ```text
/// L = sum_i w_i |u_i - v_i|^2 / sum_i w_i,     u = n / |n|, v = m / |m|
/// ```
///
/// `normals` `[n, 3]` and `neighbours` `[n, 3]` are the gradients `n` and `m` of the signed distance at
/// the points and at points a small step away; their lengths do not matter. For unit vectors the
/// term is `2 - 2 cos`, and with weights `[n]` of one over the squared step it tends to the squared
/// curvature along the step. A gradient of length zero has direction zero, and no gradient.
///
/// # Panics
/// When a shape is wrong.
///
/// ```
/// use burn::tensor::{Device, Tensor};
///
/// let device = Device::flex();
/// let normals = Tensor::<2>::from_floats([[0.0, 0.0, 1.0], [0.0, 2.0, 0.0]], &device);
/// let neighbours = Tensor::<2>::from_floats([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &device);
/// let loss = losses::curvature_loss(normals, neighbours, None);
/// assert!((loss.into_scalar::<f32>() - (2.0 + 0.0) / 2.0).abs() < 1e-6);
/// ```
pub fn curvature_loss(
    normals: Tensor<2>,
    neighbours: Tensor<2>,
    weights: Option<Tensor<1>>,
) -> Tensor<1> {
    let [n, _] = normals.dims();
    let name = "curvature_loss";
    expect_shape(name, "normals", &normals, [n, 3]);
    expect_shape(name, "neighbours", &neighbours, [n, 3]);
    expect_weights(name, weights.as_ref(), n);
    let difference = direction(normals) - direction(neighbours);
    weighted_mean(difference.square().sum_dim(1).reshape([n]), weights)
}

/// `v / |v|` of each row of `vectors` `[n, 3]`; 0, without a gradient, for rows of no length.
fn direction(vectors: Tensor<2>) -> Tensor<2> {
    let squared = vectors.clone().square().sum_dim(1);
    let degenerate = squared.clone().detach().lower_elem(LENGTH_OFFSET);
    let length = squared.mask_fill(degenerate.clone(), 1.0).sqrt();
    vectors * length.recip().mask_fill(degenerate, 0.0)
}
