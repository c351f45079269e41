//! The kernel behind Burn's CPU backends.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::sync::Arc;

use burn::backend::{Flex, NdArray, tensor::FloatTensor};
use tensor_slices::F32Slices;

use super::{
    CompositeConfig, CompositeOps, Packing,
    autodiff::{CompositeBackwardOps, CompositeGradients},
    background_column, column,
    cpu::{self, Batch},
    object_column,
};

fn pair(values: &[f32]) -> [f32; 2] {
    [values[0], values[1]]
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
        background: &B::as_f32(&background),
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
    let gradients = cpu::backward(
        &Batch {
            object: &B::as_f32(&object),
            background: &B::as_f32(&background),
            sharpness: pair(&B::as_f32(&sharpness)),
            packing: &packing,
            config,
        },
        &B::as_f32(&grad),
    );
    CompositeGradients {
        object: B::from_f32(
            gradients.object,
            [packing.object().len(), object_column::COUNT],
        ),
        background: B::from_f32(
            gradients.background,
            [packing.background().len(), background_column::COUNT],
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
