//! One field for the whole scene that knows what is the object: a rival to two.
//!
//! Semantic-NeRF (Zhi et al. 2021) has a radiance field say of every place which class it belongs to,
//! and learns that from masks however rough they are: views that see the same place outvote each other.
//! Here the field is BaCo's, a density over contracted space with a grid and networks of the same size,
//! which stays the only one. A further output of its density network, `z`, does not depend on where it is
//! seen from; its share of the object and that of a pixel are
//!
//! ```text
//! p_i = 1 / (1 + exp(-z_i)),   P = sum_i w_i p_i      w: the weights that colours have
//! ```
//!
//! The cross entropy of `P` with the masks as they were given is part of the loss for the whole run, with
//! the weight that Semantic-NeRF has, and its gradient reaches densities as it does there. `P` is the
//! matte.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::TensorData;
use losses::{OPACITY_OFFSET, mask_loss};
use neus_render::composite::{CompositeConfig, Packing, column, composite, object_column};
use scene_decomp::Geometry;

/// The feature that is `z`.
const LOGIT: usize = 0;

/// `p` of sample `i`, in `[0, 1]`.
#[must_use]
pub fn share_at(geometry: &Geometry, i: usize) -> f32 {
    1.0 / (1.0 + (-logit_at(geometry, i)).exp())
}

/// `z` of sample `i`: positive where the object is.
#[must_use]
pub fn logit_at(geometry: &Geometry, i: usize) -> f32 {
    geometry.feature(i, LOGIT)
}

/// `P` of a batch's rays, `[rays]`, from the field's rows for compositing `[m, 5 or more]` and its
/// geometry `[m, 1 + G + 3]`.
#[must_use]
pub fn share(
    rows: Tensor<2>,
    geometry: Tensor<2>,
    sharpness: Tensor<1>,
    packing: Arc<Packing>,
    compositing: CompositeConfig,
) -> Tensor<1> {
    let ([samples, _], rays) = (rows.dims(), packing.ray_count());
    let logit = geometry.slice([0..samples, 1 + LOGIT..2 + LOGIT]);
    let p = burn::tensor::activation::sigmoid(logit);
    // Composited in place of the colours, so that weights are theirs.
    let rows = Tensor::cat(
        vec![rows.slice([0..samples, 0..2]), p.clone(), p.clone(), p],
        1,
    );
    let nothing = Tensor::zeros([0, object_column::COUNT], &rows.device());
    let first = column::BACKGROUND_COLOUR;
    composite(nothing, rows, sharpness, packing, compositing)
        .slice([0..rays, first..first + 1])
        .reshape([rays])
}

/// The cross entropy of `share` `[rays]` and the masks' pixels `[rays]`, over the rays that have one.
#[must_use]
pub fn loss(share: Tensor<1>, masks: &[Option<bool>]) -> Tensor<1> {
    let device = share.device();
    let list = |of: &dyn Fn(&Option<bool>) -> bool| -> Tensor<1> {
        let values: Vec<f32> = masks.iter().map(|m| f32::from(u8::from(of(m)))).collect();
        let n = values.len();
        Tensor::from_data(TensorData::new(values, [n]), &device)
    };
    let outside = share.clone().neg().add_scalar(1.0 + OPACITY_OFFSET).log();
    mask_loss(
        share,
        outside,
        list(&|mask| *mask == Some(true)),
        Some(list(&|mask| mask.is_some())),
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use burn::tensor::Device;
    use neus_render::composite::Transparency;

    use super::*;

    /// A veil that stops half of the light before a wall: `z` of both, then `P`.
    fn pixel(veil: f32, wall: f32) -> f32 {
        let device = Device::flex();
        let packing = Packing::new(
            vec![0, 2],
            vec![1.0, 2.0],
            vec![0.1; 2],
            Vec::new(),
            vec![0, 1],
        );
        let half = std::f32::consts::LN_2 / 0.1;
        let rows = Tensor::from_floats(
            [
                [half, 0.0, 0.3, 0.6, 0.9, 0.0],
                [1e4, 0.0, 0.2, 0.4, 0.8, 0.0],
            ],
            &device,
        );
        let geometry = Tensor::from_floats(
            [
                [0.0, veil, 7.0, 0.0, 0.0, 0.0],
                [0.0, wall, 7.0, 0.0, 0.0, 0.0],
            ],
            &device,
        );
        let sharpness = Tensor::from_floats([20.0; 2], &device);
        let compositing = CompositeConfig {
            background: Transparency::Density,
            ..CompositeConfig::default()
        };
        let share = share(rows, geometry, sharpness, Arc::new(packing), compositing);
        share.into_data().try_to_vec::<f32>().unwrap()[0]
    }

    #[test]
    fn shares_are_blended_as_colours_are() {
        let p = |z: f32| 1.0 / (1.0 + (-z).exp());
        for (veil, wall) in [(3.0, -2.0), (-1.0, 4.0), (0.0, 0.0)] {
            let expected = 0.5 * p(veil) + 0.5 * p(wall);
            assert!((pixel(veil, wall) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn rays_without_a_mask_say_nothing() {
        let device = Device::flex();
        let value = |shares: [f32; 3], masks: [Option<bool>; 3]| -> f32 {
            loss(Tensor::from_floats(shares, &device), &masks).into_scalar()
        };
        let masks = [Some(true), Some(false), None];
        let expected = -0.5 * (0.801f32.ln() + 0.701f32.ln());
        for third in [0.0, 1.0] {
            assert!((value([0.8, 0.3, third], masks) - expected).abs() < 1e-5);
        }
        assert!(value([0.2, 0.9, 0.0], masks) > expected);
    }
}
