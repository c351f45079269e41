//! Weight gradients of layers: sums of outer products over all points.
//!
//! Library matrix products are made for large results; these are a few dozen wide and thousands to
//! hundreds of thousands long. A thread adds up a block of eight by eight entries over one chunk of
//! the points; another kernel adds the chunks.

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::points::{BLOCK, LANES, PointMatrix, Quad, padded};
use crate::sums::add_rows;
use crate::tensor::{buffer, fresh, units_for, zeros};

/// Points that one thread adds up by itself: the order of the sum, and so its bits, depend on the
/// number of points alone.
const CHUNK: usize = 256;

/// The gradients of a layer `[outputs, inputs]` and its bias: `G X^T` for the gradients `G` of its
/// outputs and its inputs `X`, whose last row is the bias' input.
#[must_use]
pub fn layer_gradients(gradient: &PointMatrix, x: &PointMatrix) -> (CubeTensor, CubeTensor) {
    assert_eq!(gradient.points, x.points, "layer_gradients: points");
    let (outputs, inputs) = (gradient.rows, x.rows - 1);
    let like = &x.data;
    if x.points == 0 {
        return (zeros(like, [outputs, inputs]), zeros(like, [outputs]));
    }
    let chunks = x.points.div_ceil(CHUNK);
    let partial = fresh(like, [chunks, outputs * x.rows]);
    let blocks = padded(outputs) / BLOCK * (padded(x.rows) / BLOCK);
    let (count, dim) = units_for(&like.client, chunks * blocks);
    // SAFETY: threads beyond the blocks return at once, and matrices are padded to whole blocks.
    unsafe {
        products_kernel::launch_unchecked(
            &like.client,
            count,
            dim,
            buffer(&gradient.data),
            buffer(&x.data),
            buffer(&partial),
            (x.points / LANES) as u32,
            chunks as u32,
            outputs,
            x.rows,
        );
    }
    let weights = outputs * inputs;
    (
        add_rows(&partial, 0, [outputs, inputs]),
        add_rows(&partial, weights, [outputs]),
    )
}

/// One thread for each block of entries and each chunk; a chunk's points are spread over all of them, so
/// that neighbouring threads read neighbours. The last input's entries follow all others.
#[cube(launch_unchecked)]
fn products_kernel(
    gradient: &[Quad],
    x: &[Quad],
    partial: &mut [f32],
    quads: u32,
    chunks: u32,
    #[comptime] outputs: usize,
    #[comptime] inputs: usize,
) {
    let (quads, chunks) = (quads as usize, chunks as usize);
    let across = comptime!(padded(inputs) / BLOCK);
    let (chunk, block) = (ABSOLUTE_POS % chunks, ABSOLUTE_POS / chunks);
    let (i, j) = (block / across * BLOCK, block % across * BLOCK);
    if i < outputs {
        let mut sum = Array::<f32>::new(comptime!(BLOCK * BLOCK));
        #[unroll]
        for at in 0..comptime!(BLOCK * BLOCK) {
            sum[at] = 0.0f32;
        }
        let mut at = chunk;
        while at < quads {
            let mut right = Array::<Quad>::new(BLOCK);
            #[unroll]
            for b in 0..BLOCK {
                right[b] = x[(j + b) * quads + at];
            }
            #[unroll]
            for a in 0..BLOCK {
                let left = gradient[(i + a) * quads + at];
                #[unroll]
                for b in 0..BLOCK {
                    let product = left * right[b];
                    sum[comptime!(a * BLOCK + b)] += (product.extract(0usize)
                        + product.extract(1usize))
                        + (product.extract(2usize) + product.extract(3usize));
                }
            }
            at += chunks;
        }
        let first = chunk * comptime!(outputs * inputs);
        #[unroll]
        for a in 0..BLOCK {
            #[unroll]
            for b in 0..BLOCK {
                let (output, input) = (i + a, j + b);
                if output < outputs && input < inputs {
                    let entry = select(
                        input == comptime!(inputs - 1),
                        comptime!(outputs * (inputs - 1)) + output,
                        output * comptime!(inputs - 1) + input,
                    );
                    partial[first + entry] = sum[comptime!(a * BLOCK + b)];
                }
            }
        }
    }
}
