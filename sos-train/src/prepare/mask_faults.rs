//! What geometry shows to be wrong with masks, once there is some.

use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;
use serde::{Deserialize, Serialize};

use super::error::PrepareError;
use super::spans::PixelSpans;
use super::votes::vote_grid;
use super::{MAP_RESOLUTION, Prepared, TrainView, mask_shift, outlines};
use crate::config::PrepareConfig;

/// The faults of all views' masks, and what stands in for masks that are missing. Lists may end early: what is beyond has none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MaskFaults {
    /// By how many pixels the outline of each view's mask is too far in, all around; too far out where negative.
    pub shifts: Vec<f32>,
    /// Pixels of each view's mask that show what lies behind the object, through an opening.
    pub openings: Vec<PixelSpans>,
    /// Pixels of each view that its mask leaks into, over what has no edge; where it cuts that in halves, both of them.
    #[serde(default)]
    pub leaks: Vec<PixelSpans>,
    /// Pixels of each view on which the photo shows the object, as its colours say, though something hid it.
    #[serde(default)]
    pub alike: Vec<PixelSpans>,
}

impl MaskFaults {
    /// What is added to the shift of each view's mask, in pixels.
    pub fn shift_by(&mut self, shifts: &[f32]) {
        let views = self.shifts.len().max(shifts.len());
        self.shifts.resize(views, 0.0);
        for (total, shift) in self.shifts.iter_mut().zip(shifts) {
            *total += shift;
        }
    }

    /// The shift of a view's mask, in pixels.
    #[must_use]
    pub fn shift(&self, view: usize) -> f32 {
        self.shifts.get(view).copied().unwrap_or(0.0)
    }
}

impl Prepared {
    /// Moves the outline of each view's given mask to where it belongs, has the masks vote on space and label the pixels
    /// anew, takes the vote from those in openings and leaks, and notes which have the object's colours. The box stays.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for the masks; all stays as it was.
    pub fn correct_masks(
        &mut self,
        faults: &MaskFaults,
        config: &PrepareConfig,
        ignore_band: f32,
    ) -> Result<(), PrepareError> {
        if faults.shifts.iter().any(|shift| *shift != 0.0) || !self.masks_are_given() {
            self.shift_masks(faults, config, ignore_band)?;
        }
        for silent in [&faults.openings, &faults.leaks] {
            for (outline, pixels) in self.outlines.iter_mut().zip(silent) {
                outline.silence(pixels);
            }
        }
        for (outline, alike) in self.outlines.iter_mut().zip(&faults.alike) {
            outline.mark_alike(alike);
        }
        Ok(())
    }

    fn shift_masks(
        &mut self,
        faults: &MaskFaults,
        config: &PrepareConfig,
        ignore_band: f32,
    ) -> Result<(), PrepareError> {
        let given = self.views.par_iter().zip(&self.given_masks).enumerate();
        let views = given
            .map(|(number, (view, given))| {
                let shift = faults.shift(number);
                let view = TrainView {
                    mask: given.clone(),
                    ..view.clone()
                };
                match given {
                    Some(given) if shift != 0.0 => {
                        view.with_mask(&mask_shift::shifted(given, shift))
                    }
                    _ => Ok(view),
                }
            })
            .collect::<Result<Vec<TrainView>, PrepareError>>()?;
        let (frame, trust) = (&self.frame, &self.trust);
        let votes = vote_grid(&views, frame, MAP_RESOLUTION, trust, self.quorum);
        let map = ProbabilityMap::new(MAP_RESOLUTION, votes);
        self.outlines = outlines(&views, frame, &map, trust, config, ignore_band);
        (self.views, self.map) = (views, map);
        Ok(())
    }

    fn masks_are_given(&self) -> bool {
        let mut both = self.views.iter().zip(&self.given_masks);
        both.all(|(view, given)| view.mask == *given)
    }
}
