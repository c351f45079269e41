//! Pinhole cameras.
//!
//! COLMAP's conventions: camera axes are x right, y down, z forward (OpenCV), pixel coordinates
//! grow right and down, and the centre of the first pixel is `(0.5, 0.5)`.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};

/// A posed pinhole camera without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal length along x, in pixels.
    pub fx: f64,
    /// Focal length along y, in pixels.
    pub fy: f64,
    /// Principal point x, in pixels.
    pub cx: f64,
    /// Principal point y, in pixels.
    pub cy: f64,
    /// Rotation part of `camera_from_world`; a unit quaternion.
    pub rotation: DQuat,
    /// Translation part of `camera_from_world`, in metres.
    pub translation: DVec3,
}

impl Camera {
    /// A camera at `eye` that looks at `aim`, its image turned by `roll` (tangent of the angle).
    pub(crate) fn looking_at(
        size: (u32, u32),
        focal: f64,
        eye: DVec3,
        aim: DVec3,
        roll: f64,
    ) -> Self {
        let forward = (aim - eye).normalize();
        let level = forward.cross(DVec3::Z).normalize();
        let right = (level + forward.cross(level) * roll).normalize();
        let down = forward.cross(right);
        // Rows of camera_from_world are the camera's axes.
        let rotation =
            DQuat::from_mat3(&DMat3::from_cols(right, down, forward).transpose()).normalize();
        Self {
            width: size.0,
            height: size.1,
            fx: focal,
            fy: focal,
            cx: 0.5 * f64::from(size.0),
            cy: 0.5 * f64::from(size.1),
            rotation,
            translation: -(rotation * eye),
        }
    }

    /// The same picture of things that have turned by `turn` (radians, about z through `axis`), as seen by a camera
    /// that has gone round them the other way.
    pub(crate) fn before_turned(&self, axis: DVec3, turn: f64) -> Self {
        let (sin, cos) = (libm::sin(0.5 * turn), libm::cos(0.5 * turn));
        let turned = DQuat::from_xyzw(0.0, 0.0, sin, cos);
        Self {
            rotation: (self.rotation * turned).normalize(),
            translation: self.rotation * (axis - turned * axis) + self.translation,
            ..*self
        }
    }

    /// The rigid transform that takes world coordinates to camera coordinates.
    #[must_use]
    pub fn camera_from_world(&self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// The camera centre in world coordinates.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.inverse() * self.translation)
    }

    /// Pixel coordinates and depth (along the optical axis, metres) of a world point, or `None`
    /// when it lies behind the camera.
    #[must_use]
    pub fn project(&self, world: DVec3) -> Option<(DVec2, f64)> {
        let p = self.rotation * world + self.translation;
        (p.z > 1e-6).then(|| {
            (
                DVec2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy),
                p.z,
            )
        })
    }

    /// Unit direction, in world coordinates, of the ray through a pixel position.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        let p = DVec3::new(
            (pixel.x - self.cx) / self.fx,
            (pixel.y - self.cy) / self.fy,
            1.0,
        );
        (self.rotation.inverse() * p).normalize()
    }

    /// Whether a pixel position lies on the image.
    #[must_use]
    pub fn contains(&self, pixel: DVec2) -> bool {
        pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < f64::from(self.width)
            && pixel.y < f64::from(self.height)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_goes_round_what_stands_still_as_that_turns_before_it() {
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let camera = Camera::looking_at((320, 240), 300.0, eye, DVec3::new(0.2, 0.1, 0.9), 0.03);
        let (axis, turn) = (DVec3::new(0.3, 0.2, 0.5), 0.7_f64);
        let p = DVec3::new(0.25, 0.0, 0.8);
        let turned = axis + DQuat::from_rotation_z(turn) * (p - axis);
        let (there, depth) = camera.project(turned).unwrap();
        let (here, same) = camera.before_turned(axis, turn).project(p).unwrap();
        assert!((there - here).length() < 1e-9 && (depth - same).abs() < 1e-12);
    }

    #[test]
    fn projection_inverts_rays() {
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let camera = Camera::looking_at((320, 240), 300.0, eye, DVec3::new(0.2, 0.1, 0.9), 0.03);
        assert!((camera.centre() - eye).length() < 1e-12);
        let pixel = DVec2::new(17.25, 201.5);
        let (back, depth) = camera.project(eye + camera.ray(pixel) * 2.0).unwrap();
        assert!((back - pixel).length() < 1e-9 && depth > 1.0);
        // The world's up is the image's up: higher points have smaller y.
        let aim = DVec3::new(0.2, 0.1, 0.9);
        assert!(camera.project(aim + DVec3::Z * 0.1).unwrap().0.y < 120.0);
        assert!((camera.project(aim).unwrap().0 - DVec2::new(160.0, 120.0)).length() < 1e-9);
    }
}
