//! Weight gradients of many tiles, summed without reductions in the inner loop.

use super::POINTS;

/// Vector lanes of the widest instruction set: the room a partial sum takes.
pub(crate) const MAX_LANES: usize = 16;

/// The gradient of one dense layer, as partial sums per vector lane.
#[derive(Clone, Debug)]
pub(crate) struct LayerPartials {
    /// `[n_out, n_in, lanes]`.
    pub(crate) weight: Vec<f32>,
    /// `[n_out]`.
    pub(crate) bias: Vec<f32>,
}

impl LayerPartials {
    /// Zeros for a layer of `n_out` rows and `n_in` columns.
    pub(crate) fn new(n_out: usize, n_in: usize) -> Self {
        Self {
            weight: vec![0.0; n_out * n_in * MAX_LANES],
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

    /// The lanes summed: `(weight [n_out, n_in], bias [n_out])`, added to the given sums.
    pub(crate) fn reduce_into(&self, lanes: usize, weight: &mut [f32], bias: &mut [f32]) {
        for (sum, partial) in weight.iter_mut().zip(self.weight.chunks_exact(lanes)) {
            *sum += partial.iter().sum::<f32>();
        }
        for (sum, partial) in bias.iter_mut().zip(&self.bias) {
            *sum += partial;
        }
    }
}
