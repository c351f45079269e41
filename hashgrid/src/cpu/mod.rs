//! The CPU kernels over plain slices: no backend, no tensors, no threads of their own.
//!
//! Points are in lanes: a tile's coordinates are three arrays, results are feature-major, and 16
//! points are handled at a time. [`encode_tile`] is the way forward; [`scatter_level`] the way
//! back into the table. Both choose the machine's vector instructions when called.

mod cells;
mod scatter;
mod tile;

pub use scatter::{scatter_level, scatter_level_marked};
pub use tile::encode_tile;
