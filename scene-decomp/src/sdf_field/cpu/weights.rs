//! The MLP as the kernels want it.

use crate::sdf_field::SdfFieldConfig;

/// The MLP, restricted to the active levels' columns, with what both passes derive from it.
#[derive(Clone, Debug)]
pub(crate) struct Weights {
    pub(super) all_inputs: usize,
    pub(super) inputs: usize,
    pub(super) hidden: usize,
    pub(super) outputs: usize,
    pub(super) w1: Vec<f32>,
    pub(super) w1_transposed: Vec<f32>,
    pub(super) b1: Vec<f32>,
    pub(super) w2: Vec<f32>,
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
    ) -> Self {
        let all_inputs = 3 + 2 * config.layout.levels.len();
        let inputs = 3 + 2 * config.active_levels;
        let (hidden, outputs) = (b1.len(), b2.len());
        let w1: Vec<f32> = w1
            .chunks_exact(all_inputs)
            .flat_map(|row| row[..inputs].iter().copied())
            .collect();
        Self {
            all_inputs,
            inputs,
            hidden,
            outputs,
            w1_transposed: transposed(&w1, hidden, inputs),
            w1,
            b1: b1.to_vec(),
            w2_transposed: transposed(w2, outputs, hidden),
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
    (0..columns)
        .flat_map(|c| (0..rows).map(move |r| matrix[r * columns + c]))
        .collect()
}
