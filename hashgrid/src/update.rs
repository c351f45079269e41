//! A table changed in place, whichever backend it is on.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use burn::Tensor;
use burn::backend::autodiff::{Autodiff, checkpoint::strategy::CheckpointStrategy};
use burn::backend::{
    AutodiffBackend, Backend, Dispatch, Flex, NdArray, backend_extension, tensor::FloatTensor,
};
use tensor_slices::F32Slices;

/// A change of a table's values.
pub(crate) trait TableUpdate {
    /// Changes values in the host's memory, row-major.
    fn on_slice(&mut self, values: &mut [f32]);

    /// Changes values in a device's memory.
    #[cfg(feature = "cube")]
    fn on_device(&mut self, table: gpu_tensors::CubeTensor) -> gpu_tensors::CubeTensor;
}

/// Any change that the host makes; a device's values travel there and back.
pub(crate) struct OnHost<F>(pub(crate) F);

impl<F: FnMut(&mut [f32])> TableUpdate for OnHost<F> {
    fn on_slice(&mut self, values: &mut [f32]) {
        (self.0)(values);
    }

    #[cfg(feature = "cube")]
    fn on_device(&mut self, table: gpu_tensors::CubeTensor) -> gpu_tensors::CubeTensor {
        let mut values = gpu_tensors::read(&table);
        (self.0)(&mut values);
        let shape = table.meta.shape();
        gpu_tensors::from_slice(&table, &values, [shape[0], shape[1]])
    }
}

/// Backends whose tables can be updated.
#[backend_extension(NdArray, Flex, Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait UpdateOps: Backend {
    /// Hands the table to `update`.
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn TableUpdate,
    ) -> FloatTensor<Self>;
}

/// Hands the table `tensor` to `update`; in place when this is its only owner.
///
/// The result is a leaf without history, tracked when `tensor` was one.
pub(crate) fn update_in_place(tensor: Tensor<2>, update: &mut dyn TableUpdate) -> Tensor<2> {
    let tracked = tensor.is_require_grad();
    let updated = Dispatch::update_in_place(tensor.into_dispatch(), update);
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
        update: &mut dyn TableUpdate,
    ) -> FloatTensor<Self> {
        Self::update_f32(tensor, |values| update.on_slice(values))
    }
}

impl UpdateOps for Flex {
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn TableUpdate,
    ) -> FloatTensor<Self> {
        Self::update_f32(tensor, |values| update.on_slice(values))
    }
}

#[cfg(feature = "cube")]
impl UpdateOps for burn::backend::Cube {
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn TableUpdate,
    ) -> FloatTensor<Self> {
        update.on_device(tensor)
    }
}

impl<B: UpdateOps, C: CheckpointStrategy> UpdateOps for Autodiff<B, C> {
    fn update_in_place(
        tensor: FloatTensor<Self>,
        update: &mut dyn TableUpdate,
    ) -> FloatTensor<Self> {
        Self::from_inner(B::update_in_place(tensor.into_primitive(), update))
    }
}
