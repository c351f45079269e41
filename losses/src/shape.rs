//! A wrong shape is a bug of the caller: the message names the loss, the argument and both shapes.

use burn::tensor::Tensor;

/// Panics unless `tensor` has the shape `expected`.
#[track_caller]
pub(crate) fn expect_shape<const D: usize>(
    loss: &str,
    argument: &str,
    tensor: &Tensor<D>,
    expected: [usize; D],
) {
    let actual = tensor.dims();
    assert!(
        actual == expected,
        "{loss}: {argument} has shape {actual:?}, expected {expected:?}"
    );
}

/// Panics unless the optional weights are one per element.
#[track_caller]
pub(crate) fn expect_weights(loss: &str, weights: Option<&Tensor<1>>, elements: usize) {
    if let Some(weights) = weights {
        expect_shape(loss, "weights", weights, [elements]);
    }
}
