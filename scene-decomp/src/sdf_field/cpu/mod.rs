//! The op over slices, independent of any backend.

mod backward;
mod forward;
mod weights;

pub(crate) use backward::backward;
pub(crate) use forward::{Keep, Saved, forward};
pub(crate) use weights::{Weights, transposed};
