//! Where a ray enters and leaves a box or a sphere.
//!
//! Both answers are the whole line's [`Span`]: `near` is negative when the origin lies inside or
//! beyond the shape. Intersect with the allowed range by [`Span::clip`].

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::rays::Ray;

/// A range of distances along a ray, `near <= far`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Span {
    /// Where it begins.
    pub near: f32,
    /// Where it ends.
    pub far: f32,
}

impl Span {
    /// The part of this span within `[near, far]`; `None` when that is empty or a single point.
    pub fn clip(self, near: f32, far: f32) -> Option<Self> {
        let (near, far) = (self.near.max(near), self.far.min(far));
        (near < far).then_some(Self { near, far })
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: Vec3,
    /// The corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The object box of normalised space, [-1, 1]^3.
    pub const UNIT: Self = Self::cube(1.0);

    /// The cube [-half, half]^3.
    pub const fn cube(half: f32) -> Self {
        Self {
            min: Vec3::splat(-half),
            max: Vec3::splat(half),
        }
    }

    /// Whether `p` lies within, borders included.
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    /// The lengths of the edges.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }
}

/// Where the line of `ray` passes through `aabb`; `None` when it misses.
///
/// An axis along which the ray doesn't move decides by itself: inside its slab it sets no limit,
/// outside it the ray misses. That avoids the `0 * inf` of the usual slab test.
///
/// ```
/// use glam::Vec3;
/// use neus_render::{intersect::{Aabb, Span, ray_box}, rays::Ray};
///
/// let ray = Ray { origin: Vec3::new(1.0, 0.0, -3.0), direction: Vec3::Z }; // along a face
/// assert_eq!(ray_box(&ray, &Aabb::UNIT), Some(Span { near: 2.0, far: 4.0 }));
/// ```
pub fn ray_box(ray: &Ray, aabb: &Aabb) -> Option<Span> {
    let mut span = Span {
        near: f32::NEG_INFINITY,
        far: f32::INFINITY,
    };
    for axis in 0..3 {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        let (min, max) = (aabb.min[axis], aabb.max[axis]);
        if direction == 0.0 {
            if origin < min || origin > max {
                return None;
            }
            continue;
        }
        let (a, b) = ((min - origin) / direction, (max - origin) / direction);
        span.near = span.near.max(a.min(b));
        span.far = span.far.min(a.max(b));
    }
    (span.near <= span.far).then_some(span)
}

/// Where the line of `ray` passes through the sphere; `None` when it misses.
///
/// The discriminant is formed from the distance of the line to the centre, which keeps its digits
/// for cameras far away.
///
/// ```
/// use glam::Vec3;
/// use neus_render::{intersect::{Span, ray_sphere}, rays::Ray};
///
/// let ray = Ray { origin: Vec3::new(0.0, 0.0, -3.0), direction: Vec3::Z };
/// assert_eq!(ray_sphere(&ray, Vec3::ZERO, 0.5), Some(Span { near: 2.5, far: 3.5 }));
/// ```
pub fn ray_sphere(ray: &Ray, centre: Vec3, radius: f32) -> Option<Span> {
    let to_centre = centre - ray.origin;
    let middle = to_centre.dot(ray.direction);
    let off_axis = to_centre - middle * ray.direction;
    let half_squared = radius * radius - off_axis.length_squared();
    (half_squared >= 0.0).then(|| {
        let half = half_squared.sqrt();
        Span {
            near: middle - half,
            far: middle + half,
        }
    })
}
