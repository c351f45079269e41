//! The fused `colour field` op: the colour network M_C on top of an `sdf field`'s output.
//!
//! ```text
//! x   = [p, n, v, sdf, feature, extra]        [9 + 1 + G + E]
//! h1  = relu(W1 x + b1),  h2 = relu(W2 h1 + b2)
//! out = sigmoid(W3 h2 + b3)                   [C]
//! ```
//!
//! (method: eq. 2-4; `extra` is m^P for BaCo and empty for FoCoR, whose fourth output is the alpha
//! head). The input is put together tile by tile, so that it never exists as a tensor.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod adapters;
mod autodiff;
mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;

pub use cpu::{BACKWARD, EVALUATION, FORWARD};

use burn::Tensor;
use burn::backend::{Backend, Dispatch, backend_extension, tensor::FloatTensor};

/// The network's weights, each `[out, in]` with its bias `[out]`.
#[derive(Clone, Debug)]
pub struct ColourFieldWeights {
    /// First hidden layer.
    pub w1: Tensor<2>,
    /// Its bias.
    pub b1: Tensor<1>,
    /// Second hidden layer.
    pub w2: Tensor<2>,
    /// Its bias.
    pub b2: Tensor<1>,
    /// Output layer.
    pub w3: Tensor<2>,
    /// Its bias.
    pub b3: Tensor<1>,
}

/// The op's tensor inputs besides its weights.
#[derive(Clone, Debug)]
pub struct ColourFieldInputs {
    /// What [`sdf_field`](crate::sdf_field::sdf_field) returned, `[n, 1 + G + 3]`.
    pub geometry: Tensor<2>,
    /// The points, `[n, 3]`; constants.
    pub points: Tensor<2>,
    /// Unit directions from the camera to the points, `[n, 3]`; constants.
    pub directions: Tensor<2>,
    /// Further input, `[n, E]` with `E` zero or more; constants.
    pub extra: Tensor<2>,
}

/// `colour field`, as backends supply it.
#[backend_extension(NdArray, Flex, Cube: cfg(feature = "cube"), Autodiff)]
pub trait ColourFieldOps: Backend {
    /// See [`colour_field`].
    #[allow(clippy::too_many_arguments)] // the macro routes tensors as plain arguments
    fn colour_field(
        geometry: FloatTensor<Self>,
        points: FloatTensor<Self>,
        directions: FloatTensor<Self>,
        extra: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        w3: FloatTensor<Self>,
        b3: FloatTensor<Self>,
    ) -> FloatTensor<Self>;
}

/// Colours in `[0, 1]`, `[n, C]`, with gradients for the geometry and the weights.
///
/// # Panics
/// When a shape does not fit.
#[must_use]
pub fn colour_field(inputs: ColourFieldInputs, weights: ColourFieldWeights) -> Tensor<2> {
    let [n, columns] = inputs.geometry.dims();
    let [_, extra] = inputs.extra.dims();
    let [hidden, width] = weights.w1.dims();
    assert_eq!(
        width,
        6 + columns + extra,
        "colour_field: w1 is [{hidden}, {width}], but geometry [{n}, {columns}] and extra \
         [{n}, {extra}] make {} inputs",
        6 + columns + extra
    );
    for (name, dims) in [
        ("points", inputs.points.dims()),
        ("directions", inputs.directions.dims()),
    ] {
        assert_eq!(dims, [n, 3], "colour_field: {name} must be [n, 3]");
    }
    Tensor::from_dispatch(Dispatch::colour_field(
        inputs.geometry.into_dispatch(),
        inputs.points.into_dispatch(),
        inputs.directions.into_dispatch(),
        inputs.extra.into_dispatch(),
        weights.w1.into_dispatch(),
        weights.b1.into_dispatch(),
        weights.w2.into_dispatch(),
        weights.b2.into_dispatch(),
        weights.w3.into_dispatch(),
        weights.b3.into_dispatch(),
    ))
}

/// What one backend keeps from forward to backward, and how it goes back.
pub(crate) mod backward {
    use super::{Backend, FloatTensor};

    /// The op's arguments in the order of [`super::ColourFieldOps::colour_field`].
    pub(crate) type Arguments<B> = [FloatTensor<B>; 10];

    /// The kernels behind autodiff.
    pub trait ColourFieldBackward: Backend {
        /// What the forward pass keeps.
        type Saved: Clone + Send + std::fmt::Debug + 'static;

        /// The op, keeping what its backward needs.
        fn colour_field_saving(arguments: Arguments<Self>) -> (FloatTensor<Self>, Self::Saved);

        /// Gradients of geometry, w1, b1, w2, b2, w3, b3 for `grad [n, C]`.
        fn colour_field_backward(
            saved: Self::Saved,
            grad: FloatTensor<Self>,
        ) -> [FloatTensor<Self>; 7];
    }
}
