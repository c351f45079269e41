//! Rendered against photographed colour.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::{
    huber::{expect_delta, huber},
    reduction::weighted_mean,
    shape::{expect_shape, expect_weights},
};

/// How the difference `r = c - c*` of a rendered and a photographed colour channel is penalised.
///
/// All three are means over the three channels and the (weighted) mean over rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ColourLoss {
    /// `r^2`: the paper's L_color.
    #[default]
    L2,
    /// `|r|`.
    L1,
    /// `r^2` for `|r| <= delta`, else `delta (2 |r| - delta)`.
    ///
    /// Twice Huber's function: equal to [`ColourLoss::L2`] for small differences, so that weights
    /// chosen for the one hold for the other, and linear for shadows, reflections and passers-by.
    Huber {
        /// Where the square ends, in colour units (1 is the full range); positive.
        delta: f32,
    },
}

impl ColourLoss {
    /// The loss of `rendered` `[rays, 3]` against `photo` `[rays, 3]`, weighted by `weights` `[rays]`.
    ///
    /// ```text
    /// L = sum_r w_r (1/3 sum_k l(c_rk - c*_rk)) / sum_r w_r
    /// ```
    ///
    /// # Panics
    /// When a shape is wrong, or delta is not positive.
    ///
    /// ```
    /// use burn::tensor::{Device, Tensor};
    /// use losses::ColourLoss;
    ///
    /// let device = Device::flex();
    /// let rendered = || Tensor::<2>::from_floats([[0.5, 0.0, 0.0], [0.1, 0.2, 0.3]], &device);
    /// let photo = || Tensor::<2>::from_floats([[0.2, 0.0, 0.0], [0.1, 0.2, 0.9]], &device);
    /// let value = |kind: ColourLoss, weights| {
    ///     kind.loss(rendered(), photo(), weights).into_scalar::<f32>()
    /// };
    ///
    /// // Squares 0.09 and 0.36, each of them one of three channels of one of two rays.
    /// assert!((value(ColourLoss::L2, None) - (0.09 + 0.36) / 6.0).abs() < 1e-6);
    /// assert!((value(ColourLoss::L1, None) - (0.3 + 0.6) / 6.0).abs() < 1e-6);
    /// let huber = ColourLoss::Huber { delta: 0.4 };
    /// assert!((value(huber, None) - (0.09 + 0.4 * (1.2 - 0.4)) / 6.0).abs() < 1e-6);
    ///
    /// let first_ray_only = Tensor::<1>::from_floats([1.0, 0.0], &device);
    /// assert!((value(ColourLoss::L2, Some(first_ray_only)) - 0.09 / 3.0).abs() < 1e-6);
    /// ```
    pub fn loss(
        self,
        rendered: Tensor<2>,
        photo: Tensor<2>,
        weights: Option<Tensor<1>>,
    ) -> Tensor<1> {
        self.named_loss(
            "colour loss",
            ["rendered", "photo"],
            rendered,
            photo,
            weights,
        )
    }

    /// [`ColourLoss::loss`] under the name, in messages, of the loss it is used for.
    #[track_caller]
    pub(crate) fn named_loss(
        self,
        name: &str,
        [first, second]: [&str; 2],
        rendered: Tensor<2>,
        photo: Tensor<2>,
        weights: Option<Tensor<1>>,
    ) -> Tensor<1> {
        let [rays, _] = rendered.dims();
        expect_shape(name, first, &rendered, [rays, 3]);
        expect_shape(name, second, &photo, [rays, 3]);
        expect_weights(name, weights.as_ref(), rays);
        let residual = rendered - photo;
        let per_channel = match self {
            Self::L2 => residual.square(),
            Self::L1 => residual.abs(),
            Self::Huber { delta } => {
                expect_delta(name, delta);
                huber(residual, delta) * 2.0
            }
        };
        let per_ray = per_channel.sum_dim(1).reshape([rays]) / 3.0;
        weighted_mean(per_ray, weights)
    }
}
