//! Mattes of surfaces that are as thin as pixels.
//!
//! A ray that passes a surface at a distance `d` has the opacity `sigmoid(-b d)` by NeuS's rendering: what it loses, from far
//! away to its nearest point, is `1 - Phi_b(d)`, and coming away again it loses nothing. Training keeps `b` low, for its steps
//! along rays are some pixels long, and so outlines are as wide. But the opacity says how far away the surface passes,
//! `b d = -logit`, and with that what a thinner one would have been: `sigmoid(-n b d)`, the logit times `n`.
//!
//! What hides the object is drawn as thin: its own edges before the object are as soft, and haze in the air, which training
//! makes up, is not to be seen. The price is that what really is translucent counts as there or as not there: through smoked
//! glass the object's matte is nearer to 0 or 1 than it should be.

use super::rays::FrozenScene;
use crate::config::Transparency;

/// `Phi_b` falls from 0.95 to 0.05 over this, divided by `b`.
const WIDTH: f32 = 6.0;

/// How many times as thin a surface is drawn as it was learnt.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgeWidth {
    times: f32,
}

impl EdgeWidth {
    /// As the scene's settings have it, where a pixel is `pixel` wide. Opacities that follow no such law stay as they are.
    pub(super) fn new(scene: &FrozenScene, pixel: f32) -> Self {
        let [b, _] = scene.fields.sharpness;
        let wanted = scene.config.export.edge_width * pixel;
        let of_a_surface = scene.config.model.object_transparency() == Transparency::Sdf
            && !scene.is_semantic()
            && !scene.mattes_need_colours();
        let times = if of_a_surface && wanted > 0.0 {
            (WIDTH / (wanted * b)).max(1.0)
        } else {
            1.0
        };
        Self { times }
    }

    /// The matte of a ray that has been rendered with `matte`.
    pub(super) fn of(self, matte: f32) -> f32 {
        if self.times == 1.0 {
            return matte;
        }
        1.0 / (1.0 + ((1.0 - matte) / matte).powf(self.times))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_opacity_of_a_thinner_surface() {
        let opacity = |b: f32, distance: f32| 1.0 / (1.0 + (b * distance).exp());
        let thinner = EdgeWidth { times: 4.0 };
        for distance in [-0.05, -0.01, -0.001, 0.0, 0.002, 0.02, 0.06] {
            let (found, expected) = (
                thinner.of(opacity(60.0, distance)),
                opacity(240.0, distance),
            );
            assert!(
                (found - expected).abs() < 1e-5,
                "{distance}: {found}, {expected}"
            );
        }
    }

    #[test]
    fn what_is_certain_stays() {
        for times in [1.0, 3.7, 1000.0] {
            let thinner = EdgeWidth { times };
            assert_eq!(
                [0.0, 0.5, 1.0].map(|matte| thinner.of(matte)),
                [0.0, 0.5, 1.0]
            );
        }
    }
}
