//! The kernel behind Burn's CPU backends.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use burn::backend::{Flex, NdArray, TensorMetadata, tensor::FloatTensor};
use tensor_slices::F32Slices;

use super::autodiff::RowLossesBackwardOps;
use super::cpu::{self, Rows};
use super::{RowLossesOps, RowTerm};

/// Calls `with` with both matrices' values.
fn of<B: F32Slices, R>(
    [rows, known]: [&FloatTensor<B>; 2],
    with: impl FnOnce(Rows<'_>, Rows<'_>) -> R,
) -> R {
    let (row_values, known_values) = (B::as_f32(rows), B::as_f32(known));
    let rows = Rows {
        values: &row_values,
        width: rows.shape()[1],
    };
    let known = Rows {
        values: &known_values,
        width: known.shape()[1],
    };
    with(rows, known)
}

macro_rules! implement {
    ($backend:ty) => {
        impl RowLossesOps for $backend {
            fn row_losses(
                rows: FloatTensor<Self>,
                known: FloatTensor<Self>,
                terms: Vec<RowTerm>,
            ) -> FloatTensor<Self> {
                let sums = of::<Self, _>([&rows, &known], |rows, known| {
                    cpu::forward(rows, known, &terms)
                });
                Self::from_f32(sums, [terms.len()])
            }
        }

        impl RowLossesBackwardOps for $backend {
            fn row_losses_backward(
                rows: FloatTensor<Self>,
                known: FloatTensor<Self>,
                terms: &[RowTerm],
                grad: FloatTensor<Self>,
            ) -> FloatTensor<Self> {
                let [n, width] = [rows.shape()[0], rows.shape()[1]];
                let grad = Self::as_f32(&grad);
                let out = of::<Self, _>([&rows, &known], |rows, known| {
                    cpu::backward(rows, known, terms, &grad)
                });
                Self::from_f32(out, [n, width])
            }
        }
    };
}

implement!(NdArray);
implement!(Flex);
