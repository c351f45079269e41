//! A layer of a network at many points.
//!
//! One thread takes eight outputs at eight points: 16 numbers read for 64 multiplications, where a thread
//! that takes one point reads two for each. Nothing is shared between threads; what neighbours read
//! twice is in the cache.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::points::{BLOCK, LANES, PointMatrix, QUADS, Quad, padded};
use crate::tensor::{buffer, fresh, units_for};

/// A layer's weights as the kernel reads them: a row of all outputs for each input, padded to whole
/// blocks.
#[derive(Clone, Debug)]
pub struct Packed {
    data: CubeTensor,
    inputs: usize,
    outputs: usize,
}

impl Packed {
    /// Of a layer `[outputs, inputs]` with its bias, which is the weight of one more input.
    #[must_use]
    pub fn forward(weight: &CubeTensor, bias: &CubeTensor) -> Self {
        let (outputs, inputs) = (weight.meta.shape()[0], weight.meta.shape()[1]);
        Self::new(weight, Some(bias), inputs + 1, outputs)
    }

    /// Of the way back through a layer `[outputs, inputs]`: from its outputs' gradients to its inputs'.
    #[must_use]
    pub fn backward(weight: &CubeTensor) -> Self {
        let (outputs, inputs) = (weight.meta.shape()[0], weight.meta.shape()[1]);
        Self::new(weight, None, outputs, inputs)
    }

    fn new(weight: &CubeTensor, bias: Option<&CubeTensor>, inputs: usize, outputs: usize) -> Self {
        let data = fresh(weight, [inputs, padded(outputs)]);
        let (count, dim) = units_for(&data.client, inputs * padded(outputs));
        // SAFETY: threads beyond the entries return at once, and weights are read where they exist.
        unsafe {
            pack_kernel::launch_unchecked(
                &data.client,
                count,
                dim,
                buffer(weight),
                buffer(bias.unwrap_or(weight)),
                buffer(&data),
                inputs,
                outputs,
                bias.is_some(),
            );
        }
        Self {
            data,
            inputs,
            outputs,
        }
    }

    /// The layer without an activation.
    #[must_use]
    pub fn apply(&self, x: &PointMatrix) -> PointMatrix {
        self.apply_to(x, x.points)
    }

    /// The same at the first `points` of `x` alone, a multiple of [`BLOCK`].
    #[must_use]
    pub fn apply_to(&self, x: &PointMatrix, points: usize) -> PointMatrix {
        let y = PointMatrix::fresh(&x.data, self.outputs, points);
        self.launch(x, &y, None, Activation::Linear, self.all());
        y
    }

    /// The same where all rows of `x` from `inputs` on are zero, but the bias'.
    #[must_use]
    pub fn apply_first(&self, x: &PointMatrix, inputs: usize) -> PointMatrix {
        let y = PointMatrix::fresh(&x.data, self.outputs, x.points);
        let used = Used {
            inputs,
            ..self.all()
        };
        self.launch(x, &y, None, Activation::Linear, used);
        y
    }

    /// The first `outputs` of the layer; what the other rows hold is arbitrary.
    #[must_use]
    pub fn first_outputs(&self, x: &PointMatrix, outputs: usize) -> PointMatrix {
        let y = PointMatrix::fresh(&x.data, self.outputs, x.points);
        let used = Used {
            outputs,
            ..self.all()
        };
        self.launch(x, &y, None, Activation::Linear, used);
        y
    }

    fn all(&self) -> Used {
        Used {
            inputs: self.inputs - 1,
            outputs: self.outputs,
        }
    }

    /// The layer and a ReLU, and below its outputs a row of ones: the input of the next layer's bias.
    #[must_use]
    pub fn relu(&self, x: &PointMatrix) -> PointMatrix {
        let y = PointMatrix::fresh(&x.data, self.outputs + 1, x.points);
        self.launch(x, &y, None, Activation::ReluAndOne, self.all());
        y
    }

    /// The layer, zero where `gate` is: the way back through a ReLU whose result that was.
    #[must_use]
    pub fn gated(&self, x: &PointMatrix, gate: &PointMatrix) -> PointMatrix {
        let y = PointMatrix::fresh(&x.data, self.outputs, x.points);
        self.launch(x, &y, Some(gate), Activation::Gated, self.all());
        y
    }

