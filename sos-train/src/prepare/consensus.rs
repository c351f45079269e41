//! What all masks together say of the object, and which of them say something else.

use image::GrayImage;
use io_colmap::SparsePoint;
use scene_decomp::probability::ProbabilityMap;

use super::error::PrepareError;
use super::frame::Frame;
use super::view::TrainView;
use super::votes::{Quorum, ViewTrust, vote_grid};
use super::{MAP_RESOLUTION, locate, outline};
use crate::config::PrepareConfig;

/// Masks that overlap with their consensus by this much, by the median, are heard rightly.
const AGREED: f32 = 0.5;

/// What all masks together say, coarsely, but enough to see which of them contradict the others.
#[derive(Debug)]
pub struct MaskConsensus {
    /// Where they agree that the object is.
    pub frame: Frame,
    /// For each view, at an eighth of its size, the share of masks that take it for the object.
    pub silhouettes: Vec<GrayImage>,
    /// How far each view's own mask is believed.
    pub trust: ViewTrust,
    /// Which places are heard when they vote.
    pub quorum: Quorum,
    /// The median overlap of a mask with what all of them say.
    agreement: f32,
}

impl MaskConsensus {
    /// Of the views that have a mask. `points` are the model's sparse points.
    ///
    /// A place counts where a third of all masks have it in the picture. Where that leaves little of what they show, as
    /// with an object that was filmed part by part, a third of those that have any one place in common may do better.
    ///
    /// # Errors
    /// When they do not determine a box.
    pub fn of(
        views: &[TrainView],
        points: &[SparsePoint],
        config: &PrepareConfig,
    ) -> Result<Self, PrepareError> {
        let agreement =
            |found: &Result<Self, _>| found.as_ref().map_or(0.0, |f: &Self| f.agreement);
        let whole = Self::by(Quorum::OfAll, views, points, config);
        if agreement(&whole) >= AGREED {
            return whole;
        }
        let parts = Self::by(Quorum::OfBestSeen, views, points, config);
        if agreement(&parts) > agreement(&whole) {
            parts
        } else {
            whole
        }
    }

    fn by(
        quorum: Quorum,
        views: &[TrainView],
        points: &[SparsePoint],
        config: &PrepareConfig,
    ) -> Result<Self, PrepareError> {
        const STRIDE: u32 = 8;
        let frame = locate::box_from_masks(views, points, config, quorum)?;
        let coarse = MAP_RESOLUTION / 2;
        let votes = vote_grid(views, &frame, coarse, &ViewTrust::all(views), quorum);
        let silhouettes = silhouettes(views, &frame, &ProbabilityMap::new(coarse, votes), STRIDE);
        let (trust, agreement) =
            outline::trust_masks(views, &silhouettes, STRIDE, config.object_threshold);
        Ok(Self {
            frame,
            silhouettes,
            trust,
            quorum,
            agreement,
        })
    }

    /// What to say about masks that are set aside, if there are any.
    #[must_use]
    pub fn note(&self, views: &[TrainView]) -> Option<String> {
        let doubted: Vec<&str> = self.doubted(views).collect();
        (!doubted.is_empty()).then(|| {
            let says = match doubted.len() {
                1 => "1 mask contradicts the others and is".to_owned(),
                n => format!("{n} masks contradict the others and are"),
            };
            format!("{says} set aside: {}", doubted.join(", "))
        })
    }

    /// The names of the views whose masks are set aside.
    fn doubted<'a>(&self, views: &'a [TrainView]) -> impl Iterator<Item = &'a str> {
        views
            .iter()
            .zip(&self.trust.0)
            .filter(|(view, trust)| view.mask.is_some() && **trust < 0.5)
            .map(|(view, _)| view.name.as_str())
    }
}

fn silhouettes(
    views: &[TrainView],
    frame: &Frame,
    map: &ProbabilityMap,
    stride: u32,
) -> Vec<GrayImage> {
    views
        .iter()
        .map(|view| outline::silhouette(view, frame, map, stride))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::balls::{view, with_balls};
    use super::*;
    use crate::config::TrainConfig;
    use glam::DVec3;

    /// What masks of a ball of radius 2 say, taken all around it with this focal length, in pixels of 64.
    fn filmed(focal: f64) -> MaskConsensus {
        let ball = (DVec3::ZERO, 2.0);
        let turn = |i: u32| 2.4 * f64::from(i);
        let views: Vec<TrainView> = (0..80)
            .map(|i| {
                let height = (f64::from(i) + 0.5) / 40.0 - 1.0;
                let around = DVec3::new(turn(i).cos(), turn(i).sin(), 0.0);
                let from = 9.0 * (around * (1.0 - height * height).sqrt() + DVec3::Z * height);
                // Each shows another part.
                let at = turn(7 * i);
                let across = from.any_orthonormal_vector();
                let along = across.cross(from.normalize());
                let aim = (across * at.cos() + along * at.sin()) * 2.0 * turn(i).fract().sqrt();
                let mut view = view(from, aim - from);
                view.lens.0.params = vec![focal, focal, 32.0, 24.0];
                with_balls(view, &[ball])
            })
            .collect();
        MaskConsensus::of(&views, &[], &TrainConfig::default().prepare).unwrap()
    }

    #[test]
    fn an_object_is_whole_in_the_box_though_each_photo_shows_but_a_part() {
        for (focal, quorum) in [(60.0, Quorum::OfAll), (360.0, Quorum::OfBestSeen)] {
            let found = filmed(focal);
            assert_eq!(found.quorum, quorum, "{focal}: {}", found.agreement);
            let half_side = found.frame.half_side;
            assert!(
                found.frame.centre.length() + 2.0 < half_side,
                "{:?}",
                found.frame
            );
            assert!(half_side < 3.5, "{:?}", found.frame);
        }
    }
}
