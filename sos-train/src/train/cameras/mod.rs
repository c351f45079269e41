//! Cameras that are not quite where they are said to be.
//!
//! Poses of a phone's tracking, of a rolling shutter or of a model without lens distortion miss by pixels. Fields that learn
//! from them are blurred, and so are outlines. So photos are aligned with what the fields have learnt from all of them
//! together, now and then, and cameras move by what that tells ([`alignment`]). Where cameras are right, moving them
//! would only follow the fields' own errors: they move where a first look finds them off by more than those.

mod alignment;
mod alone;
mod gauge;
mod landmarks;

use io_colmap::Pose;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Trainer;
use crate::config::CameraRefinement;
use crate::median::median;
use crate::prepare::error::PrepareError;
use crate::prepare::{Prepared, TrainView};
use alignment::{Alignment, Motion, align, apart};
use alone::Suspect;
use landmarks::{Reduced, landmarks};

/// Alignments are this share of the run apart; numbers of the first and the last.
const EVERY: f32 = 0.05;
const ROUNDS: std::ops::RangeInclusive<u32> = 3..=17;
/// Rounds in which cameras are looked at that are not known to be off: what has learnt little in the first one tells little.
/// One camera among others that are right has to be off in both.
const LOOKS: [u32; 2] = [3, 5];
/// Up to this round blurred outlines are aligned, in photos whose longer side has about so many pixels.
const COARSE_ROUNDS: u32 = 8;
const COARSE_SIDE: f32 = 400.0;
/// The same for the rounds after that.
const FINE_SIDE: f32 = 800.0;
/// The median shift, in coarse pixels, from which on all cameras are taken to be off. Of cameras that are right
/// (docs/decisions/mattes-and-cameras.md) fields in the making make 0.05 to 0.15.
const OFF: f64 = 0.25;
/// No camera moves by more at once: what seems to be so far off is something else.
const LARGEST_SHIFT: f64 = 12.0;

/// What has become of the cameras.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Cameras {
    /// For each view whether its camera moves; empty while none does.
    moving: Vec<bool>,
    /// Of all views, once one has moved; otherwise they are as given.
    poses: Vec<Pose>,
    /// What a first look made of each camera, where not all are off; empty before.
    #[serde(default)]
    suspects: Vec<Option<Suspect>>,
}

impl Cameras {
    /// Decides which cameras move by what a look at all says; `given` are their poses.
    fn decide(&mut self, found: &[Found], given: &[Pose], wanted: CameraRefinement) {
        let mut shifts: Vec<f64> = found.iter().map(|found| found.alignment.shift).collect();
        let all = match wanted {
            CameraRefinement::Always => true,
            CameraRefinement::Never => return,
            CameraRefinement::Auto => median(&mut shifts).is_some_and(|shift| shift > OFF),
        };
        if all {
            self.moving = vec![true; found.len()];
            self.suspects.clear();
        } else if self.suspects.is_empty() {
            let suspects = found.iter().zip(given);
            self.suspects = suspects.map(|(f, given)| Suspect::of(f, *given)).collect();
        } else {
            let is_off = |(suspect, found): (&Option<Suspect>, _)| {
                suspect.is_some_and(|suspect| suspect.is_off(found))
            };
            self.moving = self.suspects.iter().zip(found).map(is_off).collect();
        }
        self.forget_if_none_moves();
    }

    fn forget_if_none_moves(&mut self) {
        if !self.moving.contains(&true) {
            self.moving.clear();
            self.poses.clear();
        }
    }

    /// Whether all cameras move, which is never taken back.
    fn all_move(&self) -> bool {
        !self.moving.is_empty() && !self.moving.contains(&false)
    }

    /// What a look at camera `number` is held against, if anything.
    fn reference(&self, number: usize, now: &Pose, half_side: f64) -> Option<Motion> {
        let moves = self.moving.get(number).is_some_and(|moves| *moves);
        let suspect = self.suspects.get(number)?.as_ref()?;
        Some(suspect.reference(moves, now, half_side))
    }
}

