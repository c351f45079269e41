//! NdArray and Flex lend their memory to the slice kernel.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::sync::Arc;

use burn::backend::{Flex, NdArray, TensorMetadata, tensor::FloatTensor};
use tensor_slices::F32Slices;

use super::backward::{Arguments, ColourFieldBackward};
use super::cpu::{self, Inputs, Keep, Saved, Weights};
use super::{ColourFieldOps, Output};

fn run<B: F32Slices>(
    arguments: &Arguments<B>,
    output: Output,
    keep: Keep,
) -> (FloatTensor<B>, Option<Saved>) {
    let [
        geometry,
        points,
        directions,
        extra,
        stretch,
        w1,
        b1,
        w2,
        b2,
        w3,
        b3,
    ] = arguments.each_ref().map(|tensor| B::as_f32(tensor));
    let weights = Weights::new([&w1, &b1, &w2, &b2, &w3, &b3]);
    let inputs = Inputs {
        geometry: &geometry,
        geometry_columns: arguments[0].shape()[1],
        points: &points,
        directions: &directions,
        extra: &extra,
        stretch: &stretch,
    };
    let n = points.len() / 3;
    let columns = output.columns(weights.outputs());
    let (out, saved) = cpu::forward(inputs, weights, output, keep);
    (B::from_f32(out, [n, columns]), saved)
}

fn gradients<B: F32Slices>(saved: &Saved, grad: &FloatTensor<B>) -> [FloatTensor<B>; 7] {
    let g = cpu::backward(saved, &B::as_f32(grad));
    let columns = g.geometry_columns;
    let n = g.geometry.len() / columns;
    let (h1, h2, outputs) = (g.b1.len(), g.b2.len(), g.b3.len());
    let inputs = g.w1.len() / h1;
    [
        B::from_f32(g.geometry, [n, columns]),
        B::from_f32(g.w1, [h1, inputs]),
        B::from_f32(g.b1, [h1]),
        B::from_f32(g.w2, [h2, h1]),
        B::from_f32(g.b2, [h2]),
        B::from_f32(g.w3, [outputs, h2]),
        B::from_f32(g.b3, [outputs]),
    ]
}

macro_rules! cpu_backend {
    ($backend:ty) => {
        impl ColourFieldOps for $backend {
            fn colour_field(
                geometry: FloatTensor<Self>,
                points: FloatTensor<Self>,
                directions: FloatTensor<Self>,
                extra: FloatTensor<Self>,
                stretch: FloatTensor<Self>,
                w1: FloatTensor<Self>,
                b1: FloatTensor<Self>,
                w2: FloatTensor<Self>,
                b2: FloatTensor<Self>,
                w3: FloatTensor<Self>,
                b3: FloatTensor<Self>,
                output: Output,
            ) -> FloatTensor<Self> {
                let arguments = [
                    geometry, points, directions, extra, stretch, w1, b1, w2, b2, w3, b3,
                ];
                run::<Self>(&arguments, output, Keep::Nothing).0
            }
        }

        impl ColourFieldBackward for $backend {
            type Saved = Arc<Saved>;

            fn colour_field_saving(
                arguments: Arguments<Self>,
                output: Output,
            ) -> (FloatTensor<Self>, Self::Saved) {
                match run::<Self>(&arguments, output, Keep::ForBackward) {
                    (out, Some(saved)) => (out, Arc::new(saved)),
                    (_, None) => unreachable!("forward was told to keep its state"),
                }
            }

            fn colour_field_backward(
                saved: Self::Saved,
                grad: FloatTensor<Self>,
            ) -> [FloatTensor<Self>; 7] {
                gradients::<Self>(&saved, &grad)
            }
        }
    };
}

cpu_backend!(NdArray);
cpu_backend!(Flex);
