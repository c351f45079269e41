//! The one similarity between the scene's frame and the normalised one.

use glam::{Affine3A, DVec3, Mat3A, Vec3, Vec3A};
use io_colmap::Pose;
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

    /// A camera's pose in the normalised frame: the same axes, its centre where it is there.
    #[must_use]
    pub fn world_from_camera(&self, camera_from_world: &Pose) -> Affine3A {
        let rotation = camera_from_world.inverse().rotation;
        Affine3A {
            matrix3: Mat3A::from_quat(rotation.as_quat()),
            translation: Vec3A::from(self.normalised_from_world(camera_from_world.centre())),
        }
    }

    /// Back into the scene's frame.
    #[must_use]
    pub fn world_from_normalised(&self, normalised: Vec3) -> DVec3 {
        self.centre + normalised.as_dvec3() * self.half_side
    }
}
