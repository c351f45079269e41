//! A table's entries as kernels read them: as they are, or from a copy of half the size.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use gpu_tensors::{CubeTensor, buffer, contiguous, cubecl, fresh_words, units_for};

use super::{Pair, pair};
use crate::config::TableReads;
use crate::layout::{FEATURES, GridLayout};
use cubecl::prelude::*;

/// How a kernel reads the entries of a table.
#[cube]
pub trait Entries: 'static + Send + Sync {
    /// An entry in memory.
    type Word: CubePrimitive;

    /// Both features of entry `at`.
    fn entry(table: &[Self::Word], at: usize) -> Pair;
}

/// The table itself.
pub struct Single;

#[cube]
impl Entries for Single {
    type Word = Pair;

    fn entry(table: &[Pair], at: usize) -> Pair {
        table[at]
    }
}

/// A copy with both features in one word, the first in its lower half.
pub struct Half;

#[cube]
impl Entries for Half {
    type Word = u32;

    fn entry(table: &[u32], at: usize) -> Pair {
        let word = table[at];
        pair(from_half(word & 0xFFFF), from_half(word >> 16))
    }
}

/// A table on a device, as [`Entries`] reads it.
#[derive(Clone, Debug)]
pub struct DeviceTable {
    data: CubeTensor,
    /// What it holds.
    pub reads: TableReads,
}

impl DeviceTable {
    /// Of a table `[entries, 2]`: itself, or a copy, as its layout says.
    ///
    /// # Panics
    /// When the table is of another shape than the layout asks for, or not of type `f32`.
    #[must_use]
    pub fn new(table: CubeTensor, layout: &GridLayout) -> Self {
        let (shape, expected) = (table.meta.shape(), [layout.entries(), FEATURES]);
        assert!(
            shape[..] == expected,
            "DeviceTable: table is {shape:?}, but the layout asks for {expected:?}"
        );
        let reads = layout.device_reads;
        let table = contiguous(table);
        let data = match reads {
            TableReads::Single => table,
            TableReads::Half => halved(&table),
        };
        Self { data, reads }
    }

    /// The memory as a kernel's argument.
    #[must_use]
    pub fn buffer(&self) -> BufferArg {
        buffer(&self.data)
    }
}

/// A copy in half precision, `[entries]`.
fn halved(table: &CubeTensor) -> CubeTensor {
    let entries = table.meta.shape()[0];
    let halves = fresh_words(table, [entries]);
    let (count, dim) = units_for(&halves.client, entries);
    // SAFETY: threads beyond the entries return at once.
    unsafe {
        halve_kernel::launch_unchecked(
            &halves.client,
            count,
            dim,
            buffer(table),
            buffer(&halves),
            entries as u32,
        );
    }
    halves
}

/// One thread per entry.
#[cube(launch_unchecked)]
fn halve_kernel(table: &[Pair], halves: &mut [u32], entries: u32) {
    if ABSOLUTE_POS < entries as usize {
        let both = table[ABSOLUTE_POS];
        let first = to_half(both.extract(0usize));
        halves[ABSOLUTE_POS] = first | to_half(both.extract(1usize)) << 16;
    }
}

/// The exponent's bias in `f32` above that in half precision, in its place.
const BIAS: u32 = 112 << 23;
/// The smallest normal number of half precision, 2^-14, as an `f32`'s bits.
const SMALLEST: u32 = 113 << 23;
/// From here on the exponent is too large, 2^16, as an `f32`'s bits.
const TOO_LARGE: u32 = 143 << 23;
/// Half, as an `f32`'s bits: numbers next to it are 2^-24 apart, as small ones are in half precision.
const ONE_HALF: u32 = 126 << 23;

/// By integers, for a device need not have the type: to nearest, ties to even.
#[cube]
fn to_half(x: f32) -> u32 {
    let bits = u32::reinterpret(x);
    let size = bits & 0x7FFF_FFFF;
    // For numbers below the smallest this wraps around, and is not used.
    let rounded = (size + 0xFFF + (size >> 13 & 1) - BIAS) >> 13;
    let small = u32::reinterpret(f32::reinterpret(size) + 0.5f32) - ONE_HALF;
    let special = select(size > 0x7F80_0000, 0x7E00u32, 0x7C00u32);
    let half = select(
        size < SMALLEST,
        small,
        select(size < TOO_LARGE, rounded, special),
    );
    half | bits >> 16 & 0x8000
}

/// Exact.
#[cube]
fn from_half(half: u32) -> f32 {
    let size = (half & 0x7FFF) << 13;
    // Infinities and what is no number have the largest exponent here and there.
    let bias = select(size >= comptime!(31u32 << 23), 2 * BIAS, BIAS);
    // With an exponent of one, which brings a one before the point.
    let small = f32::reinterpret(size + SMALLEST) - comptime!(f32::from_bits(SMALLEST));
    let value = select(
        size < comptime!(1u32 << 23),
        small,
        f32::reinterpret(size + bias),
    );
    f32::reinterpret(u32::reinterpret(value) | (half & 0x8000) << 16)
}
