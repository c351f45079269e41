//! A fully connected layer's parameters, seeded the same on every backend.

use burn::Tensor;
use burn::module::{Module, Param};
use burn::tensor::{Device, TensorData};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use tensor_slices::matrix;

/// `y = W x + b`; the fused ops read the tensors directly.
#[derive(Module, Debug)]
pub struct Dense {
    /// `[out, in]`.
    pub weight: Param<Tensor<2>>,
    /// `[out]`.
    pub bias: Param<Tensor<1>>,
}

impl Dense {
    /// From values in row-major order.
    pub(crate) fn from_values(weight: Vec<f32>, bias: Vec<f32>, device: &Device) -> Self {
        let shape = [bias.len(), weight.len() / bias.len()];
        Self {
            weight: Param::from_tensor(matrix(weight, shape, device)),
            bias: Param::from_tensor(Tensor::from_data(TensorData::new(bias, [shape[0]]), device)),
        }
    }

    /// He's initialisation for a layer behind which a relu stands: `N(0, 2 / in)`, bias 0.
    pub(crate) fn he(inputs: usize, outputs: usize, random: &mut Random, device: &Device) -> Self {
        let weight = random.normals(inputs * outputs, 0.0, (2.0 / inputs as f32).sqrt());
        Self::from_values(weight, vec![0.0; outputs], device)
    }
}

/// Seeded normal numbers, the same on every machine.
pub(crate) struct Random(Pcg64Mcg);

impl Random {
    /// The stream of `seed`.
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::seed_from_u64(seed))
    }

    /// `count` numbers of `N(mean, deviation^2)`.
    pub(crate) fn normals(&mut self, count: usize, mean: f32, deviation: f32) -> Vec<f32> {
        match Normal::new(mean, deviation) {
            Ok(normal) => normal.sample_iter(&mut self.0).take(count).collect(),
            // A deviation is a square root of a positive number here.
            Err(_) => vec![mean; count],
        }
    }
}
