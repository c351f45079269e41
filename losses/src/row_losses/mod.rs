//! Many losses of the same rows in one pass, as one differentiable op.
//!
//! Rendered pixels are rows of a matrix, and most losses are sums over them of a function of a few columns. By tensor
//! operations each takes a dozen passes there and back, with a gradient of the whole matrix for every column that is
//! cut out; on a GPU what they cost is their launches. [`row_losses()`] goes through the rows once, and once back. What
//! each term says is written out in tensor operations by the loss that it names, and by [`row_losses_reference`].

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod adapters;
mod autodiff;
mod cpu;
#[cfg(feature = "cube")]
mod cube;
mod reference;

use burn::backend::{Backend, Dispatch, backend_extension, tensor::FloatTensor};
use burn::tensor::Tensor;

use crate::{ColourLoss, huber::expect_delta};

pub use reference::row_losses_reference;

/// The loss of one row. Columns are of the rows, but for those that are named as known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowLoss {
    /// [`ColourLoss`]: the mean over three columns from `colour` on against three known ones from `photo` on.
    Colour {
        /// How a difference is penalised.
        kind: ColourLoss,
        /// The rendered colour's first column.
        colour: usize,
        /// The photo's first known column.
        photo: usize,
    },
    /// [`mask_loss`](crate::mask_loss) with `log T = log(1 + e - A)`, `e` its [`OPACITY_OFFSET`](crate::OPACITY_OFFSET),
    /// which keeps a gradient where `A` is 1 and should be 0.
    Mask {
        /// The column of the opacity `A`, in [0, 1].
        opacity: usize,
        /// The known column of the mask, in [0, 1].
        mask: usize,
    },
    /// `max(0, most - seen)`, whose gradient flows to `seen` alone. It does where both are equal, too: what is just large
    /// enough is held there, as by a clamp.
    Shortfall {
        /// The column that is to become larger.
        seen: usize,
        /// The column that says how large.
        most: usize,
    },
    /// A column's value.
    Value {
        /// The column.
        column: usize,
    },
    /// [`eikonal_loss_of_lengths`](crate::eikonal_loss_of_lengths): `(length - 1)^2`.
    UnitLength {
        /// The length's column.
        length: usize,
    },
    /// [`sparsity_loss`](crate::sparsity_loss), in its plain form: `exp(-tau |sdf|)`.
    Sparsity {
        /// The signed distance's column.
        sdf: usize,
        /// Per unit of distance.
        tau: f32,
    },
    /// [`point_loss`](crate::point_loss), by its absolute value: `|sdf|`, for a point of the surface.
    Surface {
        /// The signed distance's column.
        sdf: usize,
    },
}

/// A loss that is summed up over all rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowTerm {
    /// What is summed up.
    pub loss: RowLoss,
    /// The known column of the rows' weights.
    pub weight: usize,
}

impl RowLoss {
    /// How many columns it needs, and known ones; of numbers that no matrix has, as many as there are numbers.
    fn needs(self) -> [usize; 2] {
        let up_to = |column: usize| column.saturating_add(1);
        match self {
            Self::Colour { colour, photo, .. } => {
                [colour.saturating_add(3), photo.saturating_add(3)]
            }
            Self::Mask { opacity, mask } => [up_to(opacity), up_to(mask)],
            Self::Shortfall { seen, most } => [up_to(seen.max(most)), 0],
            Self::Value { column: of }
            | Self::UnitLength { length: of }
            | Self::Sparsity { sdf: of, .. }
            | Self::Surface { sdf: of } => [up_to(of), 0],
        }
    }
}

/// `row_losses`, as backends supply it.
#[backend_extension(NdArray, Flex, Cube: cfg(feature = "cube"), Autodiff)]
pub trait RowLossesOps: Backend {
    /// See [`row_losses`].
    fn row_losses(
        rows: FloatTensor<Self>,
        known: FloatTensor<Self>,
        terms: Vec<RowTerm>,
    ) -> FloatTensor<Self>;
}

/// The sum of each term over all rows, `[terms]`:
///
/// ```text
/// L_t = sum_r w_tr l_t(row_r)
/// ```
///
/// `rows` is `[n, columns]`; `known` `[n, any]` is what is known of each row: targets, and weights, to which no gradient flows.
/// For a mean, weights are divided by their sum beforehand, as [`mean_weights`] does. A row of weight 0 adds nothing to a
/// term and has no gradient of it, even where the term's columns are no numbers.
///
/// # Panics
/// When there is no term, one names a column that is not there or a Huber delta that is no positive number, or `known` has
/// another number of rows.
///
/// ```
/// use burn::tensor::{Device, Tensor};
/// use losses::{ColourLoss, RowLoss, RowTerm, row_losses};
///
/// let device = Device::flex();
/// // Colour and opacity of two pixels; their photo, what their mask says, and a weight.
/// let rows = Tensor::<2>::from_floats([[0.5, 0.0, 0.0, 0.9], [0.1, 0.2, 0.3, 0.1]], &device);
/// let known = Tensor::<2>::from_floats([[0.2, 0., 0., 1.0, 0.5], [0.1, 0.2, 0.9, 0.0, 0.5]], &device);
/// let kind = ColourLoss::L1;
/// let terms = [
///     RowLoss::Colour { kind, colour: 0, photo: 0 },
///     RowLoss::Mask { opacity: 3, mask: 3 },
/// ];
/// let terms = terms.map(|loss| RowTerm { loss, weight: 4 });
///
/// let losses = row_losses(rows, known, terms.to_vec()).into_data();
/// let losses = losses.as_slice::<f32>().expect("f32");
/// assert!((losses[0] - (0.3 + 0.6) / 6.0).abs() < 1e-6);
/// assert!((losses[1] + 0.901_f32.ln()).abs() < 1e-6);
/// ```
#[must_use]
pub fn row_losses(rows: Tensor<2>, known: Tensor<2>, terms: Vec<RowTerm>) -> Tensor<1> {
    check(&rows.dims(), &known.dims(), &terms);
    Tensor::from_dispatch(Dispatch::row_losses(
        rows.into_dispatch(),
        known.into_dispatch(),
        terms,
    ))
}

/// What kernels rest on: the shapes of the rows and of what is known of them, and columns that are there.
fn check(rows: &[usize], known: &[usize], terms: &[RowTerm]) {
    let (&[n, columns], &[known_rows, known_columns]) = (rows, known) else {
        panic!("row_losses: rows are {rows:?} and known {known:?}, not matrices");
    };
    assert!(
        known_rows == n,
        "row_losses: known has shape {known:?}, expected {:?}",
        [n, known_columns]
    );
    assert!(!terms.is_empty(), "row_losses: no terms");
    for term in terms {
        let [read, from_known] = term.loss.needs();
        assert!(
            read <= columns && from_known <= known_columns && term.weight < known_columns,
            "row_losses: {term:?} is of more than {columns} columns and {known_columns} known ones"
        );
        if let RowLoss::Colour {
            kind: ColourLoss::Huber { delta },
            ..
        } = term.loss
        {
            expect_delta("row_losses", delta);
        }
    }
}

/// Weights of which the sum is 1, for a mean; all of them 0 where the sum is.
#[must_use]
pub fn mean_weights(mut weights: Vec<f32>) -> Vec<f32> {
    let sum: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
    let share = if sum > 0.0 { 1.0 / sum } else { 0.0 };
    for weight in &mut weights {
        *weight = (f64::from(*weight) * share) as f32;
    }
    weights
}
