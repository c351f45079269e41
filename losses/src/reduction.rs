//! The one reduction of this crate: the weighted mean, which is 0 where there is nothing to average.

use burn::tensor::Tensor;

/// Stands in for a sum of weights of zero. The numerator is 0 then, and so is the quotient; a sum
/// of weights that means anything is far larger.
const LEAST_TOTAL_WEIGHT: f32 = 1e-20;

/// `sum_i w_i l_i / sum_i w_i` of `elements` `[n]` with `weights` `[n]` (1 where absent), as `[1]`.
///
/// The result stays attached to the autodiff graph in the degenerate cases, with gradient 0, so that
/// a step without elements needs no case of its own.
pub(crate) fn weighted_mean(elements: Tensor<1>, weights: Option<Tensor<1>>) -> Tensor<1> {
    let [n] = elements.dims();
    match weights {
        None => elements.sum() / n.max(1) as f32,
        Some(weights) => {
            let weights = weights.detach();
            let total = weights.clone().sum().clamp_min(LEAST_TOTAL_WEIGHT);
            (elements * weights).sum() / total
        }
    }
}
