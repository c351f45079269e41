//! The op over slices, independent of any backend.

mod backward;
mod forward;
mod weights;

pub use backward::BACKWARD;
pub(crate) use backward::backward;
pub use forward::{EVALUATION, FORWARD};
pub(crate) use forward::{Keep, Saved, forward};
pub(crate) use weights::{Weights, transposed};