impl Trainer {
    /// Aligns cameras with the photos when that is due. Returns what people should know.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room for smaller photos.
    pub fn refine_cameras(&mut self, data: &mut Prepared) -> Result<Option<String>, PrepareError> {
        let wanted = self.config().prepare.refine_cameras;
        let stride = (EVERY * self.config().steps as f32) as u32;
        if wanted == CameraRefinement::Never || stride == 0 || !self.step.is_multiple_of(stride) {
            return Ok(None);
        }
        let round = self.step / stride;
        let looks = LOOKS.contains(&round) && self.cameras.moving.is_empty();
        if !ROUNDS.contains(&round) || !(looks || self.cameras.moving.contains(&true)) {
            return Ok(None);
        }
        let coarse = round <= COARSE_ROUNDS;
        let found = self.alignments(data, if coarse { COARSE_SIDE } else { FINE_SIDE })?;
        let before: Vec<Pose> = data
            .views
            .iter()
            .map(|view| view.camera_from_world)
            .collect();
        if looks {
            self.cameras.decide(&found, &before, wanted);
        }
        let moving = self.cameras.moving.clone();
        if moving.is_empty() {
            return Ok(None);
        }
        let mut poses = before.clone();
        let mut wandered = Vec::new();
        for (i, pose) in poses.iter_mut().enumerate().filter(|(i, _)| moving[*i]) {
            let suspect = self.cameras.suspects.get(i).copied().flatten();
            // A look holds what it finds against the first one, the others against where the camera was.
            let back = suspect.filter(|_| !looks).and_then(|s| s.back(&found[i]));
            if let Some(given) = back {
                *pose = given;
                self.cameras.moving[i] = false;
                wandered.push(data.views[i].name.clone());
            } else if found[i].alignment.shift < LARGEST_SHIFT {
                let moved = found[i].alignment.motion;
                *pose = Pose {
                    rotation: (moved.rotation * pose.rotation).normalize(),
                    // Camera space of the normalised frame has another unit.
                    translation: moved.rotation * pose.translation
                        + moved.translation * data.frame.half_side,
                };
            }
        }
        if self.cameras.all_move() {
            gauge::keep_in_place(&mut poses, &before, data.frame.centre);
        }
        self.cameras.poses = poses;
        self.place_cameras(data);
        self.cameras.forget_if_none_moves();
        let back = (!wandered.is_empty()).then(|| wandered_note(&wandered));
        Ok(back.or_else(|| looks.then(|| note(&moving, &found, wanted))))
    }

    /// Puts the cameras of `data` where they have been moved to, if they have.
    pub fn place_cameras(&mut self, data: &mut Prepared) {
        for (view, pose) in data.views.iter_mut().zip(&self.cameras.poses) {
            view.camera_from_world = *pose;
        }
        self.sampler.look_from(data);
        self.ahead.forget();
    }

    /// Whether any camera has been moved.
    #[must_use]
    pub fn has_moved_cameras(&self) -> bool {
        !self.cameras.poses.is_empty()
    }

    /// What each photo says about its camera, at the size with about `side` pixels along its longer side.
    fn alignments(&self, data: &Prepared, side: f32) -> Result<Vec<Found>, PrepareError> {
        let scene = self.freeze();
        let (seed, step, cameras) = (self.config().seed, self.step, &self.cameras);
        (0..data.views.len())
            .into_par_iter()
            .map(|number| {
                let full = &data.views[number];
                let factor = factor(full, side);
                // Nobody asks for its mask here.
                let unmasked = || TrainView {
                    mask: None,
                    ..full.clone()
                };
                let smaller = (factor > 1).then(|| unmasked().downscaled(factor));
                let smaller = smaller.transpose()?;
                let view = smaller.as_ref().unwrap_or(full);
                let reduced = Reduced {
                    view,
                    factor,
                    candidates: &data.outlines[number].candidates,
                    width: full.width(),
                };
                let seed = seed ^ (number as u64).rotate_left(40);
                let landmarks = landmarks(&scene, &data.frame, &reduced, seed, step);
                let alignment = align(view, &landmarks).unwrap_or(Alignment::NONE);
                let (now, half_side) = (&full.camera_from_world, data.frame.half_side);
                let reference = cameras.reference(number, now, half_side);
                let apart =
                    reference.and_then(|other| apart(view, &landmarks, alignment.motion, other));
                Ok(Found {
                    alignment,
                    factor,
                    apart,
                })
            })
            .collect()
    }
}

/// What one photo says about its camera.
#[derive(Clone, Copy, Debug)]
struct Found {
    /// In pixels of the size it was aligned at.
    alignment: Alignment,
    /// The photo's pixels along one of those.
    factor: u32,
    /// How far apart that puts things and what it is held against does, in pixels of the same size.
    apart: Option<f64>,
}

