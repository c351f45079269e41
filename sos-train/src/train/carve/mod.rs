//! Carving FoCoR out of a scene that BaCo has learnt alone.
//!
//! A density finds its geometry from photos far sooner than a surface does, whose every hollow has
//! to be dug from a convex start. So a run may begin with BaCo for the whole scene. Then the masks'
//! votes on its surfaces say what is the object ([`SurfaceVotes`](scene_decomp::SurfaceVotes)), its
//! depths seen from all views are fused into a signed distance ([`fusion`]), and FoCoR starts from
//! there ([`fit`]); BaCo is cropped, and both go on together.

pub mod cast;
pub mod crumbs;
pub mod depth;
pub mod fit;
pub mod fusion;
mod leaks;
pub mod mask_fit;
pub mod openings;

use scene_decomp::probability::ProbabilityMap;

use super::{Trainer, schedule};
use crate::config::{Fields, Majority};
use crate::distance::signed_distance;
use crate::prepare::Prepared;
use crate::prepare::error::PrepareError;
use crate::prepare::mask::Mask;
use crate::prepare::spans::PixelSpans;
use crate::render::rays::FrozenScene;

/// Rays whose depths are fused: about so many of a view where there are many views, and so many of all together where
/// there are few.
const RAYS: (usize, usize) = (6_000, 300_000);
/// Euclidean distances up to this many voxels are told apart.
const REACH: usize = 8;
/// How far behind the nearest surface that hides it a place can be the object's, in half sides of the box. More than one: the
/// middle of a block that fills the box is that far behind its faces.
const DEEPEST: f32 = 1.25;
/// Parts with less than this share of the largest one's voxels are crumbs.
const SMALLEST_PART: f32 = 0.01;

/// How many rays of all views together are asked about something: `each` of a view, but `least` where that is less, so
/// that many views do not leave each with few.
fn rays_of(data: &Prepared, (each, least): (usize, usize)) -> usize {
    (each * data.views.len()).max(least)
}

/// Pixels of all masks.
fn covered(data: &Prepared) -> usize {
    let masks = data.views.iter().filter_map(|view| view.mask.as_ref());
    masks.map(Mask::area).sum()
}

/// Takes the vote from pixels. Returns of how many masks there are any, how many masks there are, and the percentage of
/// what they cover; `None` without any.
fn silence(data: &mut Prepared, silent: &[PixelSpans]) -> Option<(usize, usize, f32)> {
    for (outline, pixels) in data.outlines.iter_mut().zip(silent) {
        outline.silence(pixels);
    }
    let masks = silent.iter().filter(|pixels| !pixels.is_empty()).count();
    let all = data.views.iter().filter(|view| view.mask.is_some()).count();
    let in_masks = data.views.iter().zip(silent).map(|(view, pixels)| {
        let (mask, width) = (view.mask.as_ref(), view.width());
        let in_mask =
            |pixel: &u32| mask.is_some_and(|mask| mask.contains(pixel % width, pixel / width));
        pixels.iter().filter(in_mask).count()
    });
    let pixels: usize = in_masks.sum();
    (masks > 0).then(|| {
        (
            masks,
            all,
            100.0 * pixels as f32 / covered(data).max(1) as f32,
        )
    })
}

impl Trainer {
    /// Just before the carving, corrects what geometry shows to be wrong with the masks. Returns what was done, for people.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for the masks.
    pub fn correct_masks(&mut self, data: &mut Prepared) -> Result<Vec<String>, PrepareError> {
        let config = self.config().prepare.clone();
        let asked = config.fit_masks || config.find_openings || config.find_leaks;
        if !asked || !self.is_carving_due() {
            return Ok(Vec::new());
        }
        let scene = self.freeze_before();
        let mut notes = Vec::new();
        if config.fit_masks {
            notes.extend(self.fit_masks(&scene, data)?);
        }
        let silenced = notes.len();
        if config.find_openings {
            notes.extend(self.find_openings(&scene, data));
        }
        if config.find_leaks {
            notes.extend(self.find_leaks(data));
        }
        if notes.len() > silenced {
            self.vote_anew(&scene, data);
        }
        Ok(notes)
    }

    /// Ends BaCo's time alone: m^P from the votes, FoCoR's shape from BaCo's depths.
    pub(super) fn carve(&mut self, data: &Prepared) {
        let depths = depth::depth_pictures(&self.freeze_before(), data, rays_of(data, RAYS));
        self.follow(self.probability(data));
        let resolution = self.map.resolution();
        let crop = self.context.config.prepare.crop_threshold;
        let fused = fusion::fuse(data, &depths, &self.map, crop, DEEPEST);
        // The object is what is solid and on its side of m^P.
        let mut inside: Vec<bool> = fused.iter().map(|distance| *distance < 0.0).collect();
        crumbs::keep_large_parts(&mut inside, resolution, SMALLEST_PART);
        let voxel = 2.0 / resolution as f32;
        let distances: Vec<f32> = signed_distance(&inside, &[resolution; 3], REACH)
            .into_iter()
            .map(|d| d * voxel)
            .collect();
        let near = (0..distances.len() as u32)
            .filter(|&cell| distances[cell as usize].abs() < 2.0 * voxel)
            .collect();
        let shape = fit::Shape {
            distance: ProbabilityMap::new(resolution, distances),
            truncation: REACH as f32 * voxel,
            near,
        };
        self.fit_object(data, &shape);
    }

    /// Whether the next step begins with the carving.
    pub(super) fn is_carving_due(&self) -> bool {
        let config = &self.context.config;
        config.model.fields == Fields::Both
            && self.step > 0
            && self.step == schedule::carve_step(config)
    }

    /// m^P by the votes so far.
    pub(super) fn probability(&self, data: &Prepared) -> ProbabilityMap {
        self.votes.map(&data.map, self.tipping_point())
    }

    /// The share of its votes from which on a place is the object's.
    fn tipping_point(&self) -> f32 {
        match self.context.config.model.majority {
            Majority::Half => 0.5,
            Majority::Fitted => self.votes.tipping_point(),
        }
    }

    /// Just before the carving, what masks tell of how they err, for people; `None` if to both sides alike.
    #[must_use]
    pub fn majority_note(&self) -> Option<String> {
        if !self.is_carving_due() {
            return None;
        }
        let tipping = self.tipping_point();
        let how = match tipping {
            t if t < 0.5 => "lose parts of the object more often than they include others",
            t if t > 0.5 => "include others more often than they lose parts of the object",
            _ => return None,
        };
        Some(format!(
            "masks {how}: a place is the object's from {:.0} % of its votes on",
            100.0 * tipping
        ))
    }

    /// The scene as it was a step ago: just before the carving, with all space BaCo's.
    pub(crate) fn freeze_before(&self) -> FrozenScene {
        let scene = self.freeze();
        FrozenScene {
            step: scene.step.saturating_sub(1),
            ..scene
        }
    }
}
