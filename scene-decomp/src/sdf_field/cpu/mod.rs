//! The op over slices, independent of any backend.

mod backward;
mod by_levels;
mod forward;
mod forward_tile;
mod passes;
mod tape;
mod weights;

pub use backward::BACKWARD;
pub(crate) use backward::backward;
pub use forward::{EVALUATION, FORWARD};
pub(crate) use forward::{Keep, Saved, forward, forward_from_tape, forward_to_tape};
pub use tape::{Tape, TapedRows};
pub(crate) use weights::{Weights, transposed};