impl Found {
    /// The shift in the photo's own pixels.
    fn pixels(&self) -> f64 {
        self.alignment.shift * f64::from(self.factor)
    }
}

/// The photo's pixels along one of a photo with about `side`.
fn factor(view: &TrainView, side: f32) -> u32 {
    let longer = view.width().max(view.height()) as f32;
    (longer / side).round().max(1.0) as u32
}

fn note(moving: &[bool], found: &[Found], wanted: CameraRefinement) -> String {
    let count = moving.iter().filter(|moves| **moves).count();
    let mut pixels: Vec<f64> = (found.iter().zip(moving))
        .filter(|(_, moves)| **moves)
        .map(|(found, _)| found.pixels())
        .collect();
    let pixels = median(&mut pixels).unwrap_or(0.0);
    let (seem, cameras) = match (count, moving.len()) {
        (1, all) => ("seems", format!("the camera of 1 of {all} photos")),
        (count, all) if count == all => ("seem", format!("the cameras of all {all} photos")),
        (count, all) => ("seem", format!("the cameras of {count} of {all} photos")),
    };
    let why = match wanted {
        CameraRefinement::Always => "refined as asked for".to_owned(),
        _ => "refined from here on (--set prepare.refine_cameras=never leaves them as they are)"
            .to_owned(),
    };
    format!("{cameras} {seem} to be off by {pixels:.1} pixels: {why}")
}

fn wandered_note(names: &[String]) -> String {
    format!(
        "the cameras of {} wandered off when they were refined, and are back where they were",
        names.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `apart` is from what an earlier look found.
    fn found(shift: f64, apart: f64) -> Found {
        Found {
            alignment: Alignment {
                shift,
                ..Alignment::NONE
            },
            factor: 2,
            apart: Some(apart),
        }
    }

    /// Which move after two looks that find the same shifts, as far apart from each other.
    fn moving(shifts: &[f64], apart: f64, wanted: CameraRefinement) -> [Vec<bool>; 2] {
        let mut cameras = Cameras::default();
        let found: Vec<Found> = shifts.iter().map(|shift| found(*shift, apart)).collect();
        let given = vec![Pose::IDENTITY; shifts.len()];
        [0; 2].map(|_| {
            if !cameras.all_move() {
                cameras.decide(&found, &given, wanted);
            }
            cameras.moving.clone()
        })
    }

    #[test]
    fn cameras_move_where_most_are_off_or_one_is_by_far_in_both_looks() {
        use CameraRefinement::{Always, Auto, Never};
        let (right, off, far) = (0.5 * OFF, 1.5 * OFF, 5.0 * OFF);
        let all = || [vec![true; 5], vec![true; 5]];
        let none = || [Vec::<bool>::new(), Vec::new()];
        assert_eq!(moving(&[right; 5], 0.0, Auto), none());
        assert_eq!(moving(&[right, off, off, off, right], 0.0, Auto), all());
        assert_eq!(moving(&[right; 5], 0.0, Always), all());
        assert_eq!(moving(&[far; 5], 0.0, Never), none());
        let one = [right, far, off, right, right];
        let second = vec![false, true, false, false, false];
        assert_eq!(moving(&one, 0.1 * far, Auto), [vec![], second]);
        assert_eq!(moving(&one, 0.9 * far, Auto), none());
    }

    #[test]
    fn a_second_look_may_find_all_cameras_off() {
        let mut cameras = Cameras::default();
        let given = vec![Pose::IDENTITY; 3];
        let look = |shifts: [f64; 3]| shifts.map(|shift| found(shift, 0.0));
        let wanted = CameraRefinement::Auto;
        cameras.decide(&look([0.5 * OFF, 5.0 * OFF, 0.5 * OFF]), &given, wanted);
        assert!(cameras.moving.is_empty());
        cameras.decide(&look([2.0 * OFF; 3]), &given, wanted);
        assert!(cameras.all_move());
    }

    #[test]
    fn a_note_says_how_many_cameras_are_off() {
        let found = [0.1, 2.0, 0.1].map(|shift| found(shift, 0.0));
        let said = note(&[false, true, false], &found, CameraRefinement::Auto);
        let begin = "the camera of 1 of 3 photos seems to be off by 4.0 pixels: ";
        assert!(said.starts_with(begin), "{said}");
        let said = note(&[true; 3], &found, CameraRefinement::Always);
        let begin = "the cameras of all 3 photos seem to be off by 0.2 pixels: ";
        assert!(said.starts_with(begin), "{said}");
    }
}
