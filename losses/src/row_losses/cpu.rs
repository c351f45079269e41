//! The op over slices.

use rayon::prelude::*;

use super::{RowLoss, RowTerm};
use crate::{ColourLoss, OPACITY_OFFSET};

/// Rows of one task; fixed, so that sums do not depend on the number of threads.
const TASK: usize = 4096;

/// A matrix, row-major.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) values: &'a [f32],
    pub(super) width: usize,
}

impl<'a> Rows<'a> {
    fn tasks(self) -> impl IndexedParallelIterator<Item = std::slice::ChunksExact<'a, f32>> {
        let width = self.width.max(1);
        self.values
            .par_chunks(TASK * width)
            .map(move |task| task.chunks_exact(width))
    }
}

/// `[terms]`.
pub(super) fn forward(rows: Rows<'_>, known: Rows<'_>, terms: &[RowTerm]) -> Vec<f32> {
    let parts: Vec<Vec<f64>> = rows
        .tasks()
        .zip(known.tasks())
        .map(|(rows, known)| {
            let mut sums = vec![0.0; terms.len()];
            for (row, known) in rows.zip(known) {
                for (sum, term) in sums.iter_mut().zip(terms) {
                    let weight = known[term.weight];
                    // Zero times what is no number would be none.
                    if weight != 0.0 {
                        *sum += f64::from(weight * value(term.loss, row, known));
                    }
                }
            }
            sums
        })
        .collect();
    let sum = |term: usize| parts.iter().map(|sums| sums[term]).sum::<f64>() as f32;
    (0..terms.len()).map(sum).collect()
}

/// The gradient of the rows, for `grad [terms]`.
pub(super) fn backward(
    rows: Rows<'_>,
    known: Rows<'_>,
    terms: &[RowTerm],
    grad: &[f32],
) -> Vec<f32> {
    let width = rows.width.max(1);
    let mut out = vec![0.0; rows.values.len()];
    rows.tasks()
        .zip(known.tasks())
        .zip(out.par_chunks_mut(TASK * width))
        .for_each(|((rows, known), out)| {
            for ((row, known), out) in rows.zip(known).zip(out.chunks_exact_mut(width)) {
                for (term, grad) in terms.iter().zip(grad) {
                    let weight = known[term.weight];
                    if weight != 0.0 {
                        add_gradient(term.loss, row, known, grad * weight, out);
                    }
                }
            }
        });
    out
}

fn value(loss: RowLoss, row: &[f32], known: &[f32]) -> f32 {
    match loss {
        RowLoss::Colour {
            kind,
            colour,
            photo,
        } => {
            let channels = row[colour..colour + 3].iter().zip(&known[photo..photo + 3]);
            channels.map(|(c, p)| penalty(kind, c - p)).sum::<f32>() / 3.0
        }
        RowLoss::Mask { opacity, mask } => {
            let (a, m) = (row[opacity], known[mask]);
            let empty = (1.0 + OPACITY_OFFSET - a).ln();
            let filled = (a + OPACITY_OFFSET).ln();
            -((1.0 - m) * empty + m * filled)
        }
        RowLoss::Shortfall { seen, most } => {
            let short = row[most] - row[seen];
            // Written so that NaN stays.
            if short < 0.0 { 0.0 } else { short }
        }
        RowLoss::Value { column } => row[column],
        RowLoss::UnitLength { length } => (row[length] - 1.0) * (row[length] - 1.0),
        RowLoss::Sparsity { sdf, tau } => (-tau * row[sdf].abs()).exp(),
        RowLoss::Surface { sdf } => row[sdf].abs(),
    }
}

/// Adds `scale` times the derivative of [`value`] by the row.
fn add_gradient(loss: RowLoss, row: &[f32], known: &[f32], scale: f32, out: &mut [f32]) {
    match loss {
        RowLoss::Colour {
            kind,
            colour,
            photo,
        } => {
            for k in 0..3 {
                let residual = row[colour + k] - known[photo + k];
                out[colour + k] += scale / 3.0 * slope(kind, residual);
            }
        }
        RowLoss::Mask { opacity, mask } => {
            let (a, m) = (row[opacity], known[mask]);
            out[opacity] +=
                scale * ((1.0 - m) / (1.0 + OPACITY_OFFSET - a) - m / (a + OPACITY_OFFSET));
        }
        RowLoss::Shortfall { seen, most } => {
            // NaN counts as short, for the value stays NaN.
            let enough = row[most] < row[seen];
            if !enough {
                out[seen] -= scale;
            }
        }
        RowLoss::Value { column } => out[column] += scale,
        RowLoss::UnitLength { length } => out[length] += 2.0 * scale * (row[length] - 1.0),
        RowLoss::Sparsity { sdf, tau } => {
            let value = (-tau * row[sdf].abs()).exp();
            out[sdf] -= scale * tau * sign(row[sdf]) * value;
        }
        RowLoss::Surface { sdf } => out[sdf] += scale * sign(row[sdf]),
    }
}

fn penalty(kind: ColourLoss, residual: f32) -> f32 {
    match kind {
        ColourLoss::L2 => residual * residual,
        ColourLoss::L1 => residual.abs(),
        ColourLoss::Huber { delta } if residual.abs() > delta => {
            delta * (2.0 * residual.abs() - delta)
        }
        ColourLoss::Huber { .. } => residual * residual,
    }
}

/// The derivative of [`penalty`]; 0 in its middle.
fn slope(kind: ColourLoss, residual: f32) -> f32 {
    match kind {
        ColourLoss::L2 => 2.0 * residual,
        ColourLoss::L1 => sign(residual),
        ColourLoss::Huber { delta } if residual.abs() > delta => 2.0 * delta * sign(residual),
        ColourLoss::Huber { .. } => 2.0 * residual,
    }
}

fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x.signum() }
}
