//! A tensor's memory as a slice to be changed, whichever CPU backend it is on.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use burn::Tensor;
use burn::backend::autodiff::{Autodiff, checkpoint::strategy::CheckpointStrategy};
use burn::backend::{
    AutodiffBackend, Backend, Dispatch, Flex, NdArray, backend_extension, tensor::FloatTensor,
};
use tensor_slices::F32Slices;

/// Backends whose tensors can be updated as slices.
#[backend_extension(NdArray, Flex, Autodiff)]
pub(crate) trait UpdateOps: Backend {
    /// Hands the values to `update`.
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn FnMut(&mut [f32]),
    ) -> FloatTensor<Self>;
}

/// Hands `tensor`'s values, row-major, to `update`; in place when this is its only owner.
///
/// The result is a leaf without history, tracked when `tensor` was one.
pub(crate) fn update_in_place<const D: usize>(
    tensor: Tensor<D>,
    update: impl FnOnce(&mut [f32]),
) -> Tensor<D> {
    let mut update = Some(update);
    let mut once = |values: &mut [f32]| {
        if let Some(update) = update.take() {
            update(values);
        }
    };
    let tracked = tensor.is_require_grad();
    let updated = Dispatch::update_in_place(tensor.into_dispatch(), &mut once);
    let updated = Tensor::from_dispatch(updated);
    if tracked {
        updated.require_grad()
    } else {
        updated
    }
}

impl UpdateOps for NdArray {
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn FnMut(&mut [f32]),
    ) -> FloatTensor<Self> {
        Self::update_f32(tensor, update)
    }
}

impl UpdateOps for Flex {
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn FnMut(&mut [f32]),
    ) -> FloatTensor<Self> {
        Self::update_f32(tensor, update)
    }
}

impl<B: UpdateOps, C: CheckpointStrategy> UpdateOps for Autodiff<B, C> {
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn FnMut(&mut [f32]),
    ) -> FloatTensor<Self> {
        Self::from_inner(B::update_in_place(tensor.into_primitive(), update))
    }
}
