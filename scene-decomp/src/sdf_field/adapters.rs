//! NdArray and Flex lend their memory to the slice kernel.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::sync::Arc;

use burn::backend::{Backend, Flex, NdArray, tensor::FloatTensor};
use tensor_slices::F32Slices;

use super::backward::{DenseTable, SdfFieldBackward, SdfFieldGradients};
use super::cpu::{self, Saved, Weights};
use super::{Forward, SdfFieldConfig, SdfFieldOps};

fn run<B: F32Slices>(
    points: &FloatTensor<B>,
    table: &FloatTensor<B>,
    [w1, b1, w2, b2]: [&FloatTensor<B>; 4],
    config: &SdfFieldConfig,
    keep: cpu::Keep,
) -> (FloatTensor<B>, Option<Saved>) {
    let (w1, b1, w2, b2) = (B::as_f32(w1), B::as_f32(b1), B::as_f32(w2), B::as_f32(b2));
    let weights = Weights::new(config, &w1, &b1, &w2, &b2, keep);
    let width = weights.columns();
    let (points, table) = (B::as_f32(points), B::as_f32(table));
    let (out, saved) = match (keep, &config.forward) {
        (cpu::Keep::Nothing, Forward::Taped(tape)) => {
            let out = cpu::forward_to_tape(&points, &table, &weights, config, tape);
            (out, None)
        }
        (cpu::Keep::ForBackward, Forward::FromTape(rows)) if !rows.is_empty() => {
            let (out, saved) = cpu::forward_from_tape(rows, table.len(), weights, config);
            (out, Some(saved))
        }
        _ => cpu::forward(&points, &table, weights, config, keep),
    };
    (B::from_f32(out, [points.len() / 3, width]), saved)
}

macro_rules! cpu_backend {
    ($backend:ty) => {
        impl SdfFieldOps for $backend {
            fn sdf_field(
                points: FloatTensor<Self>,
                table: FloatTensor<Self>,
                w1: FloatTensor<Self>,
                b1: FloatTensor<Self>,
                w2: FloatTensor<Self>,
                b2: FloatTensor<Self>,
                config: SdfFieldConfig,
            ) -> FloatTensor<Self> {
                run::<Self>(
                    &points,
                    &table,
                    [&w1, &b1, &w2, &b2],
                    &config,
                    cpu::Keep::Nothing,
                )
                .0
            }
        }

        impl SdfFieldBackward for $backend {
            type Saved = Arc<Saved>;

            fn sdf_field_saving(
                points: FloatTensor<Self>,
                table: FloatTensor<Self>,
                w1: FloatTensor<Self>,
                b1: FloatTensor<Self>,
                w2: FloatTensor<Self>,
                b2: FloatTensor<Self>,
                config: SdfFieldConfig,
            ) -> (FloatTensor<Self>, Self::Saved) {
                let (out, saved) = run::<Self>(
                    &points,
                    &table,
                    [&w1, &b1, &w2, &b2],
                    &config,
                    cpu::Keep::ForBackward,
                );
                match saved {
                    Some(saved) => (out, Arc::new(saved)),
                    None => unreachable!("forward was told to keep its state"),
                }
            }

            fn sdf_field_backward(
                saved: Self::Saved,
                grad: FloatTensor<Self>,
                dense_table: DenseTable,
            ) -> SdfFieldGradients<Self> {
                gradients::<Self>(&saved, &grad, dense_table)
            }
        }
    };
}

cpu_backend!(NdArray);
cpu_backend!(Flex);

fn gradients<B: F32Slices + Backend>(
    saved: &Saved,
    grad: &FloatTensor<B>,
    dense_table: DenseTable,
) -> SdfFieldGradients<B> {
    let grads = cpu::backward(saved, &B::as_f32(grad), dense_table);
    let (hidden, inputs) = (grads.b1.len(), grads.w1.len() / grads.b1.len());
    let outputs = grads.b2.len();
    let entries = grads.table.as_ref().map_or(0, |t| t.len() / 2);
    SdfFieldGradients {
        table: grads.table.map(|t| B::from_f32(t, [entries, 2])),
        w1: B::from_f32(grads.w1, [hidden, inputs]),
        b1: B::from_f32(grads.b1, [hidden]),
        w2: B::from_f32(grads.w2, [outputs, hidden]),
        b2: B::from_f32(grads.b2, [outputs]),
    }
}
