//! The kernels of a layer: weights in rows of whole blocks, then products with them.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use cubecl::prelude::*;

use crate::points::{BLOCK, LANES, QUADS, Quad, padded};
use crate::tensor::UNITS;

/// What follows a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Activation {
    /// Nothing.
    Linear,
    /// Negative values to zero; a row of ones, the next layer's bias' input, below the outputs.
    ReluAndOne,
    /// Values to zero where another matrix is not positive.
    Gated,
}

/// One thread per entry.
#[cube(launch_unchecked)]
pub(super) fn pack_kernel(
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

/// One thread for each block of outputs and each block of points, which reads weights where they are.
#[cube(launch_unchecked)]
pub(super) fn dense_kernel(
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
        let strides = (width, x_stride as usize);
        let sum = products(weights, output, x, point, strides, used as usize, inputs);
        finish(&sum, gate, y, point, output, blocks, outputs, activation);
    }
}

/// The same, where a workgroup has one block of outputs and a block of points for each thread, and reads
/// the weights of its outputs once, into its own memory.
#[cube(launch_unchecked)]
pub(super) fn staged_kernel(
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
    let units = comptime!(UNITS as usize);
    let groups = (blocks + comptime!(UNITS as usize - 1)) / units;
    let width = comptime!(padded(outputs) / LANES);
    let unit = UNIT_POS as usize;
    let block = CUBE_POS % groups * units + unit;
    let output = CUBE_POS / groups * QUADS;
    let mut staged = Shared::<[Quad]>::new_slice(comptime!(inputs * QUADS));
    // No thread may leave before all have met.
    if output < width {
        let mut at = unit;
        while at < comptime!(inputs * QUADS) {
            staged[at] = weights[at / QUADS * width + output + at % QUADS];
            at += units;
        }
    }
    sync_cube();
    if output < width && block < blocks {
        let point = block * QUADS;
        let strides = (QUADS.runtime(), x_stride as usize);
        let sum = products(
            &staged,
            0usize.runtime(),
            x,
            point,
            strides,
            used as usize,
            inputs,
        );
        finish(&sum, gate, y, point, output, blocks, outputs, activation);
    }
}

/// A block of outputs at a block of points: the first `used` inputs and the last one count. An input's
/// weights begin at `output` of its row; rows of weights and of `x` are as far apart as `strides` say.
#[cube]
fn products(
    weights: &[Quad],
    output: usize,
    x: &[Quad],
    point: usize,
    strides: (usize, usize),
    used: usize,
    #[comptime] inputs: usize,
) -> Array<Quad> {
    let mut sum = Array::<Quad>::new(comptime!(BLOCK * QUADS));
    #[unroll]
    for i in 0..comptime!(BLOCK * QUADS) {
        sum[i] = Quad::new(0.0f32);
    }
    for i in 0..used + 1 {
        let row = select(i == used, comptime!(inputs - 1), i);
        let w_at = row * strides.0 + output;
        let x_at = row * strides.1 + point;
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
    sum
}

/// What follows the products, and writing it.
#[cube]
fn finish(
    sum: &Array<Quad>,
    gate: &[Quad],
    y: &mut [Quad],
    point: usize,
    output: usize,
    blocks: usize,
    #[comptime] outputs: usize,
    #[comptime] activation: Activation,
) {
    let stride = blocks * QUADS;
    let first = output * LANES * stride + point;
    #[unroll]
    for row in 0..BLOCK {
        #[unroll]
        for p in 0..QUADS {
            let at = first + row * stride + p;
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
        if output + QUADS == comptime!(padded(outputs) / LANES) {
            #[unroll]
            for p in 0..QUADS {
                y[outputs * stride + point + p] = Quad::new(1.0f32);
            }
        }
    }
}
