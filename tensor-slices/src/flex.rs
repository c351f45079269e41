//! [`F32Slices`] for Flex.

use std::borrow::Cow;

use burn::backend::{Flex, tensor::FloatTensor};
use burn::tensor::TensorData;

use crate::F32Slices;

impl F32Slices for Flex {
    fn as_f32(tensor: &FloatTensor<Self>) -> Cow<'_, [f32]> {
        match tensor.as_slice::<f32>() {
            Some(slice) => Cow::Borrowed(slice),
            None => Cow::Owned(tensor.to_contiguous().storage::<f32>().to_vec()),
        }
    }

    fn from_f32<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FloatTensor<Self> {
        FloatTensor::<Self>::from_data(TensorData::new(values, shape))
    }

    fn update_f32(tensor: FloatTensor<Self>, update: impl FnOnce(&mut [f32])) -> FloatTensor<Self> {
        let whole =
            tensor.layout().contiguous_offsets() == Some((0, tensor.storage::<f32>().len()));
        let mut tensor = if whole {
            tensor
        } else {
            tensor.to_contiguous()
        };
        update(tensor.storage_mut::<f32>());
        tensor
    }
}
