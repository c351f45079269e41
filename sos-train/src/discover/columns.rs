//! A region in columns that stand on the ground.

use glam::Vec3;

use super::plane::Plane;

/// The region's columns along the normal of the ground, as wide as the voxels of a grid with so many along each axis.
pub(super) struct Columns<'a> {
    pub(super) ground: &'a Plane,
    pub(super) resolution: usize,
    pub(super) along: [Vec3; 2],
    pub(super) side: usize,
}

impl<'a> Columns<'a> {
    pub(super) fn new(ground: &'a Plane, resolution: usize) -> Self {
        let (u, v) = ground.normal.any_orthonormal_pair();
        Self {
            ground,
            resolution,
            along: [u, v],
            // As wide as the cube is from corner to corner.
            side: (3f32.sqrt() * resolution as f32).ceil() as usize + 1,
        }
    }

    /// The number of the column that holds a point of the normalised frame; `None` outside the region.
    pub(super) fn of(&self, point: Vec3) -> Option<usize> {
        if point.is_nan() || point.abs().max_element() > 1.0 {
            return None;
        }
        let at = |axis: Vec3| {
            let along = 0.5 * self.resolution as f32 * axis.dot(point);
            (along + 0.5 * self.side as f32) as usize
        };
        Some(at(self.along[1]) * self.side + at(self.along[0]))
    }
}
