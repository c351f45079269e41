//! From pixels to rays.
//!
//! Conventions are OpenCV's: in camera space x points right, y down, z forward, and the centre of
//! the first pixel is (0.5, 0.5). Transforms read right to left: `world_from_camera` takes camera
//! points to world points. "World" is whatever space the caller renders in, usually the normalised
//! one in which the object box is [-1, 1]^3.

use glam::{Affine3A, Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// A camera model: how directions in camera space and pixels belong together.
pub trait Projection {
    /// The camera-space direction seen by `pixel` (any length, z forward); `None` where the model
    /// has no inverse.
    fn unproject(&self, pixel: Vec2) -> Option<Vec3>;

    /// The pixel at which the camera-space point `p` is seen; `None` behind the camera.
    fn project(&self, p: Vec3) -> Option<Vec2>;
}

/// The pinhole camera: `pixel = focal * (x/z, y/z) + centre`, all in pixels.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use neus_render::rays::{Pinhole, Projection};
///
/// let camera = Pinhole { focal: Vec2::splat(100.0), centre: Vec2::new(32.0, 24.0) };
/// let pixel = camera.project(Vec3::new(0.5, 0.0, 2.0)).expect("in front of the camera");
/// assert_eq!(pixel, Vec2::new(57.0, 24.0));
/// assert_eq!(camera.unproject(pixel), Some(Vec3::new(0.25, 0.0, 1.0)));
/// assert_eq!(camera.project(Vec3::new(0.0, 0.0, -1.0)), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pinhole {
    /// Focal lengths in pixels along x and y.
    pub focal: Vec2,
    /// The principal point in pixels.
    pub centre: Vec2,
}

impl Projection for Pinhole {
    fn unproject(&self, pixel: Vec2) -> Option<Vec3> {
        Some(((pixel - self.centre) / self.focal).extend(1.0))
    }

    fn project(&self, p: Vec3) -> Option<Vec2> {
        (p.z > 0.0).then(|| self.focal * p.truncate() / p.z + self.centre)
    }
}

/// A half line with a unit direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ray {
    /// Where `t` is zero.
    pub origin: Vec3,
    /// The unit direction, so that `t` is a length in the space of the origin.
    pub direction: Vec3,
}

impl Ray {
    /// The ray from `origin` along `direction` of any length; `None` when it can't be normalised.
    pub fn new(origin: Vec3, direction: Vec3) -> Option<Self> {
        let direction = direction.try_normalize()?;
        Some(Self { origin, direction })
    }

    /// The point at distance `t`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }
}

/// The ray through `pixel` (first pixel's centre at (0.5, 0.5)) of a camera, in world space.
///
/// A scale within `world_from_camera` (normalised spaces have one) is taken out of the direction.
/// `None` where the camera model has no inverse.
///
/// ```
/// use glam::{Affine3A, Vec2, Vec3};
/// use neus_render::rays::{Pinhole, camera_ray};
///
/// let camera = Pinhole { focal: Vec2::splat(100.0), centre: Vec2::splat(50.0) };
/// let world_from_camera = Affine3A::from_translation(Vec3::new(0.0, 0.0, -3.0));
/// let ray = camera_ray(&camera, world_from_camera, Vec2::splat(50.0)).expect("a pinhole inverts");
/// assert_eq!(ray.at(3.0), Vec3::ZERO);
/// ```
pub fn camera_ray(
    projection: &impl Projection,
    world_from_camera: Affine3A,
    pixel: Vec2,
) -> Option<Ray> {
    let direction = projection.unproject(pixel)?;
    Ray::new(
        world_from_camera.translation.into(),
        world_from_camera.transform_vector3(direction),
    )
}
