//! The op in plain tensor operations, which Burn differentiates: the oracle of the kernels.

use burn::Tensor;
use burn::tensor::activation::{sigmoid, softplus};
use hashgrid::reference::encode_with_jacobian;

use super::{Normal, SdfFieldConfig, SdfFieldWeights};

/// Same as [`sdf_field`](super::sdf_field), slowly.
#[must_use]
pub fn sdf_field(points: Tensor<2>, weights: SdfFieldWeights, config: SdfFieldConfig) -> Tensor<2> {
    let [n, _] = points.dims();
    let [hidden, inputs] = weights.w1.dims();
    let features = inputs - 3;
    let scale = 0.5 / config.half_side;
    let unit = points.clone().mul_scalar(scale).add_scalar(0.5);
    let (h, jacobian) =
        encode_with_jacobian(unit, weights.table, &config.layout, config.active_levels);
    let x = Tensor::cat(vec![points, h], 1);
    let z = x.matmul(weights.w1.clone().transpose()) + weights.b1.unsqueeze();
    let a = softplus(z.clone(), f64::from(config.beta));
    let out = a.matmul(weights.w2.clone().transpose()) + weights.b2.unsqueeze();
    let row = weights.w2.slice([0..1, 0..hidden]);
    let u = sigmoid(z.mul_scalar(config.beta)) * row;
    let g = u.matmul(weights.w1);
    let through_h = g
        .clone()
        .slice([0..n, 3..3 + features])
        .reshape([n, features, 1])
        .mul(jacobian.mul_scalar(scale))
        .sum_dim(1)
        .reshape([n, 3]);
    let mut normal = g.slice([0..n, 0..3]) + through_h;
    if config.normal == Normal::Zero {
        normal = normal.zeros_like();
    }
    Tensor::cat(vec![out, normal], 1)
}
