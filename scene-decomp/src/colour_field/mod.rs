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
//!
//! [`colour_field`] returns the colours. [`sample_rows`] returns what compositing and the Eikonal loss
//! want of a sample, since everything for it is at hand: `(sdf, n . v, out, |n|)`. Put together from
//! the outside, by slices, products and concatenations, this took a sixth of a training step.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod adapters;
mod around;
mod autodiff;
mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
mod row;

pub use cpu::{BACKWARD, EVALUATION, FORWARD};
pub use row::{Output, Reading, RowConfig, density_of, row_column};

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
    /// See [`colour_field`] and [`sample_rows`].
    #[allow(clippy::too_many_arguments)] // the macro routes tensors as plain arguments
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
    ) -> FloatTensor<Self>;
}

/// Colours in `[0, 1]`, `[n, C]`, with gradients for the geometry and the weights.
///
/// # Panics
/// When a shape does not fit. On a GPU also when a matrix of all points has more than `2^32 − 1` numbers: ask in smaller
/// batches.
#[must_use]
pub fn colour_field(inputs: ColourFieldInputs, weights: ColourFieldWeights) -> Tensor<2> {
    let nothing = Tensor::zeros([inputs.points.dims()[0], 0], &inputs.points.device());
    run(inputs, nothing, weights, Output::Colour)
}

/// A field's samples as rows for compositing, `[n, 3 + C]`: see [`row_column`]. Gradients are for the
/// geometry and the weights.
///
/// `stretch` `[n, 1]` multiplies densities, a constant; `[n, 0]` stands for ones.
///
/// # Panics
/// As [`colour_field`].
#[must_use]
pub fn sample_rows(
    inputs: ColourFieldInputs,
    stretch: Tensor<2>,
    weights: ColourFieldWeights,
    config: RowConfig,
) -> Tensor<2> {
    run(inputs, stretch, weights, Output::Row(config))
}

fn run(
    inputs: ColourFieldInputs,
    stretch: Tensor<2>,
    weights: ColourFieldWeights,
    output: Output,
) -> Tensor<2> {
    check_tensors(&inputs, &stretch, &weights);
    Tensor::from_dispatch(Dispatch::colour_field(
        inputs.geometry.into_dispatch(),
        inputs.points.into_dispatch(),
        inputs.directions.into_dispatch(),
        inputs.extra.into_dispatch(),
        stretch.into_dispatch(),
        weights.w1.into_dispatch(),
        weights.b1.into_dispatch(),
        weights.w2.into_dispatch(),
        weights.b2.into_dispatch(),
        weights.w3.into_dispatch(),
        weights.b3.into_dispatch(),
        output,
    ))
}

/// [`check`] for tensors of any backend.
fn check_tensors(inputs: &ColourFieldInputs, stretch: &Tensor<2>, weights: &ColourFieldWeights) {
    let ColourFieldInputs {
        geometry,
        points,
        directions,
        extra,
    } = inputs;
    let matrices = [geometry, points, directions, extra, stretch].map(|matrix| matrix.dims());
    let layers = [&weights.w1, &weights.w2, &weights.w3].map(|weight| weight.dims());
    let biases = [&weights.b1, &weights.b2, &weights.b3].map(|bias| bias.dims());
    check(
        matrices.each_ref().map(|shape| &shape[..]),
        layers.each_ref().map(|shape| &shape[..]),
        biases.each_ref().map(|shape| &shape[..]),
    );
}

/// What kernels rest on: the shapes of geometry, points, directions, extra and stretch, of the layers and of their biases.
fn check(
    [geometry, points, directions, extra, stretch]: [&[usize]; 5],
    [w1, w2, w3]: [&[usize]; 3],
    biases: [&[usize]; 3],
) {
    let (&[n, columns], &[rows, further]) = (geometry, extra) else {
        panic!("colour_field: geometry is {geometry:?} and extra {extra:?}, not matrices");
    };
    assert!(
        columns > 3,
        "colour_field: geometry is {geometry:?}, but has sdf, features and normal"
    );
    assert_eq!(rows, n, "colour_field: extra must have a row per point");
    let (hidden, second, outputs) = (w1[0], w2[0], w3[0]);
    let inputs = 6 + columns + further;
    assert_eq!(
        w1,
        [hidden, inputs],
        "colour_field: w1 is {w1:?}, but geometry {geometry:?} and extra {extra:?} make {inputs} inputs"
    );
    for (name, shape) in [("points", points), ("directions", directions)] {
        assert_eq!(shape, [n, 3], "colour_field: {name} must be [n, 3]");
    }
    assert!(
        stretch == [n, 1] || stretch == [n, 0],
        "sample_rows: stretch is {stretch:?}, not [{n}, 1] or [{n}, 0]"
    );
    assert_eq!(w2, [second, hidden], "colour_field: w2 does not fit w1");
    assert_eq!(w3, [outputs, second], "colour_field: w3 does not fit w2");
    for (bias, rows) in biases.into_iter().zip([hidden, second, outputs]) {
        assert_eq!(bias, [rows], "colour_field: a bias does not fit its layer");
    }
    assert!(
        (1..=MAX_OUTPUTS).contains(&outputs),
        "colour_field: {outputs} outputs, not 1 to {MAX_OUTPUTS}"
    );
}

/// Colour and alpha head.
const MAX_OUTPUTS: usize = 4;

/// What one backend keeps from forward to backward, and how it goes back.
pub(crate) mod backward {
    use super::{Backend, FloatTensor, Output};

    /// The op's tensors in the order of [`super::ColourFieldOps::colour_field`].
    pub(crate) type Arguments<B> = [FloatTensor<B>; 11];

    /// The kernels behind autodiff.
    pub trait ColourFieldBackward: Backend {
        /// What the forward pass keeps.
        type Saved: Clone + Send + std::fmt::Debug + 'static;

        /// The op, keeping what its backward needs.
        fn colour_field_saving(
            arguments: Arguments<Self>,
            output: Output,
        ) -> (FloatTensor<Self>, Self::Saved);

        /// Gradients of geometry, w1, b1, w2, b2, w3, b3 for `grad`, in the output's shape.
        fn colour_field_backward(
            saved: Self::Saved,
            grad: FloatTensor<Self>,
        ) -> [FloatTensor<Self>; 7];
    }
}
