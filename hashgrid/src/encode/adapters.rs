//! NdArray and Flex lend their memory to the slice kernels.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use burn::backend::tensor::FloatTensor;
use burn::backend::{Flex, NdArray, TensorMetadata};
use tensor_slices::F32Slices;

use super::backward::EncodeBackward;
use super::cpu::{self, Form};
use super::{EncodeConfig, EncodeOps};
use crate::layout::FEATURES;

macro_rules! cpu_backend {
    ($backend:ty) => {
        impl EncodeOps for $backend {
            fn hash_encode(
                points: FloatTensor<Self>,
                table: FloatTensor<Self>,
                config: EncodeConfig,
            ) -> FloatTensor<Self> {
                let points = Self::as_f32(&points);
                let out = cpu::forward(&points, &Self::as_f32(&table), &config, Form::Value);
                Self::from_f32(out, [points.len() / 3, config.layout.features()])
            }

            fn hash_encode_with_jacobian(
                points: FloatTensor<Self>,
                table: FloatTensor<Self>,
                config: EncodeConfig,
            ) -> FloatTensor<Self> {
                let points = Self::as_f32(&points);
                let out = cpu::forward(&points, &Self::as_f32(&table), &config, Form::WithJacobian);
                Self::from_f32(out, [points.len() / 3, config.layout.features(), 4])
            }
        }

        impl EncodeBackward for $backend {
            fn hash_encode_table_gradient(
                points: FloatTensor<Self>,
                grad: FloatTensor<Self>,
                config: &EncodeConfig,
            ) -> FloatTensor<Self> {
                let form = if grad.rank() == 2 {
                    Form::Value
                } else {
                    Form::WithJacobian
                };
                let out =
                    cpu::table_gradient(&Self::as_f32(&points), &Self::as_f32(&grad), config, form);
                Self::from_f32(out, [config.layout.entries(), FEATURES])
            }

            fn hash_encode_points_gradient(
                points: FloatTensor<Self>,
                table: FloatTensor<Self>,
                grad: FloatTensor<Self>,
                config: &EncodeConfig,
            ) -> FloatTensor<Self> {
                let points = Self::as_f32(&points);
                let (table, grad) = (Self::as_f32(&table), Self::as_f32(&grad));
                let out = cpu::points_gradient(&points, &table, &grad, config);
                Self::from_f32(out, [points.len() / 3, 3])
            }
        }
    };
}

cpu_backend!(NdArray);
cpu_backend!(Flex);
