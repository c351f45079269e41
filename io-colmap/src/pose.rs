//! Rigid transforms between world and camera space.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A rotation followed by a translation: `p_to = rotation * p_from + translation`.
///
/// Named after the direction it maps: `camera_from_world` takes world points into the camera,
/// where +x is right, +y is down and +z is forward (COLMAP, OpenCV).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// In the units of the space mapped to (COLMAP's scale is arbitrary).
    pub translation: DVec3,
}

impl Pose {
    /// The pose that changes nothing.
    pub const IDENTITY: Pose = Pose {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// The transform in the other direction.
    #[must_use]
    pub fn inverse(&self) -> Pose {
        let rotation = self.rotation.conjugate();
        Pose {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// Maps a point.
    #[must_use]
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Maps a direction: rotated, not moved.
    #[must_use]
    pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// Of a `camera_from_world` pose: the camera's centre in world space.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        self.inverse().translation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes_and_centre_maps_to_zero() {
        let pose = Pose {
            rotation: DQuat::from_xyzw(0.1, -0.4, 0.2, 0.8).normalize(),
            translation: DVec3::new(1.0, -2.0, 3.0),
        };
        let p = DVec3::new(0.3, 0.7, -5.0);
        assert!((pose.inverse().transform_point(pose.transform_point(p)) - p).length() < 1e-12);
        assert!(pose.transform_point(pose.centre()).length() < 1e-12);
    }
}
