//! The background alone against the photo, where the photo shows it.

use burn::tensor::Tensor;

use crate::ColourLoss;

/// The colour loss of the background rendered alone, outside the object's dilated coarse mask.
///
/// The joint rendering teaches the background only where the object lets it through. Outside the
/// dilated mask the photo shows the background itself, so it is compared directly, which makes
/// plates right inside the object's box too:
///
/// ```text
/// L = sum_r u_r l(c_B_r - c*_r) / sum_r u_r
/// ```
///
/// `background` `[rays, 3]` is the background field's colour with nothing in front of it, `photo`
/// `[rays, 3]` the photo's, and `outside` `[rays]` is `u`: 1 outside the dilated mask, 0 inside it (and
/// where nothing is known), or the confidence in between. All inside: 0.
///
/// # Panics
/// When a shape is wrong, or Huber's delta is not positive.
///
/// ```
/// use burn::tensor::{Device, Tensor};
/// use losses::{ColourLoss, background_loss};
///
/// let device = Device::flex();
/// let plate = Tensor::<2>::from_floats([[0.4, 0.4, 0.4], [0.0, 0.0, 0.0]], &device);
/// let photo = Tensor::<2>::from_floats([[0.4, 0.4, 0.7], [1.0, 1.0, 1.0]], &device);
/// let outside = Tensor::<1>::from_floats([1.0, 0.0], &device); // the object covers the second ray
///
/// let loss = background_loss(ColourLoss::L2, plate, photo, outside);
/// assert!((loss.into_scalar::<f32>() - 0.03).abs() < 1e-6);
/// ```
pub fn background_loss(
    kind: ColourLoss,
    background: Tensor<2>,
    photo: Tensor<2>,
    outside: Tensor<1>,
) -> Tensor<1> {
    let arguments = ["background", "photo"];
    kind.named_loss(
        "background_loss",
        arguments,
        background,
        photo,
        Some(outside),
    )
}
