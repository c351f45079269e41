//! Single cameras that are off among others that are right.
//!
//! A photo may disagree with the fields for reasons of its own: a highlight, a shadow, little to go by. A camera that follows
//! these takes what the fields learn from its photo along, so that the error feeds itself. So two looks have to agree
//! before such a camera moves, and it goes back for good when it wanders.

use io_colmap::Pose;
use serde::{Deserialize, Serialize};

use super::Found;
use super::alignment::Motion;

/// A camera among others that are right is off from this shift on, in coarse pixels.
const OFF: f64 = 0.75;
/// Two looks agree where what they find differs by less than this share of it.
const AGREEMENT: f64 = 0.5;
/// How many times as far as was first found a camera may go.
const FARTHEST: f64 = 1.5;

/// A camera that a look found to be off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Suspect {
    /// What would put it right, as that look has it.
    motion: Motion,
    /// By how many of the photo's pixels.
    shift: f64,
    /// Where it is said to be.
    given: Pose,
}

impl Suspect {
    /// What a first look makes of a camera.
    pub(super) fn of(found: &Found, given: Pose) -> Option<Self> {
        (found.alignment.shift > OFF).then(|| Self {
            motion: found.alignment.motion,
            shift: found.pixels(),
            given,
        })
    }

    /// Whether a second look says the same as the first.
    pub(super) fn is_off(&self, found: &Found) -> bool {
        let shift = found.alignment.shift;
        shift > OFF && found.apart.is_some_and(|apart| apart < AGREEMENT * shift)
    }

    /// Where the camera goes back to if what was found last would lead it astray.
    pub(super) fn back(&self, found: &Found) -> Option<Pose> {
        let away = found.apart.unwrap_or(0.0) * f64::from(found.factor);
        (away > FARTHEST * self.shift).then_some(self.given)
    }

    /// What a new look is held against: while the camera is where it is said to be, what the first one found; later the
    /// motion back from where it is `now`. Lengths are in units of `half_side`.
    pub(super) fn reference(&self, moves: bool, now: &Pose, half_side: f64) -> Motion {
        if !moves {
            return self.motion;
        }
        let rotation = self.given.rotation * now.rotation.inverse();
        Motion {
            rotation,
            translation: (self.given.translation - rotation * now.translation) / half_side,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::train::cameras::alignment::Alignment;
    use glam::{DQuat, DVec3};

    fn found(shift: f64, apart: Option<f64>) -> Found {
        Found {
            alignment: Alignment {
                shift,
                ..Alignment::NONE
            },
            factor: 2,
            apart,
        }
    }

    #[test]
    fn two_looks_have_to_agree() {
        assert_eq!(Suspect::of(&found(0.9 * OFF, None), Pose::IDENTITY), None);
        let suspect = Suspect::of(&found(2.0 * OFF, None), Pose::IDENTITY).unwrap();
        assert!(suspect.is_off(&found(2.0 * OFF, Some(0.9 * OFF))));
        assert!(!suspect.is_off(&found(2.0 * OFF, Some(1.1 * OFF))));
        assert!(!suspect.is_off(&found(0.9 * OFF, Some(0.1 * OFF))));
        assert!(!suspect.is_off(&found(2.0 * OFF, None)));
    }

    #[test]
    fn a_camera_that_wanders_goes_back() {
        let given = Pose {
            rotation: DQuat::from_rotation_y(0.3),
            translation: DVec3::new(1.0, 2.0, 3.0),
        };
        let suspect = Suspect::of(&found(2.0, None), given).unwrap();
        assert_eq!(suspect.back(&found(0.5, Some(1.4 * 2.0))), None);
        assert_eq!(suspect.back(&found(0.5, Some(1.6 * 2.0))), Some(given));
    }

    #[test]
    fn the_way_back_leads_to_where_a_camera_was_said_to_be() {
        let given = Pose {
            rotation: DQuat::from_rotation_y(0.3),
            translation: DVec3::new(1.0, 2.0, 3.0),
        };
        let now = Pose {
            rotation: DQuat::from_rotation_x(0.1) * given.rotation,
            translation: given.translation + DVec3::new(0.1, 0.0, -0.2),
        };
        let suspect = Suspect::of(&found(2.0, None), given).unwrap();
        assert_eq!(suspect.reference(false, &now, 2.0), Motion::NONE);
        let back = suspect.reference(true, &now, 2.0);
        let place = DVec3::new(0.4, -0.7, 5.0);
        let there = 2.0 * back.of(now.transform_point(place) / 2.0);
        assert!(there.distance(given.transform_point(place)) < 1e-9);
    }
}