    fn launch(
        &self,
        x: &PointMatrix,
        y: &PointMatrix,
        gate: Option<&PointMatrix>,
        activation: Activation,
        used: Used,
    ) {
        assert_eq!(
            self.inputs, x.rows,
            "Packed: inputs of the layer and rows of the matrix"
        );
        let blocks = y.points / BLOCK;
        let rows = padded(used.outputs) / BLOCK;
        if blocks == 0 {
            return;
        }
        let client = &y.data.client;
        let (count, dim) = units_for(client, blocks * rows);
        // SAFETY: threads beyond the blocks return at once; matrices are padded to whole blocks.
        unsafe {
            dense_kernel::launch_unchecked(
                client,
                count,
                dim,
                buffer(&self.data),
                buffer(&x.data),
                buffer(&gate.unwrap_or(x).data),
                buffer(&y.data),
                blocks as u32,
                used.inputs as u32,
                (x.points / LANES) as u32,
                self.inputs,
                self.outputs,
                activation,
            );
        }
    }
}

/// How much of a layer is wanted.
#[derive(Clone, Copy, Debug)]
struct Used {
    /// Leading inputs, before the last one, which always counts.
    inputs: usize,
    /// Leading outputs.
    outputs: usize,
}

/// What follows a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Activation {
    /// Nothing.
    Linear,
    /// Negative values to zero; a row of ones, the next layer's bias' input, below the outputs.
    ReluAndOne,
    /// Values to zero where another matrix is not positive.
    Gated,
}

/// One thread per entry.
#[cube(launch_unchecked)]
fn pack_kernel(
    weight: &[f32],
    bias: &[f32],
    packed: &mut [f32],
    #[comptime] inputs: usize,
    #[comptime] outputs: usize,
    #[comptime] biased: bool,
) {
    let width = comptime!(padded(outputs));
    let (i, o) = (ABSOLUTE_POS / width, ABSOLUTE_POS % width);
    if i < inputs {
        let mut value = 0.0f32;
        if o < outputs {
            if comptime!(biased) {
                if i < comptime!(inputs - 1) {
                    value = weight[o * comptime!(inputs - 1) + i];
                } else {
                    value = bias[o];
                }
            } else {
                value = weight[i * outputs + o];
            }
        }
        packed[ABSOLUTE_POS] = value;
    }
}

/// One thread for each block of outputs and each block of points.
#[cube(launch_unchecked)]
fn dense_kernel(
    weights: &[Quad],
    x: &[Quad],
    gate: &[Quad],
    y: &mut [Quad],
    blocks: u32,
    used: u32,
    x_stride: u32,
    #[comptime] inputs: usize,
    #[comptime] outputs: usize,
    #[comptime] activation: Activation,
) {
    let blocks = blocks as usize;
    let width = comptime!(padded(outputs) / LANES);
    let (point, output) = (ABSOLUTE_POS % blocks * QUADS, ABSOLUTE_POS / blocks * QUADS);
    if output < width {
        let mut sum = Array::<Quad>::new(comptime!(BLOCK * QUADS));
        #[unroll]
        for i in 0..comptime!(BLOCK * QUADS) {
            sum[i] = Quad::new(0.0f32);
        }
        let used = used as usize;
        for i in 0..used + 1 {
            let row = select(i == used, comptime!(inputs - 1), i);
            let x_at = row * x_stride as usize + point;
            let w_at = row * width + output;
            #[unroll]
            for q in 0..QUADS {
                let w = weights[w_at + q];
                #[unroll]
                for p in 0..QUADS {
                    let v = x[x_at + p];
                    #[unroll]
                    for lane in 0..LANES {
                        let at = comptime!((q * LANES + lane) * QUADS + p);
                        sum[at] += Quad::new(w.extract(lane)) * v;
                    }
                }
            }
        }
        let y_stride = blocks * QUADS;
        let first = output * LANES * y_stride + point;
        #[unroll]
        for row in 0..BLOCK {
            #[unroll]
            for p in 0..QUADS {
                let at = first + row * y_stride + p;
                let mut value = sum[comptime!(row * QUADS + p)];
                let zero = Quad::new(0.0f32);
                if comptime!(activation == Activation::ReluAndOne) {
                    value = max(value, zero);
                }
                if comptime!(activation == Activation::Gated) {
                    value = select_many(gate[at].greater_than(&zero), value, zero);
                }
                y[at] = value;
            }
        }
        if comptime!(activation == Activation::ReluAndOne) {
            // In the thread of the last block, which has padding there itself.
            if output + QUADS == width {
                #[unroll]
                for p in 0..QUADS {
                    y[outputs * y_stride + point + p] = Quad::new(1.0f32);
                }
            }
        }
    }
}
