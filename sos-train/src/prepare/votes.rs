//! Votes of many masks on points of space: the soft visual hull.

use glam::DVec3;
use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use super::frame::Frame;
use super::view::TrainView;

/// How far each view's mask is believed, in `[0, 1]`; a view without a mask has 0.
#[derive(Clone, Debug)]
pub struct ViewTrust(pub Vec<f32>);

impl ViewTrust {
    /// Full trust in every mask there is.
    #[must_use]
    pub fn all(views: &[TrainView]) -> Self {
        Self(
            views
                .iter()
                .map(|v| f32::from(u8::from(v.mask.is_some())))
                .collect(),
        )
    }
}

/// Of which masks a third must have a place in the picture for it to be heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quorum {
    /// Of all that show something.
    OfAll,
    /// Of as many as have one and the same place in the picture: of an object that is filmed part by part no place is
    /// in most photos.
    OfBestSeen,
}

/// The masks that are asked, and how many of them must have a point in the picture to be heard.
#[derive(Debug)]
pub(super) struct Electorate<'a> {
    views: &'a [TrainView],
    trust: &'a ViewTrust,
    enough: usize,
}

impl<'a> Electorate<'a> {
    /// For places in the cube of `frame`.
    pub(super) fn new(
        views: &'a [TrainView],
        frame: &Frame,
        trust: &'a ViewTrust,
        quorum: Quorum,
    ) -> Self {
        // Of masks without anything the object is out of the picture: what the others show is not to be seen by
        // a third of those, too.
        let shows = |view: &TrainView| view.mask.as_ref().is_some_and(|mask| mask.area() > 0);
        let pairs = views.iter().zip(&trust.0);
        let showing: Vec<&TrainView> = pairs
            .filter(|(view, t)| **t > 0.0 && shows(view))
            .map(|(view, _)| view)
            .collect();
        let asked = match quorum {
            Quorum::OfAll => showing.len(),
            Quorum::OfBestSeen => most_at_once(&showing, frame),
        };
        Self {
            views,
            trust,
            enough: asked.div_ceil(3).max(asked.min(3)),
        }
    }

    /// The trusted share of masks that say "object" at a point of the scene's frame.
    ///
    /// Only views that have the point in the picture are asked; one that fewer than the quorum of them see, which is three at
    /// least where there are as many, gets 0: far out, few masks agree by chance.
    pub(super) fn vote(&self, world: DVec3) -> f32 {
        let (mut sum, mut total, mut seen) = (0.0, 0.0, 0);
        for (view, &trust) in self.views.iter().zip(&self.trust.0) {
            let Some(mask) = &view.mask else { continue };
            if trust <= 0.0 {
                continue;
            }
            let Some((pixel, _)) = view.project(world) else {
                continue;
            };
            if view.ignores(pixel.x as u32, pixel.y as u32) {
                continue;
            }
            if mask.contains(pixel.x as u32, pixel.y as u32) {
                sum += trust;
            }
            total += trust;
            seen += 1;
        }
        if seen < self.enough || total <= 0.0 {
            0.0
        } else {
            sum / total
        }
    }
}

/// How many views have the place in the picture that most of them have.
fn most_at_once(views: &[&TrainView], frame: &Frame) -> usize {
    /// Places tried along each axis of the cube.
    const TRIED: usize = 32;
    (0..TRIED.pow(3))
        .into_par_iter()
        .map(|cell| {
            let place = frame.world_from_normalised(ProbabilityMap::centre(TRIED, cell));
            let see = views.iter().filter(|view| view.project(place).is_some());
            see.count()
        })
        .max()
        .unwrap_or(0)
}

/// The vote on each voxel's centre, `[resolution^3]`, x fastest.
#[must_use]
pub fn vote_grid(
    views: &[TrainView],
    frame: &Frame,
    resolution: usize,
    trust: &ViewTrust,
    quorum: Quorum,
) -> Vec<f32> {
    let electorate = Electorate::new(views, frame, trust, quorum);
    (0..resolution.pow(3))
        .into_par_iter()
        .map(|cell| {
            electorate.vote(frame.world_from_normalised(ProbabilityMap::centre(resolution, cell)))
        })
        .collect()
}
