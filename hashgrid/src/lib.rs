//! Multi-resolution hash encoding (Müller et al. 2022) for [Burn](burn), with value and Jacobian.
//!
//! A hash grid turns a point of the unit cube into `2 L` trainable features: `L` grids from coarse
//! to fine, two numbers at each node, blended within the cell that the point is in. Fine grids
//! have more nodes than their table has entries; a hash decides which share one. With a small
//! network behind it this is a fast-trained neural field.
//!
//! - [`encode()`] gives features, [`encode_with_jacobian`] also their derivatives by the position:
//!   what a normal of an implicit surface is made of. Each is one op with a hand-written backward
//!   for Burn's CPU backends, NdArray and Flex, and with a GPU feature for CubeCL's;
//!   [`mod@reference`] has the same in plain tensor ops.
//! - [`HashGrid`] is the table as a module; [`GridConfig`] says how it is built, [`GridLayout`]
//!   where its entries lie.
//! - [`cpu`] has the kernels over slices, for ops that fuse the encoding with what follows.
//! - A step touches a part of a table: [`SparseGrad`] collects gradients without anything of the
//!   table's size being written, and [`LazyAdam`] visits only what was touched. [`step_clock`] has its time.
//!
//! Positions are in `[0, 1]³` and everything is `f32`. Outside, coordinates are clamped, and the
//! derivative along them is zero. Levels can be switched on from coarse to fine in training: the
//! ops take the number of active ones, and the others' features are zero.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use hashgrid::{GridConfig, HashGrid};
//!
//! let device = Device::flex().autodiff();
//! let config = GridConfig { levels: 4, ..Default::default() };
//! let grid = HashGrid::new(&config, 1, &device);
//!
//! let points = Tensor::<2>::from_floats([[0.1, 0.2, 0.3], [0.5, 0.5, 0.5]], &device);
//! let (features, jacobian) = grid.forward_with_jacobian(points, 3);
//! assert_eq!(features.dims(), [2, 8]);
//! assert_eq!(jacobian.dims(), [2, 8, 3]);
//!
//! // Gradients reach the table through both.
//! let loss = features.powi_scalar(2).sum() + jacobian.powi_scalar(2).sum();
//! let gradients = loss.backward();
//! let table = grid.table.val().grad(&gradients).expect("the table is trainable");
//! assert_eq!(table.dims(), [grid.layout().entries(), 2]);
//! ```

pub mod cpu;
#[cfg(feature = "cube")]
pub mod cube;
pub mod step_clock;

mod config;
mod encode;
mod grid;
mod hash;
mod layout;
mod lazy_adam;
mod sparse_grad;
mod update;

pub use config::{GridConfig, GridConfigError, Interpolation, TableReads};
pub use encode::{EncodeConfig, EncodeOps, encode, encode_with_jacobian, reference};
pub use grid::HashGrid;
pub use hash::Hash;
pub use layout::{BLOCK_ENTRIES, FEATURES, GridLayout, LevelLayout};
pub use lazy_adam::{LazyAdam, LazyAdamConfig, MomentPrecision, RestoreError};
pub use sparse_grad::SparseGrad;
