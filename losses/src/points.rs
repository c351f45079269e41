//! Points known to lie on the surface, such as the sparse points of structure from motion.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::{
    huber::{expect_delta, huber},
    reduction::weighted_mean,
    shape::expect_weights,
};

/// How the signed distance `s` at a surface point is penalised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum PointPenalty {
    /// `|s|`.
    #[default]
    L1,
    /// `s^2 / (2 delta)` for `|s| <= delta`, else `|s| - delta / 2`.
    ///
    /// Huber's function over delta: as [`PointPenalty::L1`] for outliers, and forgiving below the
    /// precision of the points.
    Huber {
        /// The points' precision, in the unit of the distance; positive.
        delta: f32,
    },
}

/// The loss of the signed distances `sdf` `[n]` at points that lie on the surface.
///
/// ```text
/// L = sum_i w_i |sdf(p_i)| / sum_i w_i        (or Huber's function, by `penalty`)
/// ```
///
/// `weights` `[n]` are optional: the number of views that see the point, say, or its inverse
/// reprojection error. Where the distance is exactly 0 so is the gradient.
///
/// # Panics
/// When a shape is wrong, or delta is not positive.
///
/// ```
/// use burn::tensor::{Device, Tensor};
/// use losses::{PointPenalty, point_loss};
///
/// let device = Device::flex();
/// let sdf = || Tensor::<1>::from_floats([0.3, -0.1], &device);
/// let views = Tensor::<1>::from_floats([3.0, 9.0], &device);
///
/// let l1 = point_loss(sdf(), PointPenalty::L1, Some(views));
/// assert!((l1.into_scalar::<f32>() - (3.0 * 0.3 + 9.0 * 0.1) / 12.0).abs() < 1e-6);
/// let huber = point_loss(sdf(), PointPenalty::Huber { delta: 0.2 }, None);
/// assert!((huber.into_scalar::<f32>() - (0.2 + 0.025) / 2.0).abs() < 1e-6);
/// ```
pub fn point_loss(sdf: Tensor<1>, penalty: PointPenalty, weights: Option<Tensor<1>>) -> Tensor<1> {
    let [n] = sdf.dims();
    expect_weights("point_loss", weights.as_ref(), n);
    let per_point = match penalty {
        PointPenalty::L1 => sdf.abs(),
        PointPenalty::Huber { delta } => {
            expect_delta("point_loss", delta);
            huber(sdf, delta) / delta
        }
    };
    weighted_mean(per_point, weights)
}
