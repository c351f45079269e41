//! The kernels of a layer: weights in rows of whole blocks and products with them, or products of tiles that a
//! workgroup's threads share.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use cubecl::prelude::*;

use crate::points::{BLOCK, LANES, QUADS, Quad, Quads, padded, zero_quads};
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
        let value = weight_at(weight, bias, i, o, inputs, outputs, biased);
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
        finish(
            &sum,
            gate,
            y,
            (point, point + 1),
            output,
            blocks,
            outputs,
            activation,
        );
    }
}

/// How the threads of a workgroup share a tile of a layer: each takes a block of outputs at a block of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Tile {
    /// Blocks of outputs.
    pub(super) outputs: usize,
    /// Blocks of points.
    pub(super) points: usize,
    /// Inputs in the workgroup's memory at once.
    depth: usize,
}

impl Tile {
    /// Blocks of outputs that one workgroup takes at most.
    const MOST_OUTPUTS: usize = 8;
    /// Numbers in the workgroup's memory at once: a little over half of the 16 KiB that every device has.
    const MOST_VALUES: usize = 2304;

    /// For a layer of so many outputs, which tiles share as evenly as whole blocks allow.
    pub(super) fn of(outputs: usize) -> Self {
        let blocks = padded(outputs) / BLOCK;
        let outputs = blocks.div_ceil(blocks.div_ceil(Self::MOST_OUTPUTS));
        let points = UNITS as usize / outputs;
        let across = (outputs + points) * BLOCK;
        let depth = [16, 8, 4, 2]
            .into_iter()
            .find(|depth| depth * across <= Self::MOST_VALUES)
            .unwrap_or(1);
        Self {
            outputs,
            points,
            depth,
        }
    }

    /// Bytes of a workgroup's memory.
    pub(super) fn bytes(self) -> usize {
        self.depth * (self.outputs + self.points) * BLOCK * size_of::<f32>()
    }

    fn output_quads(self) -> usize {
        self.outputs * QUADS
    }

    fn point_quads(self) -> usize {
        self.points * QUADS
    }

    /// Quads that a thread brings of `across` for each input.
    fn loads(self, across: usize) -> usize {
        (self.depth * across).div_ceil(UNITS as usize)
    }
}

/// The same by tiles: a workgroup brings some inputs' weights and values into its own memory, all of its threads
/// multiply them, and so on through the inputs. Weights are read as the layer has them.
///
/// A thread's points are not next to each other but a tile's half apart, so that neighbours read neighbours.
#[cube(launch_unchecked)]
pub(super) fn tiled_kernel(
    weight: &[f32],
    bias: &[f32],
    x: &[Quad],
    gate: &[Quad],
    y: &mut [Quad],
    blocks: u32,
    used: u32,
    x_stride: u32,
    #[comptime] inputs: usize,
    #[comptime] outputs: usize,
    #[comptime] biased: bool,
    #[comptime] activation: Activation,
    #[comptime] tile: Tile,
) {
    let (blocks, used, x_stride) = (blocks as usize, used as usize, x_stride as usize);
    let groups = (blocks + comptime!(tile.points - 1)) / comptime!(tile.points);
    let unit = UNIT_POS as usize;
    let first_quad = CUBE_POS % groups * comptime!(tile.point_quads());
    let first_output = CUBE_POS / groups * comptime!(tile.outputs * BLOCK);
    let (point, output) = (unit % comptime!(tile.points), unit / comptime!(tile.points));
    let mut values = Shared::<[Quad]>::new_slice(comptime!(tile.depth * tile.point_quads()));
    let mut weights = Shared::<[Quad]>::new_slice(comptime!(tile.depth * tile.output_quads()));
    let sum = zero_quads(comptime!(BLOCK * QUADS));
    // What comes next is on its way while the threads multiply: a load waits for no other.
    let next_values = zero_quads(comptime!(tile.loads(tile.point_quads())));
    let next_weights = zero_quads(comptime!(tile.loads(tile.output_quads())));
    let last = blocks * QUADS - 1;
    let mut start = 0usize.runtime();
    load_values(
        &next_values,
        x,
        start,
        first_quad,
        last,
        used,
        x_stride,
        inputs,
        tile,
    );
    load_weights(
        &next_weights,
        weight,
        bias,
        start,
        first_output,
        used,
        inputs,
        outputs,
        biased,
        tile,
    );
    // As often in all threads: none may miss a meeting.
    while start <= used {
        #[unroll]
        for n in 0..comptime!(tile.loads(tile.point_quads())) {
            let at = unit + comptime!(n * UNITS as usize);
            if at < comptime!(tile.depth * tile.point_quads()) {
                values[at] = next_values[n].read();
            }
        }
        #[unroll]
        for n in 0..comptime!(tile.loads(tile.output_quads())) {
            let at = unit + comptime!(n * UNITS as usize);
            if at < comptime!(tile.depth * tile.output_quads()) {
                weights[at] = next_weights[n].read();
            }
        }
        start += comptime!(tile.depth);
        load_values(
            &next_values,
            x,
            start,
            first_quad,
            last,
            used,
            x_stride,
            inputs,
            tile,
        );
        load_weights(
            &next_weights,
            weight,
            bias,
            start,
            first_output,
            used,
            inputs,
            outputs,
            biased,
            tile,
        );
        sync_cube();
        if output < comptime!(tile.outputs) {
            // Not unrolled: compilers take long over a thousand products, and know themselves what suits them.
            for i in 0..comptime!(tile.depth) {
                let w_at = i * comptime!(tile.output_quads()) + output * QUADS;
                let v_at = i * comptime!(tile.point_quads()) + point;
                #[unroll]
                for q in 0..QUADS {
                    let w = weights[w_at + q];
                    #[unroll]
                    for p in 0..QUADS {
                        let v = values[v_at + comptime!(p * tile.points)];
                        #[unroll]
                        for lane in 0..LANES {
                            let at = comptime!((q * LANES + lane) * QUADS + p);
                            let more = fma(Quad::new(w.extract(lane)), v, sum[at].read());
                            sum[at].store(more);
                        }
                    }
                }
            }
        }
        sync_cube();
    }
    let output = first_output / LANES + output * QUADS;
    if unit < comptime!(tile.points * tile.outputs) && output < comptime!(padded(outputs) / LANES) {
        let quads = (
            first_quad + point,
            first_quad + point + comptime!(tile.points),
        );
        finish(&sum, gate, y, quads, output, blocks, outputs, activation);
    }
}

