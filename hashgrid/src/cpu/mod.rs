//! The CPU kernels over plain slices: no backend, no tensors, no threads of their own.
//!
//! Points are in lanes: a tile's coordinates are three arrays, results are feature-major, and 16
//! points are handled at a time. [`encode_tile`] is the way forward, or [`encode_level`] with so many
//! points that reading a level in order first costs less than its lines in no order; [`scatter_level`] the way back into the table. All choose the machine's vector instructions when called, and give
//! the same bits whichever those are: nothing is contracted or reassociated.
//!
//! Figures: 16384 scattered points, 16 levels, `T = 2^19`, one core of a Zen 5 with AVX-512, best of
//! many (`cargo bench -p hashgrid --bench encode -- one_core` measures the same): 2.9 ms for values
//! and 3.0 ms with the Jacobian; 3.3 and 3.8 ms back. What made the difference, in this order:
//! a table of 48 MiB does not fit the caches, so the next 16 points' cache lines are prefetched
//! between the loads of 16 (20 to 6 ms forward, 8 to 4 ms back, with all of them at once), and corners are loaded by pairs of
//! plain 8-byte loads instead of the gather instructions that the compiler would choose (6 to
//! 3 ms). Prefetching only one of two neighbours along x was worse by half; tiles of 1024 points
//! were no better than those of 256.

// Loops over lanes index several arrays at once; iterators would only hide that.
#![allow(clippy::needless_range_loop)]

mod cells;
mod level;
mod scatter;
#[cfg(test)]
mod tiers;
mod tile;

pub(crate) use cells::LANES;
#[cfg(any(feature = "cube", test))]
pub(crate) use cells::check_level;
pub use level::{encode_level, fetch, level_values};
pub(crate) use scatter::scatter_full;
pub use scatter::{NormalPart, ScatterRows, scatter_level};
pub use tile::encode_tile;
