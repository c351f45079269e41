//! The MLP as the kernels want it.

use super::forward::Keep;
use crate::sdf_field::{Normal, SdfFieldConfig};

/// The MLP, restricted to the active levels' columns, with what both passes derive from it.
#[derive(Clone, Debug)]
pub(crate) struct Weights {
    pub(super) all_inputs: usize,
    pub(super) inputs: usize,
    pub(super) hidden: usize,
    pub(super) outputs: usize,
    pub(super) w1: Vec<f32>,
    /// Empty where neither normals nor gradients are wanted.
    pub(super) w1_transposed: Vec<f32>,
    pub(super) b1: Vec<f32>,
    pub(super) w2: Vec<f32>,
    /// Empty where no gradients are wanted.
    pub(super) w2_transposed: Vec<f32>,
    pub(super) b2: Vec<f32>,
}

impl Weights {
    /// Copies `w1 [hidden, 3 + 2 L]`, `b1`, `w2 [1 + G, hidden]`, `b2`.
    pub(crate) fn new(
        config: &SdfFieldConfig,
        w1: &[f32],
        b1: &[f32],
        w2: &[f32],
        b2: &[f32],
        keep: Keep,
    ) -> Self {
        let all_inputs = 3 + 2 * config.layout.levels.len();
        let inputs = 3 + 2 * config.active_levels;
        let (hidden, outputs) = (b1.len(), b2.len());
        let mut active = Vec::with_capacity(hidden * inputs);
        for row in w1.chunks_exact(all_inputs) {
            active.extend_from_slice(&row[..inputs]);
        }
        let w1 = active;
        // Asked about few points, the op is over in a few microseconds: what nobody reads would be a part of them.
        let backward = keep == Keep::ForBackward;
        let back_to_input = backward || config.normal == Normal::Computed;
        Self {
            all_inputs,
            inputs,
            hidden,
            outputs,
            w1_transposed: if back_to_input {
                transposed(&w1, hidden, inputs)
            } else {
                Vec::new()
            },
            w1,
            b1: b1.to_vec(),
            w2_transposed: if backward {
                transposed(w2, outputs, hidden)
            } else {
                Vec::new()
            },
            w2: w2.to_vec(),
            b2: b2.to_vec(),
        }
    }

    /// Columns of the op's output: sdf, features, normal.
    pub(crate) fn columns(&self) -> usize {
        self.outputs + 3
    }
}

/// `[columns, rows]` from `[rows, columns]`.
pub(crate) fn transposed(matrix: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let mut out = vec![0.0; rows * columns];
    for (r, row) in matrix.chunks_exact(columns.max(1)).enumerate() {
        for (c, value) in row.iter().enumerate() {
            out[c * rows + r] = *value;
        }
    }
    out
}
