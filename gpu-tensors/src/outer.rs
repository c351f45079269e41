//! Weight gradients of layers: sums of outer products over all points.
//!
//! Library matrix products are made for large results; these are a few dozen wide and thousands to
//! hundreds of thousands long. A workgroup brings some points of both matrices into its own memory, where each of its
//! threads adds up a block of eight by eight entries; it goes on so through one chunk of the points. Another kernel adds
//! the chunks.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::points::{BLOCK, LANES, PointMatrix, Quad, Quads, padded, zero_quads};
use crate::sums::add_rows_apart;
use crate::tensor::{buffer, fresh, workgroups, zeros};

/// Points that are in a workgroup's memory at once, by fours.
const DEPTH: usize = 4;

/// Points that a workgroup adds up by itself: enough workgroups for large devices, few enough sums to add afterwards, and
/// no more than 64 MiB of them, `width` values for each chunk. The order of the sum, and so its bits, depend on these
/// sizes alone.
fn chunk(points: usize, width: usize) -> usize {
    const STEP: usize = DEPTH * LANES;
    const MOST_VALUES: usize = 16 << 20;
    let fitting = points.div_ceil((MOST_VALUES / width).max(1));
    let least = points.div_ceil(512).clamp(64, 256).max(fitting);
    least.next_multiple_of(STEP)
}

/// How a workgroup's threads share the entries: blocks of outputs by blocks of inputs, one for each thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Tile {
    outputs: usize,
    inputs: usize,
}

impl Tile {
    /// Blocks of outputs, and of inputs, that one workgroup takes at most: 72 threads, 8.5 KiB.
    const MOST: [usize; 2] = [8, 9];

    /// For a layer's gradient of so many outputs and inputs.
    fn of(outputs: usize, inputs: usize) -> Self {
        let [outputs, inputs] = [(outputs, Self::MOST[0]), (inputs, Self::MOST[1])].map(
            |(count, most): (usize, usize)| {
                let blocks = padded(count) / BLOCK;
                blocks.div_ceil(blocks.div_ceil(most))
            },
        );
        Self { outputs, inputs }
    }

    /// Threads for each entry block, which share the points: where there are few blocks, loads are shared by more.
    fn slices(self) -> usize {
        let most = Self::MOST[0] * Self::MOST[1] / (self.outputs * self.inputs);
        if most >= DEPTH {
            DEPTH
        } else if most >= 2 {
            2
        } else {
            1
        }
    }

    fn threads(self) -> usize {
        self.slices() * self.outputs * self.inputs
    }

    /// Quads that a thread brings of so many blocks of rows.
    fn loads(self, blocks: usize) -> usize {
        (DEPTH * blocks * BLOCK).div_ceil(self.threads())
    }
}

/// The gradients of a layer `[outputs, inputs]` and its bias: `G X^T` for the gradients `G` of its
/// outputs and its inputs `X`, whose last row is the bias' input.
///
/// # Panics
/// When they are not of the same points, one has no rows, or data do not have what rows and points promise.
#[must_use]
pub fn layer_gradients(gradient: &PointMatrix, x: &PointMatrix) -> (CubeTensor, CubeTensor) {
    assert_eq!(gradient.points, x.points, "layer_gradients: points");
    for matrix in [gradient, x] {
        matrix.expect_whole("layer_gradients");
        assert!(matrix.rows > 0, "layer_gradients: a matrix without rows");
    }
    let (outputs, inputs) = (gradient.rows, x.rows - 1);
    let like = &x.data;
    if x.points == 0 {
        return (zeros(like, [outputs, inputs]), zeros(like, [outputs]));
    }
    let tile = Tile::of(outputs, x.rows);
    let chunk = chunk(x.points, tile.slices() * outputs * x.rows);
    let chunks = x.points.div_ceil(chunk);
    let partial = fresh(like, [tile.slices() * chunks, outputs * x.rows]);
    let tiles = (padded(outputs) / BLOCK).div_ceil(tile.outputs)
        * (padded(x.rows) / BLOCK).div_ceil(tile.inputs);
    let client = &like.client;
    let (count, dim) = workgroups(client, chunks * tiles, tile.threads());
    // SAFETY: workgroups beyond the tiles write nothing, and matrices are padded to whole blocks.
    unsafe {
        products_kernel::launch_unchecked(
            client,
            count,
            dim,
            buffer(&gradient.data),
            buffer(&x.data),
            buffer(&partial),
            (x.points / LANES) as u32,
            chunks as u32,
            (chunk / LANES) as u32,
            outputs,
            x.rows,
            tile,
        );
    }
    add_rows_apart(&partial, [outputs, inputs], [outputs])
}