/// Asks for the values of the inputs from `start` on at a tile's points; zeros beyond either.
#[cube]
fn load_values(
    next: &Quads,
    x: &[Quad],
    start: usize,
    first_quad: usize,
    last: usize,
    used: usize,
    x_stride: usize,
    #[comptime] inputs: usize,
    #[comptime] tile: Tile,
) {
    #[unroll]
    for n in 0..comptime!(tile.loads(tile.point_quads())) {
        let at = UNIT_POS as usize + comptime!(n * UNITS as usize);
        let i = start + at / comptime!(tile.point_quads());
        let quad = first_quad + at % comptime!(tile.point_quads());
        let row = select(i < used, i, comptime!(inputs - 1));
        let value = x[row * x_stride + min(quad, last)];
        next[n].store(select(i <= used && quad <= last, value, Quad::new(0.0f32)));
    }
}

/// Asks for the weights of the inputs from `start` on for a tile's outputs; zeros beyond either.
#[cube]
fn load_weights(
    next: &Quads,
    weight: &[f32],
    bias: &[f32],
    start: usize,
    first_output: usize,
    used: usize,
    #[comptime] inputs: usize,
    #[comptime] outputs: usize,
    #[comptime] biased: bool,
    #[comptime] tile: Tile,
) {
    #[unroll]
    for n in 0..comptime!(tile.loads(tile.output_quads())) {
        let at = UNIT_POS as usize + comptime!(n * UNITS as usize);
        let i = start + at / comptime!(tile.output_quads());
        let o = first_output + at % comptime!(tile.output_quads()) * LANES;
        let row = select(i < used, i, comptime!(inputs - 1));
        let mut four = Quad::new(0.0f32);
        #[unroll]
        for lane in 0..LANES {
            let value = weight_at(weight, bias, row, o + lane, inputs, outputs, biased);
            four.insert(lane, value);
        }
        next[n].store(select(i <= used, four, Quad::new(0.0f32)));
    }
}

/// A weight of output `o` by input `i`: of the bias for the last input of a layer that has one, zero beyond the outputs.
#[cube]
fn weight_at(
    weight: &[f32],
    bias: &[f32],
    i: usize,
    o: usize,
    #[comptime] inputs: usize,
    #[comptime] outputs: usize,
    #[comptime] biased: bool,
) -> f32 {
    // No branches: a load behind one waits for it.
    let there = min(o, comptime!(outputs - 1));
    let value = if comptime!(biased) {
        let of_input = weight[there * comptime!(inputs - 1) + min(i, comptime!(inputs - 2))];
        select(i < comptime!(inputs - 1), of_input, bias[there])
    } else {
        weight[i * outputs + there]
    };
    select(o < outputs, value, 0.0f32)
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
) -> Quads {
    let sum = zero_quads(comptime!(BLOCK * QUADS));
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
                    let more = sum[at].read() + Quad::new(w.extract(lane)) * v;
                    sum[at].store(more);
                }
            }
        }
    }
    sum
}

/// What follows the products, and writing it at both quads of points, those that there are.
#[cube]
fn finish(
    sum: &Quads,
    gate: &[Quad],
    y: &mut [Quad],
    quads: (usize, usize),
    output: usize,
    blocks: usize,
    #[comptime] outputs: usize,
    #[comptime] activation: Activation,
) {
    let stride = blocks * QUADS;
    #[unroll]
    for p in 0..QUADS {
        let point = if comptime!(p == 0) { quads.0 } else { quads.1 };
        if point < stride {
            let first = output * LANES * stride + point;
            #[unroll]
            for row in 0..BLOCK {
                let at = first + row * stride;
                let mut value = sum[comptime!(row * QUADS + p)].read();
                let zero = Quad::new(0.0f32);
                if comptime!(activation == Activation::ReluAndOne) {
                    // Not `max`, which on most devices makes zero of what is no number.
                    value = select_many(value.less_equal(&zero), zero, value);
                }
                if comptime!(activation == Activation::Gated) {
                    value = select_many(gate[at].greater_than(&zero), value, zero);
                }
                y[at] = value;
            }
            if comptime!(activation == Activation::ReluAndOne) {
                // In the thread of the last block, which has padding there itself.
                if output + QUADS == comptime!(padded(outputs) / LANES) {
                    y[outputs * stride + point] = Quad::new(1.0f32);
                }
            }
        }
    }
}
