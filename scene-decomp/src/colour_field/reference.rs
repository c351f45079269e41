//! The op in plain tensor operations, which Burn differentiates: the oracle of the kernels.

use burn::Tensor;
use burn::tensor::activation::{relu, sigmoid};

use super::row::{LENGTH_OFFSET, densities_of};
use super::{ColourFieldInputs, ColourFieldWeights, Reading, RowConfig};

/// Same as [`colour_field`](super::colour_field), slowly.
#[must_use]
pub fn colour_field(inputs: ColourFieldInputs, weights: ColourFieldWeights) -> Tensor<2> {
    let [n, columns] = inputs.geometry.dims();
    let normal = inputs.geometry.clone().slice([0..n, columns - 3..columns]);
    let geometry = inputs.geometry.slice([0..n, 0..columns - 3]);
    let mut parts = vec![inputs.points, normal, inputs.directions, geometry];
    if inputs.extra.dims()[1] > 0 {
        parts.push(inputs.extra);
    }
    let layer = |x: Tensor<2>, w: Tensor<2>, b: Tensor<1>| x.matmul(w.transpose()) + b.unsqueeze();
    let h1 = relu(layer(Tensor::cat(parts, 1), weights.w1, weights.b1));
    let h2 = relu(layer(h1, weights.w2, weights.b2));
    sigmoid(layer(h2, weights.w3, weights.b3))
}

/// Same as [`sample_rows`](super::sample_rows), slowly.
#[must_use]
pub fn sample_rows(
    inputs: ColourFieldInputs,
    stretch: Tensor<2>,
    weights: ColourFieldWeights,
    config: RowConfig,
) -> Tensor<2> {
    let [n, columns] = inputs.geometry.dims();
    let first = inputs.geometry.clone().slice([0..n, 0..1]);
    let normal = inputs.geometry.clone().slice([0..n, columns - 3..columns]);
    let first = match config.reading {
        Reading::Distance => first,
        Reading::Density if stretch.dims()[1] == 0 => densities_of(first),
        Reading::Density => densities_of(first) * stretch,
    };
    let slope = (normal.clone() * inputs.directions.clone()).sum_dim(1);
    let length = (normal.square().sum_dim(1) + LENGTH_OFFSET).sqrt();
    let directions = inputs.directions.clone() * config.view_share;
    let seen = ColourFieldInputs {
        directions,
        ..inputs
    };
    let out = colour_field(seen, weights);
    Tensor::cat(vec![first, slope, out, length], 1)
}
