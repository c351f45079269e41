//! Grids on the GPU: one thread for each cell with news, and one for each word of bits.

use burn::backend::{
    Cube,
    tensor::{FloatTensor, IntTensor},
};
use gpu_tensors::{buffer, contiguous, contiguous_words, cubecl, fresh_words, own, units_for};

use super::device::OccupancyOps;
use cubecl::prelude::*;

/// Cells of a word.
const WORD: usize = 32;

impl OccupancyOps for Cube {
    fn occupancy_update(
        values: FloatTensor<Self>,
        cells: IntTensor<Self>,
        news: FloatTensor<Self>,
        decay: f32,
    ) -> FloatTensor<Self> {
        let values = own(values);
        let (existing, count) = (values.meta.shape()[0], cells.meta.shape()[0]);
        if count == 0 {
            return values;
        }
        let client = &values.client;
        let (cubes, dim) = units_for(client, count);
        // SAFETY: threads beyond the news return at once, as do those whose cell doesn't exist; there is a
        // cell for each of the news.
        unsafe {
            update_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&values),
                buffer(&contiguous_words(cells)),
                buffer(&contiguous(news)),
                count as u32,
                existing as u32,
                decay,
            );
        }
        values
    }

    fn occupancy_bits(
        values: FloatTensor<Self>,
        protected: IntTensor<Self>,
        threshold: f32,
    ) -> IntTensor<Self> {
        let (cells, words) = (values.meta.shape()[0], protected.meta.shape()[0]);
        let bits = fresh_words(&values, [words]);
        let client = &bits.client;
        let (cubes, dim) = units_for(client, words);
        // SAFETY: threads beyond the words return at once, and words end with the cells.
        unsafe {
            bits_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&contiguous(values)),
                buffer(&contiguous_words(protected)),
                buffer(&bits),
                cells as u32,
                words as u32,
                threshold,
            );
        }
        bits
    }
}

/// Whether `x` is a number, by its bits: comparisons of what is none are not the same on all devices.
#[cube]
fn is_number(x: f32) -> bool {
    u32::reinterpret(x) & 0x7FFF_FFFFu32 <= 0x7F80_0000u32
}

/// One thread for each of the news. Where several are of one cell, they are taken in one after the other: the
/// value is exchanged only while it is what the new one was made from.
#[cube(launch_unchecked)]
fn update_kernel(
    values: &[Atomic<u32>],
    cells: &[u32],
    news: &[f32],
    count: u32,
    existing: u32,
    decay: f32,
) {
    if ABSOLUTE_POS < count as usize {
        let cell = cells[ABSOLUTE_POS];
        let new = news[ABSOLUTE_POS];
        let is_news = is_number(new);
        if cell < existing {
            let value = &values[cell as usize];
            let mut expected = value.load();
            let mut done = false;
            while !done {
                let faded = f32::reinterpret(expected) * decay;
                let stays = !is_news || (is_number(faded) && faded >= new);
                let next = u32::reinterpret(select(stays, faded, new));
                let found = value.compare_exchange_weak(expected, next);
                done = found == expected;
                expected = found;
            }
        }
    }
}

/// One thread per word.
#[cube(launch_unchecked)]
fn bits_kernel(
    values: &[f32],
    protected: &[u32],
    bits: &mut [u32],
    cells: u32,
    words: u32,
    threshold: f32,
) {
    if ABSOLUTE_POS < words as usize {
        let first = ABSOLUTE_POS * WORD;
        let mut word = protected[ABSOLUTE_POS];
        // The last word may have no cells at all.
        let cells = max(cells as usize, first) - first;
        for i in 0..min(WORD, cells) {
            let occupied = values[first + i] > threshold;
            word |= select(occupied, 1u32, 0u32) << i as u32;
        }
        bits[ABSOLUTE_POS] = word;
    }
}
