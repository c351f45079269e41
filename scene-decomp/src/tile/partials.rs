//! Weight gradients of many tiles, summed without reductions in the inner loop.

use tensor_slices::Scratch;

use super::POINTS;

/// Vector lanes of the widest instruction set: the room a partial sum takes.
pub(crate) const MAX_LANES: usize = 16;

/// The gradient of one dense layer, as partial sums per vector lane.
pub(crate) struct LayerPartials {
    /// `[n_out, n_in, lanes]`.
    pub(crate) weight: Scratch,
    /// `[n_out]`.
    pub(crate) bias: Vec<f32>,
}

/// The gradient of one dense layer.
#[derive(Clone, Debug)]
pub(crate) struct LayerGradient {
    /// `[n_out, n_in]`.
    pub(crate) weight: Vec<f32>,
    /// `[n_out]`.
    pub(crate) bias: Vec<f32>,
}

impl LayerPartials {
    /// Zeros for a layer of `n_out` rows and `n_in` columns.
    pub(crate) fn new(n_out: usize, n_in: usize) -> Self {
        Self {
            weight: Scratch::zeros(n_out * n_in * MAX_LANES),
            bias: vec![0.0; n_out],
        }
    }

    /// Adds the row sums of `dy: [n_out, POINTS]` to the bias gradient.
    #[inline(always)]
    pub(crate) fn add_bias(&mut self, dy: &[f32]) {
        for (bias, row) in self.bias.iter_mut().zip(dy.chunks_exact(POINTS)) {
            let mut lanes = [0.0f32; MAX_LANES];
            for chunk in row.chunks_exact(MAX_LANES) {
                for (lane, value) in lanes.iter_mut().zip(chunk) {
                    *lane += value;
                }
            }
            *bias += lanes.iter().sum::<f32>();
        }
    }

    /// The lanes summed, of an instruction set with so many. A job does this itself, while its sums
    /// are still in its core's cache.
    pub(crate) fn reduce(self, lanes: usize) -> LayerGradient {
        let all = self.weight.len() / MAX_LANES;
        let weight = self.weight[..all * lanes]
            .chunks_exact(lanes)
            .map(|partial| partial.iter().sum())
            .collect();
        LayerGradient {
            weight,
            bias: self.bias,
        }
    }
}

impl LayerGradient {
    /// The sum of all `parts`, in their order; zeros of a layer's size where there is none.
    pub(crate) fn sum(parts: impl IntoIterator<Item = Self>, n_out: usize, n_in: usize) -> Self {
        let mut parts = parts.into_iter();
        let mut sum = parts.next().unwrap_or_else(|| Self {
            weight: vec![0.0; n_out * n_in],
            bias: vec![0.0; n_out],
        });
        for part in parts {
            for (sum, part) in sum.weight.iter_mut().zip(part.weight) {
                *sum += part;
            }
            for (sum, part) in sum.bias.iter_mut().zip(part.bias) {
                *sum += part;
            }
        }
        sum
    }
}
