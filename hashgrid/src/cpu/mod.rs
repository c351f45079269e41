//! The CPU kernels over plain slices: no backend, no tensors, no threads of their own.
//!
//! Points are in lanes: a tile's coordinates are three arrays, results are feature-major, and 16
//! points are handled at a time. [`encode_tile`] is the way forward; [`scatter_level`] the way
//! back into the table. Both choose the machine's vector instructions when called, and both give
//! the same bits whichever those are: nothing is contracted or reassociated.
//!
//! What made them fast (`cargo bench -p hashgrid`, group `one_core_16384`): a table of 48 MiB is
//! mostly in memory, so the next 16 points' cache lines are prefetched while 16 are blended (20 to
//! 6 ms forward, 8 to 4 ms back); corners are loaded by pairs of plain 8-byte loads rather than
//! gather instructions (6 to 3 ms). Prefetching only one of two neighbours along x lost half of
//! the gain; larger tiles than 256 points changed nothing.

// Loops over lanes index several arrays at once; iterators would only hide that.
#![allow(clippy::needless_range_loop)]

mod cells;
mod scatter;
#[cfg(test)]
mod tiers;
mod tile;

pub(crate) use cells::{LANES, PRIMES};
pub use scatter::{NormalPart, scatter_level, scatter_level_marked};
pub(crate) use scatter::{Slopes, scatter};
pub use tile::encode_tile;
