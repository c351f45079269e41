//! The training losses of a neural surface, as pure functions over Burn tensors.
//!
//! Each loss takes tensors and returns a scalar tensor `[1]`, so that losses add up; [`row_losses()`] returns one number for
//! each of its terms, `[terms]`:
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use losses::{ColourLoss, Schedule, eikonal_loss};
//!
//! let device = Device::flex().autodiff();
//! let rendered = Tensor::<2>::from_floats([[0.5, 0.5, 0.5]], &device).require_grad();
//! let photo = Tensor::<2>::from_floats([[0.5, 0.5, 0.8]], &device);
//! let normals = Tensor::<2>::from_floats([[0.0, 0.0, 2.0]], &device).require_grad();
//!
//! let eikonal_weight = Schedule::Constant { value: 0.1 }.at(0);
//! let loss = ColourLoss::L2.loss(rendered.clone(), photo, None)
//!     + eikonal_loss(normals, None) * eikonal_weight;
//! assert!((loss.clone().into_scalar::<f32>() - (0.03 + 0.1)).abs() < 1e-6);
//!
//! // Two thirds of -0.3, the residual of the blue channel.
//! let gradient = rendered.grad(&loss.backward()).expect("tracked").into_data();
//! assert!((gradient.as_slice::<f32>().expect("f32")[2] + 0.2).abs() < 1e-6);
//! ```
//!
//! **Contents.** [`ColourLoss`] compares rendered and photographed colours, [`background_loss`] does so
//! for the background alone; [`eikonal_loss`], [`sparsity_loss`], [`point_loss`] and
//! [`curvature_loss`] shape the signed distance; [`mask_loss`] and [`opacity_entropy`] the opacity.
//! [`row_losses()`] takes many of those that are of the same rows in one pass, with kernels for CPUs and GPUs.
//! [`Schedule`] gives the weight of a loss, or the learning rate, at a training step.
//!
//! **Notation.** `rays` and `n` are numbers of rays and points. Weights `w` are one number per
//! element, not negative, on the device of the other tensors; no gradient flows into them. The
//! reduction is, but for [`row_losses()`], which adds up `w_i l_i` alone,
//!
//! ```text
//! L = sum_i w_i l_i / sum_i w_i,     w_i = 1 where no weights are given,
//! ```
//!
//! with 0 (and a gradient of 0) when there are no elements or all weights are zero. An element of
//! weight 0 is therefore ignored: neither its value nor its number counts. It must be finite for that, but for
//! [`row_losses()`], which ignores whatever it is: elsewhere `0 l_i` is no number where `l_i` is none.
//!
//! **Degenerate values** are the rule when training starts. Every loss and its gradient stay finite
//! for finite inputs, and for the infinite log transmittance of an opaque ray.
//!
//! **Panics.** A tensor of the wrong shape is a bug in the calling code: it panics with the name of
//! the loss, the argument and both shapes, or of the term that does not fit.
//!
//! **Features.** `wgpu` (and with it `vulkan` or `metal`) and `cuda` add [`row_losses()`]'s kernels for GPUs; all else is tensor
//! operations, which any backend has.

mod background;
mod colour;
mod curvature;
mod eikonal;
mod entropy;
mod huber;
mod mask;
mod points;
mod reduction;
pub mod row_losses;
mod schedule;
mod shape;
mod sparsity;

pub use background::background_loss;
pub use colour::ColourLoss;
pub use curvature::curvature_loss;
pub use eikonal::{eikonal_loss, eikonal_loss_of_lengths};
pub use entropy::opacity_entropy;
pub use mask::{OPACITY_OFFSET, ignore_band, mask_loss};
pub use points::{PointPenalty, point_loss};
pub use row_losses::{RowLoss, RowTerm, mean_weights, row_losses, row_losses_reference};
pub use schedule::{Knot, Knots, Schedule, ScheduleError};
pub use sparsity::{SparsityForm, sparsity_loss};
