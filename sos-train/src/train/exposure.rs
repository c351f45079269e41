//! How bright each photo is beside the others, and of which tint.
//!
//! A camera that chooses exposure and white balance anew for each photo shows one place in several colours. Fields that
//! are the same for all photos can only average these, or explain them by haze before single cameras. So each photo has
//! a gain a channel, found from time to time from what the fields show; photos are compared with them as if
//! taken with the mean of all.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::sampler::RayBatch;
use crate::median::median;
use crate::render::rays::RenderedRay;

/// Steps between two looks.
pub(super) const EVERY: u32 = 250;
/// Pixels of each view, on average, that a look compares.
pub(super) const PIXELS: usize = 64;
/// Fewer tell nothing.
const ENOUGH: usize = 12;
/// Colours outside are next to black, whose ratio is noise, or cut off.
const TELLING: std::ops::Range<f32> = 0.04..0.96;
/// Of a gain, how much each look adds; what the fields show lags behind what they learn.
const FOLLOWED: f32 = 0.5;

/// A gain for each photo.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Exposures {
    /// Logarithms, by view and channel; empty where all photos count as taken alike.
    gains: Vec<[f32; 3]>,
}

impl Exposures {
    /// A colour that the fields show, as this view's photo would.
    #[must_use]
    pub fn as_taken(&self, view: usize, colour: Vec3) -> Vec3 {
        match self.gains.get(view) {
            Some(gain) => (colour * Vec3::from(gain.map(f32::exp))).min(Vec3::ONE),
            None => colour,
        }
    }

    /// Gives the batch's pixels the colours that they would have in a photo of mean exposure.
    pub(super) fn even_out(&self, batch: &mut RayBatch) {
        if self.gains.is_empty() {
            return;
        }
        for (colour, view) in batch.colours.chunks_exact_mut(3).zip(&batch.views) {
            let gain = self.gains[*view as usize];
            for (value, gain) in colour.iter_mut().zip(gain) {
                *value *= (-gain).exp();
            }
        }
    }

    /// Follows what `rendered` shows of the pixels of `batch`, which are as taken, out of `views` photos.
    pub(super) fn follow(&mut self, batch: &RayBatch, rendered: &[RenderedRay], views: usize) {
        let mut ratios = vec![[const { Vec::new() }; 3]; views];
        let photo = batch.colours.chunks_exact(3);
        for ((photo, hit), view) in photo.zip(rendered).zip(&batch.views) {
            for (channel, (photo, shown)) in photo.iter().zip(hit.joint.to_array()).enumerate() {
                if TELLING.contains(photo) && TELLING.contains(&shown) {
                    ratios[*view as usize][channel].push((photo / shown).ln());
                }
            }
        }
        let before = |view: usize| self.gains.get(view).copied().unwrap_or_default();
        let mut found: Vec<[f32; 3]> = ratios
            .into_iter()
            .enumerate()
            .map(|(view, channels)| {
                let mut gain = before(view);
                for (gain, mut ratios) in gain.iter_mut().zip(channels) {
                    if ratios.len() >= ENOUGH
                        && let Some(ratio) = median(&mut ratios)
                    {
                        *gain += FOLLOWED * (ratio - *gain);
                    }
                }
                gain
            })
            .collect();
        for channel in 0..3 {
            let mean = found.iter().map(|gain| gain[channel]).sum::<f32>() / views.max(1) as f32;
            found.iter_mut().for_each(|gain| gain[channel] -= mean);
        }
        self.gains = found;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Views of one grey scene, each half a stop from the next, one of them tinted.
    fn taken() -> (RayBatch, Vec<RenderedRay>) {
        let (mut batch, mut rendered) = (RayBatch::default(), Vec::new());
        for i in 0..300_u32 {
            let (view, shown) = (i % 3, 0.2 + 0.001 * i as f32);
            let gain = 2_f32.powf(0.5 * (view as f32 - 1.0));
            let blue = if view == 2 { 0.8 } else { 1.0 };
            batch.views.push(view);
            batch
                .colours
                .extend([gain * shown, gain * shown, blue * gain * shown]);
            rendered.push(RenderedRay {
                joint: Vec3::splat(shown),
                ..RenderedRay::default()
            });
        }
        (batch, rendered)
    }

    #[test]
    fn photos_of_other_exposure_and_tint_are_evened_out() {
        let (batch, rendered) = taken();
        let mut exposures = Exposures::default();
        assert_eq!(exposures.as_taken(1, Vec3::splat(0.3)), Vec3::splat(0.3));
        for _ in 0..12 {
            exposures.follow(&batch, &rendered, 3);
        }
        let mut evened = batch.clone();
        exposures.even_out(&mut evened);
        // Up to one colour for all: of the tint a third is everybody's.
        let factor = |i: usize| evened.colours[i] / rendered[i / 3].joint.x;
        for i in 0..batch.colours.len() {
            assert!(
                (factor(i) - factor(i % 3)).abs() < 2e-3,
                "{i}: {}",
                factor(i)
            );
        }
        let shown = Vec3::splat(0.3);
        let brighter = exposures.as_taken(2, shown) / exposures.as_taken(0, shown);
        assert!(
            (brighter.x - 2.0).abs() < 0.01 && (brighter.z - 1.6).abs() < 0.01,
            "{brighter}"
        );
    }

    #[test]
    fn a_view_that_shows_nothing_telling_keeps_its_gain() {
        let (mut batch, rendered) = taken();
        for (colour, view) in batch.colours.chunks_exact_mut(3).zip(&batch.views) {
            if *view == 1 {
                colour.fill(1.0);
            }
        }
        let mut exposures = Exposures::default();
        exposures.follow(&batch, &rendered, 3);
        let (dark, burnt) = (
            exposures.as_taken(0, Vec3::ONE * 0.3),
            exposures.as_taken(1, Vec3::ONE * 0.3),
        );
        assert!(burnt.is_finite() && (burnt.x - 0.3).abs() < 0.02, "{burnt}");
        assert!(dark.x < 0.28, "{dark}");
    }
}
