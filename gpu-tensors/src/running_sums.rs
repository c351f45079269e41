//! Where each of many lists begins when they are put one behind the other.
//!
//! One thread adds up a chunk of counts; the chunks' totals are summed in the same way, until one chunk is
//! left. Whole numbers: the order doesn't matter.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{buffer, fresh_words, units_for, zero_words};

/// Counts that one thread adds up by itself.
const CHUNK: usize = 64;

/// Counts and their bound must not be larger, for sums of two not to wrap around.
const LARGEST: u32 = i32::MAX as u32;

/// The sums of the first `0, 1, …, n` of the counts `[n]`: `[n + 1]`, whole numbers.
///
/// A sum above `most` is `most`. No count may be above `i32::MAX`.
///
/// # Panics
/// When `most` is above `i32::MAX`.
#[must_use]
pub fn running_sums(counts: &CubeTensor, most: u32) -> CubeTensor {
    assert!(
        most <= LARGEST,
        "running_sums: a bound of {most} is above {LARGEST}"
    );
    let n = counts.meta.shape()[0];
    if n == 0 {
        return zero_words(counts, [1]);
    }
    let chunks = n.div_ceil(CHUNK);
    let (client, sums) = (&counts.client, fresh_words(counts, [n + 1]));
    let (cubes, dim) = units_for(client, chunks);
    let before = if chunks == 1 {
        zero_words(counts, [1])
    } else {
        let totals = fresh_words(counts, [chunks]);
        // SAFETY: threads beyond the chunks return at once, and chunks end with the counts.
        unsafe {
            totals_kernel::launch_unchecked(
                client,
                cubes.clone(),
                dim,
                buffer(counts),
                buffer(&totals),
                n as u32,
                most,
            );
        }
        running_sums(&totals, most)
    };
    // SAFETY: as above; there is a sum more than counts.
    unsafe {
        sums_kernel::launch_unchecked(
            client,
            cubes,
            dim,
            buffer(counts),
            buffer(&before),
            buffer(&sums),
            n as u32,
            most,
        );
    }
    sums
}

/// One thread per chunk.
#[cube(launch_unchecked)]
fn totals_kernel(counts: &[u32], totals: &mut [u32], n: u32, most: u32) {
    let first = ABSOLUTE_POS * CHUNK;
    if first < n as usize {
        let mut sum = 0u32;
        for i in 0..min(CHUNK, n as usize - first) {
            sum = min(sum + counts[first + i], most);
        }
        totals[ABSOLUTE_POS] = sum;
    }
}

/// One thread per chunk, which begins at the sum of those before it.
#[cube(launch_unchecked)]
fn sums_kernel(counts: &[u32], before: &[u32], sums: &mut [u32], n: u32, most: u32) {
    let first = ABSOLUTE_POS * CHUNK;
    if first < n as usize {
        let mut sum = before[ABSOLUTE_POS];
        if first == 0 {
            sums[0] = 0u32;
        }
        for i in 0..min(CHUNK, n as usize - first) {
            sum = min(sum + counts[first + i], most);
            sums[first + i + 1] = sum;
        }
    }
}
