//! The same in plain tensor operations, which Burn differentiates: the oracle of the kernels.

use burn::tensor::Tensor;

use super::{RowLoss, RowTerm, check};
use crate::{ColourLoss, OPACITY_OFFSET, huber::huber};

/// [`row_losses`](super::row_losses) in plain tensor operations, for tests and for reading.
///
/// # Panics
/// As there.
#[must_use]
pub fn row_losses_reference(rows: Tensor<2>, known: Tensor<2>, terms: &[RowTerm]) -> Tensor<1> {
    check(&rows.dims(), &known.dims(), terms);
    let known = known.detach();
    let sums = terms.iter().map(|term| {
        let weights = known.clone().narrow(1, term.weight, 1);
        let ignored = weights.clone().equal_elem(0.0);
        // Before the loss is taken: afterwards its slope would be none where it is no number, whatever that is multiplied by.
        let [rows, known] = [&rows, &known].map(|matrix| {
            matrix
                .clone()
                .mask_fill(ignored.clone().expand(matrix.dims()), 0.0)
        });
        (loss_of_rows(term.loss, &rows, &known) * weights).sum()
    });
    Tensor::cat(sums.collect(), 0)
}

/// `[n, 1]`.
fn loss_of_rows(loss: RowLoss, rows: &Tensor<2>, known: &Tensor<2>) -> Tensor<2> {
    let column = |first: usize, count: usize| rows.clone().narrow(1, first, count);
    let known = |first: usize, count: usize| known.clone().narrow(1, first, count);
    match loss {
        RowLoss::Colour {
            kind,
            colour,
            photo,
        } => {
            let residual = column(colour, 3) - known(photo, 3);
            let each = match kind {
                ColourLoss::L2 => residual.square(),
                ColourLoss::L1 => residual.abs(),
                ColourLoss::Huber { delta } => huber(residual, delta) * 2.0,
            };
            each.sum_dim(1) / 3.0
        }
        RowLoss::Mask { opacity, mask } => {
            let (opacity, mask) = (column(opacity, 1), known(mask, 1));
            let empty = opacity.clone().neg().add_scalar(1.0 + OPACITY_OFFSET).log();
            let filled = opacity.add_scalar(OPACITY_OFFSET).log();
            let outside = mask.clone().neg().add_scalar(1.0);
            (outside * empty + mask * filled).neg()
        }
        RowLoss::Shortfall { seen, most } => {
            (column(most, 1).detach() - column(seen, 1)).clamp_min(0.0)
        }
        RowLoss::Value { column: of } => column(of, 1),
        RowLoss::UnitLength { length } => (column(length, 1) - 1.0).square(),
        RowLoss::Sparsity { sdf, tau } => (column(sdf, 1).abs() * -tau).exp(),
        RowLoss::Surface { sdf } => column(sdf, 1).abs(),
    }
}
