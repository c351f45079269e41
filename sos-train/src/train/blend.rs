//! How the two fields become one colour and a matte.
//!
//! The matte is the surface's opacity, the colour network's head, or the head as a factor of each
//! sample's opacity. Colours meet per sample in depth order, or per ray (method: open points 1, 2):
//!
//! ```text
//! sample:  C = sum w_F c_F + w_B c_B                  w with the transmittance of both fields
//! ray:     C = C_F A + C_B (1 - A)                    each field drawn by itself
//! head:    A = sum w_F alpha,  and what the head holds back shows C_B
//! ```

use std::sync::Arc;

use burn::Tensor;
use neus_render::composite::{CompositeConfig, Packing, column, composite};

use crate::config::{AlphaSource, Blend, ModelConfig};

/// Pixels of a batch of rays.
#[derive(Clone, Debug)]
pub struct Blended {
    /// Colour of both fields, `[rays, 3]`.
    pub colour: Tensor<2>,
    /// The visible object's share, `[rays, 1]`.
    pub matte: Tensor<2>,
    /// What [`composite`] gave, `[rays, 20]`.
    pub rendered: Tensor<2>,
}

/// Composites the fields' samples as `model` says.
///
/// `object` `[m_f, 6 or more]` has the head's value in its matte column, which `composite_config` reads
/// as the source of the matte wants it ([`composite_config`](super::visible::composite_config));
/// `background` is `[m_b, 5 or more]`, `sharpness` `[2]`.
#[must_use]
pub fn blend(
    object: Tensor<2>,
    background: Tensor<2>,
    sharpness: Tensor<1>,
    packing: Arc<Packing>,
    composite_config: CompositeConfig,
    model: &ModelConfig,
) -> Blended {
    let rays = packing.ray_count();
    let rendered = composite(object, background, sharpness, packing, composite_config);
    let part = |first: usize, count: usize| rendered.clone().slice([0..rays, first..first + count]);
    let (colour, opacity, head) = match model.blend {
        Blend::Sample => (column::JOINT_COLOUR, column::MATTE, column::HEAD),
        Blend::Ray => (
            column::OBJECT_COLOUR,
            column::OBJECT_OPACITY,
            column::HEAD_ALONE,
        ),
    };
    let matte = part(
        match model.alpha {
            AlphaSource::Head => head,
            AlphaSource::Opacity | AlphaSource::Both => opacity,
        },
        1,
    );
    let colour = part(colour, 3);
    // What shows the background besides, where colours do not hold it yet.
    let share = match (model.blend, model.alpha) {
        (Blend::Ray, _) => Some(matte.clone().neg().add_scalar(1.0)),
        (Blend::Sample, AlphaSource::Head) => Some(part(opacity, 1) - matte.clone()),
        (Blend::Sample, AlphaSource::Opacity | AlphaSource::Both) => None,
    };
    let colour = match share {
        Some(share) => colour + part(column::BACKGROUND_COLOUR, 3) * share,
        None => colour,
    };
    Blended {
        colour,
        matte,
        rendered,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use burn::tensor::Device;
    use neus_render::composite;

    use super::*;
    use crate::config::{Preset, TrainConfig};
    use crate::train::visible::matte_role;

    /// A red object whose head says 0.5, between a thin blue veil and a green wall.
    fn pixel(blend_by: Blend, alpha: AlphaSource, head: f32) -> (Vec<f32>, f32) {
        let device = Device::flex();
        let packing = Packing::new(
            vec![0, 4],
            vec![1.0, 2.0, 2.1, 3.0],
            vec![0.1; 4],
            vec![1, 2],
            vec![0, 3],
        );
        let model = ModelConfig {
            blend: blend_by,
            alpha,
            ..TrainConfig::preset(Preset::Default).model
        };
        // The veil lets half of the light through.
        let veil = std::f32::consts::LN_2 / 0.1;
        let out = blend(
            Tensor::from_floats(
                [
                    [0.05, -1.0, 1.0, 0.0, 0.0, head],
                    [-0.05, -1.0, 1.0, 0.0, 0.0, head],
                ],
                &device,
            ),
            Tensor::from_floats(
                [[veil, 0.0, 0.0, 0.0, 1.0], [1e4, 0.0, 0.0, 1.0, 0.0]],
                &device,
            ),
            Tensor::from_floats([400.0, 400.0], &device),
            Arc::new(packing),
            CompositeConfig {
                background: composite::Transparency::Density,
                matte: matte_role(alpha),
                ..CompositeConfig::default()
            },
            &model,
        );
        let list = |of: Tensor<2>| of.into_data().try_to_vec::<f32>().unwrap();
        (list(out.colour), list(out.matte)[0])
    }

    fn close(found: (Vec<f32>, f32), colour: [f32; 3], matte: f32) {
        for (found, expected) in found.0.iter().zip(colour) {
            assert!((found - expected).abs() < 1e-3, "{found} {expected}");
        }
        assert!((found.1 - matte).abs() < 1e-3, "{} {matte}", found.1);
    }

    #[test]
    fn what_stands_before_the_object_hides_it_only_per_sample() {
        let sample = pixel(Blend::Sample, AlphaSource::Opacity, 0.5);
        close(sample, [0.5, 0.0, 0.5], 0.5);
        let ray = pixel(Blend::Ray, AlphaSource::Opacity, 0.5);
        close(ray, [1.0, 0.0, 0.0], 1.0);
    }

    #[test]
    fn what_the_head_holds_back_shows_the_background() {
        // Behind the veil comes the wall: the background alone is half blue, half green.
        close(
            pixel(Blend::Ray, AlphaSource::Head, 0.5),
            [0.5, 0.25, 0.25],
            0.5,
        );
        close(
            pixel(Blend::Sample, AlphaSource::Head, 0.5),
            [0.25, 0.125, 0.625],
            0.25,
        );
        for blend_by in [Blend::Sample, Blend::Ray] {
            let (plain, full) = (
                pixel(blend_by, AlphaSource::Opacity, 1.0),
                pixel(blend_by, AlphaSource::Head, 1.0),
            );
            close(full, [plain.0[0], plain.0[1], plain.0[2]], plain.1);
        }
    }

    #[test]
    fn as_a_factor_the_head_makes_each_sample_thinner() {
        let (colour, matte) = pixel(Blend::Sample, AlphaSource::Both, 0.5);
        // Opacities of the two samples 0.5 and 1, halved: 0.25 and 0.5 of what the veil lets through.
        assert!((matte - 0.5 * 0.625).abs() < 1e-3, "{matte}");
        assert!((colour[1] - 0.5 * 0.375).abs() < 1e-3, "{}", colour[1]);
    }
}
