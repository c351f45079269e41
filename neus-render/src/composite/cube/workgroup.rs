//! What the threads of a workgroup find out together, by way of the memory that they share.
//!
//! Everything is combined in an order that does not change from run to run. Meetings are few, because
//! drivers that run kernels on CPUs pay for each; all threads of a workgroup must come to them.

use gpu_tensors::cubecl;

use cubecl::prelude::*;

/// Threads of a workgroup.
pub(super) const UNITS: usize = gpu_tensors::UNITS as usize;

/// Neighbours that each thread goes through by itself, before it goes through the blocks' totals.
const BLOCK: usize = 8;
const BLOCKS: usize = UNITS / BLOCK;
/// Where the blocks' totals are in memory: behind what the threads bring.
const TOTALS: usize = 2 * UNITS;

/// Shared memory that [`scan`] needs.
pub(super) const SCAN: usize = TOTALS + 2 * BLOCKS;

/// Shared memory that [`column_sum`] needs.
pub(super) const fn columns_size(columns: usize) -> usize {
    UNITS * stride(columns)
}

/// Values from one thread's to the next's: odd, so that threads do not wait for the same bank of memory.
const fn stride(columns: usize) -> usize {
    columns | 1
}

/// What two values become.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Combined {
    Product,
    Sum,
}

/// A value of the object's and one of the background's.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Pair {
    pub(super) object: f32,
    pub(super) background: f32,
}

/// What is before a position, and up to the end.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Scanned {
    pub(super) before: Pair,
    pub(super) all: Pair,
}

#[cube]
fn combined(a: f32, b: f32, #[comptime] by: Combined) -> f32 {
    if comptime!(by == Combined::Product) {
        a * b
    } else {
        a + b
    }
}

/// What changes nothing.
#[cube]
fn neutral(#[comptime] by: Combined) -> f32 {
    if comptime!(by == Combined::Product) {
        1.0f32.runtime()
    } else {
        0.0f32.runtime()
    }
}

/// Combines `carried` with what the threads at lower positions bring, and with what all bring. Each thread has a
/// position of its own. Memory may be scanned again at once: between them, the two meetings part all reads
/// from the next writes.
#[cube]
pub(super) fn scan(
    memory: &mut [f32],
    position: usize,
    own: Pair,
    carried: Pair,
    #[comptime] by: Combined,
) -> Scanned {
    let block = position / BLOCK;
    memory[position] = own.object;
    memory[position + UNITS] = own.background;
    sync_cube();
    let mut object = neutral(by);
    let mut background = neutral(by);
    for i in block * BLOCK..position {
        object = combined(object, memory[i], by);
        background = combined(background, memory[i + UNITS], by);
    }
    if position % BLOCK == comptime!(BLOCK - 1) {
        memory[block + TOTALS] = combined(object, own.object, by);
        memory[block + comptime!(TOTALS + BLOCKS)] = combined(background, own.background, by);
    }
    sync_cube();
    let mut all_object = carried.object;
    let mut all_background = carried.background;
    let mut object_before = carried.object;
    let mut background_before = carried.background;
    #[unroll]
    for i in 0..BLOCKS {
        all_object = combined(all_object, memory[comptime!(TOTALS + i)], by);
        all_background = combined(all_background, memory[comptime!(TOTALS + BLOCKS + i)], by);
        let before = block > i;
        object_before = select(before, all_object, object_before);
        background_before = select(before, all_background, background_before);
    }
    Scanned {
        before: Pair {
            object: combined(object_before, object, by),
            background: combined(background_before, background, by),
        },
        all: Pair {
            object: all_object,
            background: all_background,
        },
    }
}

/// In the thread of a column's number, the column's sum over the first `used` threads.
#[cube]
pub(super) fn column_sum(
    memory: &mut [f32],
    own: &Array<f32>,
    used: usize,
    #[comptime] columns: usize,
) -> f32 {
    let unit = UNIT_POS as usize;
    let stride = comptime!(stride(columns));
    #[unroll]
    for c in 0..columns {
        memory[unit * stride + c] = own[c];
    }
    sync_cube();
    let mut sum = 0.0f32;
    if unit < columns {
        for other in 0..used {
            sum += memory[other * stride + unit];
        }
    }
    sum
}
