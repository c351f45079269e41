//! What this workspace's GPU kernels share: Burn's CubeCL tensors as kernel arguments.
//!
//! A custom op has its kernels in `cube.rs` next to its CPU kernel. What all of them need lives
//! here: contiguous inputs and fresh outputs, a grid of workgroups for any number of items, sums
//! of `f32` by many threads at once, running sums of counts, elementary functions that keep their digits, and a network's
//! layers at many points with their weights' gradients.
//!
//! Everything is behind the feature `cube`, which the runtimes' features (`wgpu`, `vulkan`,
//! `metal`, `cuda`) turn on; without it the crate is empty, and so is its dependency tree.

#[cfg(feature = "cube")]
mod adam;
#[cfg(feature = "wgpu")]
mod adapters;
#[cfg(feature = "cube")]
mod atomic;
#[cfg(feature = "cube")]
mod constants;
#[cfg(feature = "cube")]
mod dense;
#[cfg(feature = "cube")]
mod elementary;
#[cfg(feature = "cube")]
mod outer;
#[cfg(feature = "cube")]
mod points;
#[cfg(feature = "cube")]
mod rates;
#[cfg(all(test, feature = "wgpu"))]
mod refusals;
#[cfg(feature = "cube")]
mod running_sums;
#[cfg(feature = "cube")]
mod sums;
#[cfg(feature = "cube")]
mod tensor;

#[cfg(feature = "cube")]
pub use adam::{AdamRule, AdamSteps};
#[cfg(feature = "wgpu")]
pub use adapters::{Adapter, AdapterKind, adapters};
#[cfg(feature = "cube")]
pub use atomic::{AtomicSum, CompareAndSwap, NativeSum, has_native_sum, refuse_native_sums};
#[cfg(feature = "cube")]
pub use burn_cubecl::{CubeDevice, cubecl, tensor::CubeTensor};
#[cfg(feature = "cube")]
pub use constants::constant;
#[cfg(feature = "cube")]
pub use dense::{Packed, WeightReads};
#[cfg(feature = "cube")]
pub use elementary::{exp_m1, ln_1p, sigmoid, softplus};
#[cfg(feature = "cube")]
pub use outer::layer_gradients;
#[cfg(feature = "cube")]
pub use points::{BLOCK, LANES, PointMatrix, Quad, padded};
#[cfg(feature = "cube")]
pub use rates::{DeviceFailed, Rates, finish};
#[cfg(feature = "cube")]
pub use running_sums::running_sums;
#[cfg(feature = "cube")]
pub use sums::column_sums;
#[cfg(feature = "cube")]
pub use tensor::{
    UNITS, Uploaded, add, buffer, contiguous, contiguous_words, copy, fresh, fresh_words,
    from_slice, own, points_at_once, points_within, poison_fresh_memory, read, units_for,
    workgroups, zero_words, zeros,
};
