//! The one similarity between the scene's frame and the normalised one.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// The object's box in the scene's frame; normalised, it is `[-1, 1]^3`.
///
/// Axes are the scene's own: `world = centre + half_side * normalised`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// The box's centre, in the scene's unit.
    pub centre: DVec3,
    /// Half the box's side, in the scene's unit.
    pub half_side: f64,
}

impl Frame {
    /// Into `[-1, 1]^3`.
    #[must_use]
    pub fn normalised_from_world(&self, world: DVec3) -> Vec3 {
        ((world - self.centre) / self.half_side).as_vec3()
    }

    /// Back into the scene's frame.
    #[must_use]
    pub fn world_from_normalised(&self, normalised: Vec3) -> DVec3 {
        self.centre + normalised.as_dvec3() * self.half_side
    }
}