/// One workgroup for each tile of entries and each chunk of points. The last input's entries follow all others.
///
/// A thread's rows are not next to each other but a tile's eighth apart, so that neighbours read neighbours.
#[cube(launch_unchecked)]
fn products_kernel(
    gradient: &[Quad],
    x: &[Quad],
    partial: &mut [f32],
    quads: u32,
    chunks: u32,
    chunk: u32,
    #[comptime] outputs: usize,
    #[comptime] inputs: usize,
    #[comptime] tile: Tile,
) {
    let (quads_across, chunks, chunk_quads) = (quads as usize, chunks as usize, chunk as usize);
    let across = comptime!((padded(inputs) / BLOCK).div_ceil(tile.inputs));
    let (chunk, number) = (CUBE_POS % chunks, CUBE_POS / chunks);
    let first_output = number / across * comptime!(tile.outputs * BLOCK);
    let first_input = number % across * comptime!(tile.inputs * BLOCK);
    let unit = UNIT_POS as usize;
    let slice = unit / comptime!(tile.outputs * tile.inputs);
    let block = unit % comptime!(tile.outputs * tile.inputs);
    let (a, b) = (
        block / comptime!(tile.inputs),
        block % comptime!(tile.inputs),
    );
    let mut left = Shared::<[Quad]>::new_slice(comptime!(DEPTH * tile.outputs * BLOCK));
    let mut right = Shared::<[Quad]>::new_slice(comptime!(DEPTH * tile.inputs * BLOCK));
    // As [`Quads`], and for the same reason.
    let mut sum = Sequence::<RuntimeCell<f32>>::new();
    #[unroll]
    for _ in 0..comptime!(BLOCK * BLOCK) {
        sum.push(RuntimeCell::new(0.0f32));
    }
    let first = chunk * chunk_quads;
    let end = min(first + chunk_quads, quads_across);
    // What comes next is on its way while the threads multiply: a load waits for no other.
    let next_left = zero_quads(comptime!(tile.loads(tile.outputs)));
    let next_right = zero_quads(comptime!(tile.loads(tile.inputs)));
    let mut start = first;
    load(
        &next_left,
        gradient,
        (first_output, outputs),
        (start, end),
        quads_across,
        tile.outputs,
        tile,
    );
    load(
        &next_right,
        x,
        (first_input, inputs),
        (start, end),
        quads_across,
        tile.inputs,
        tile,
    );
    // As often in all threads: none may miss a meeting.
    while start < end {
        put(&next_left, &mut left, tile.outputs, tile);
        put(&next_right, &mut right, tile.inputs, tile);
        start += DEPTH;
        load(
            &next_left,
            gradient,
            (first_output, outputs),
            (start, end),
            quads_across,
            tile.outputs,
            tile,
        );
        load(
            &next_right,
            x,
            (first_input, inputs),
            (start, end),
            quads_across,
            tile.inputs,
            tile,
        );
        sync_cube();
        for turn in 0..comptime!(DEPTH / tile.slices()) {
            let d = turn * comptime!(tile.slices()) + slice;
            let left_at = d * comptime!(tile.outputs * BLOCK) + a;
            let right_at = d * comptime!(tile.inputs * BLOCK) + b;
            let mut others = Sequence::<Quad>::new();
            #[unroll]
            for j in 0..BLOCK {
                others.push(right[right_at + comptime!(j * tile.inputs)]);
            }
            #[unroll]
            for i in 0..BLOCK {
                let one = left[left_at + comptime!(i * tile.outputs)];
                #[unroll]
                for j in 0..BLOCK {
                    let other = others[j];
                    let mut entry = sum[comptime!(i * BLOCK + j)].read();
                    #[unroll]
                    for lane in 0..LANES {
                        entry = fma(one.extract(lane), other.extract(lane), entry);
                    }
                    sum[comptime!(i * BLOCK + j)].store(entry);
                }
            }
        }
        sync_cube();
    }
    let from = (chunk * comptime!(tile.slices()) + slice) * comptime!(outputs * inputs);
    #[unroll]
    for i in 0..BLOCK {
        #[unroll]
        for j in 0..BLOCK {
            let output = first_output + a + comptime!(i * tile.outputs);
            let input = first_input + b + comptime!(j * tile.inputs);
            if output < outputs && input < inputs {
                let entry = select(
                    input == comptime!(inputs - 1),
                    comptime!(outputs * (inputs - 1)) + output,
                    output * comptime!(inputs - 1) + input,
                );
                partial[from + entry] = sum[comptime!(i * BLOCK + j)].read();
            }
        }
    }
}

/// Asks for points: of the rows from the first on, as many blocks, and of their `stride` quads those from the start on;
/// zeros beyond what there is of either.
#[cube]
fn load(
    next: &Quads,
    matrix: &[Quad],
    rows: (usize, usize),
    points: (usize, usize),
    stride: usize,
    #[comptime] blocks: usize,
    #[comptime] tile: Tile,
) {
    #[unroll]
    for n in 0..comptime!(tile.loads(blocks)) {
        let at = UNIT_POS as usize + comptime!(n * tile.threads());
        let (row, quad) = (rows.0 + at / DEPTH, points.0 + at % DEPTH);
        let value = matrix[min(row, rows.1 - 1) * stride + min(quad, points.1 - 1)];
        next[n].store(select(
            row < rows.1 && quad < points.1,
            value,
            Quad::new(0.0f32),
        ));
    }
}

/// Puts what was asked for into the workgroup's memory.
#[cube]
fn put(next: &Quads, staged: &mut [Quad], #[comptime] blocks: usize, #[comptime] tile: Tile) {
    #[unroll]
    for n in 0..comptime!(tile.loads(blocks)) {
        let at = UNIT_POS as usize + comptime!(n * tile.threads());
        if at < comptime!(DEPTH * blocks * BLOCK) {
            staged[at % DEPTH * comptime!(blocks * BLOCK) + at / DEPTH] = next[n].read();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_chunks_fit_what_every_device_binds() {
        for points in [1, 64, 16_384, 131_072, 10_000_000] {
            for width in [3 * 65, 64 * 65, 512 * 513, 2048 * 2049] {
                let chunk = chunk(points, width);
                assert!(chunk.is_multiple_of(DEPTH * LANES), "{points}, {width}");
                let bytes = points.div_ceil(chunk) * width * size_of::<f32>();
                assert!(bytes <= 64 << 20, "{points}, {width}: {bytes}");
            }
        }
        assert_eq!(chunk(131_072, 64 * 65), 256);
    }
}
