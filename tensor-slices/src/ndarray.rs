//! [`F32Slices`] for NdArray.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::borrow::Cow;

use burn::backend::{NdArray, ndarray::NdArrayTensor, tensor::FloatTensor};
use ndarray::{ArcArray, IxDyn};

use crate::F32Slices;

impl F32Slices for NdArray {
    fn as_f32(tensor: &FloatTensor<Self>) -> Cow<'_, [f32]> {
        let NdArrayTensor::F32(storage) = tensor else {
            panic!("tensor-slices: expected an f32 tensor");
        };
        let view = storage.view();
        match view.to_slice() {
            Some(slice) => Cow::Borrowed(slice),
            None => Cow::Owned(view.iter().copied().collect()),
        }
    }

    fn from_f32<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FloatTensor<Self> {
        let count = values.len();
        match ArcArray::from_shape_vec(IxDyn(&shape), values) {
            Ok(array) => array.into(),
            Err(_) => panic!("tensor-slices: {count} values do not fill the shape {shape:?}"),
        }
    }

    fn update_f32(tensor: FloatTensor<Self>, update: impl FnOnce(&mut [f32])) -> FloatTensor<Self> {
        let NdArrayTensor::F32(storage) = tensor else {
            panic!("tensor-slices: expected an f32 tensor");
        };
        let mut array = storage.into_owned();
        if !array.is_standard_layout() {
            array = array.as_standard_layout().into_owned().into_shared();
        }
        // A shared array is copied by `as_slice_mut`; a unique one is not.
        if let Some(slice) = array.as_slice_mut() {
            update(slice);
        }
        array.into()
    }
}
