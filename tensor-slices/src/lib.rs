//! Burn's CPU tensors as plain `f32` slices.
//!
//! A custom op is written once, over slices. What differs between Burn's two CPU backends is only
//! how a tensor lends its memory, and that difference lives here: [`F32Slices`] is implemented for
//! [`NdArray`](burn::backend::NdArray) and [`Flex`](burn::backend::Flex), and an op's adapter for
//! either is a few lines:
//!
//! ```
//! use burn::backend::{Flex, tensor::FloatTensor};
//! use tensor_slices::F32Slices;
//!
//! fn twice<B: F32Slices>(tensor: FloatTensor<B>, len: usize) -> FloatTensor<B> {
//!     let values = B::as_f32(&tensor).iter().map(|v| 2.0 * v).collect();
//!     B::from_f32(values, [len])
//! }
//!
//! let tensor = Flex::from_f32(vec![1.0, 2.5], [2]);
//! assert_eq!(&*Flex::as_f32(&twice::<Flex>(tensor, 2)), &[2.0, 5.0]);
//! ```
//!
//! The other way, [`matrix()`] makes a tensor of numbers from the host that is row-major on every device, GPUs included.

pub mod elementary;
mod flex;
mod matrix;
mod ndarray;
mod past_caches;
mod scratch;
mod stopwatch;

use std::borrow::Cow;

use burn::backend::{Backend, tensor::FloatTensor};

pub use matrix::matrix;
pub use past_caches::copy_past_caches;
pub use scratch::Scratch;
pub use stopwatch::{Lap, Stopwatch};

/// A CPU backend whose float tensors can be read and written as `f32` slices in row-major order.
pub trait F32Slices: Backend {
    /// The tensor's values in row-major order; borrowed when it is contiguous, else copied.
    ///
    /// # Panics
    /// When the tensor is not of type `f32`: the ops of this workspace are single precision.
    fn as_f32(tensor: &FloatTensor<Self>) -> Cow<'_, [f32]>;

    /// A tensor that owns `values`, row-major, without copying them.
    ///
    /// # Panics
    /// When the shape's product is not the number of values.
    fn from_f32<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FloatTensor<Self>;

    /// Hands the tensor's values to `update` in row-major order and returns the changed tensor.
    ///
    /// In place, without a copy, when this is the only owner of contiguous memory.
    fn update_f32(tensor: FloatTensor<Self>, update: impl FnOnce(&mut [f32])) -> FloatTensor<Self>;
}
