//! The kernel behind Burn's CPU backends.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::sync::Arc;

use burn::backend::{Flex, NdArray, TensorMetadata, tensor::FloatTensor};
use tensor_slices::F32Slices;

use super::{
    CompositeConfig, CompositeOps, Packing,
    autodiff::{CompositeBackwardOps, CompositeGradients},
    column,
    cpu::{self, Batch},
};

fn pair(values: &[f32]) -> [f32; 2] {
    [values[0], values[1]]
}

/// Columns of a matrix.
fn width(tensor: &impl TensorMetadata) -> usize {
    tensor.shape()[1]
}

fn forward<B: F32Slices>(
    object: FloatTensor<B>,
    background: FloatTensor<B>,
    sharpness: FloatTensor<B>,
    packing: Arc<Packing>,
    config: CompositeConfig,
) -> FloatTensor<B> {
    let out = cpu::forward(&Batch {
        object: &B::as_f32(&object),
        object_width: width(&object),
        background: &B::as_f32(&background),
        background_width: width(&background),
        sharpness: pair(&B::as_f32(&sharpness)),
        packing: &packing,
        config,
    });
    B::from_f32(out, [packing.ray_count(), column::COUNT])
}

fn backward<B: F32Slices>(
    inputs: [FloatTensor<B>; 3],
    grad: FloatTensor<B>,
    packing: Arc<Packing>,
    config: CompositeConfig,
) -> CompositeGradients<B> {
    let [object, background, sharpness] = inputs;
    let widths = [width(&object), width(&background)];
    let gradients = cpu::backward(
        &Batch {
            object: &B::as_f32(&object),
            object_width: widths[0],
            background: &B::as_f32(&background),
            background_width: widths[1],
            sharpness: pair(&B::as_f32(&sharpness)),
            packing: &packing,
            config,
        },
        &B::as_f32(&grad),
    );
    CompositeGradients {
        object: B::from_f32(gradients.object, [packing.object().len(), widths[0]]),
        background: B::from_f32(
            gradients.background,
            [packing.background().len(), widths[1]],
        ),
        sharpness: B::from_f32(gradients.sharpness.to_vec(), [2]),
    }
}

macro_rules! implement {
    ($backend:ty) => {
        impl CompositeOps for $backend {
            fn composite(
                object: FloatTensor<Self>,
                background: FloatTensor<Self>,
                sharpness: FloatTensor<Self>,
                packing: Arc<Packing>,
                config: CompositeConfig,
            ) -> FloatTensor<Self> {
                forward::<Self>(object, background, sharpness, packing, config)
            }
        }

        impl CompositeBackwardOps for $backend {
            fn composite_backward(
                inputs: [FloatTensor<Self>; 3],
                grad: FloatTensor<Self>,
                packing: Arc<Packing>,
                config: CompositeConfig,
            ) -> CompositeGradients<Self> {
                backward::<Self>(inputs, grad, packing, config)
            }
        }
    };
}

implement!(NdArray);
implement!(Flex);
