//! Huber's function (Huber 1964, "Robust estimation of a location parameter"), without branches.

use burn::tensor::Tensor;

/// `|r|^2 / 2` for `|r| <= delta`, else `delta (|r| - delta / 2)`, of each element of `residual`.
///
/// With `q = min(|r|, delta)` both branches are `q (|r| - q / 2)`; the gradient is `sign(r) q`
/// whichever way a backend takes the derivative of `min` where its arguments meet.
pub(crate) fn huber<const D: usize>(residual: Tensor<D>, delta: f32) -> Tensor<D> {
    let size = residual.abs();
    let clipped = size.clone().clamp_max(delta);
    clipped.clone() * (size - clipped * 0.5)
}

/// Panics unless `delta` is a positive number: at 0 Huber's function is 0 everywhere.
#[track_caller]
pub(crate) fn expect_delta(loss: &str, delta: f32) {
    assert!(
        delta > 0.0 && delta.is_finite(),
        "{loss}: Huber's delta is {delta}, expected a positive number"
    );
}
