//! What tracing and meshing ask of a field.

use glam::Vec3;

/// A signed distance field that is evaluated for many points at once; negative inside.
///
/// ```
/// use glam::Vec3;
/// use neus_render::field::{FnSdf, SdfBatch};
///
/// let sphere = FnSdf(|p: Vec3| p.length() - 0.5);
/// let mut out = [0.0; 2];
/// sphere.sdf(&[Vec3::ZERO, Vec3::X], &mut out);
/// assert_eq!(out, [-0.5, 0.5]);
/// ```
pub trait SdfBatch {
    /// Writes the signed distances at `points` to `out`, both `[n]`.
    fn sdf(&self, points: &[Vec3], out: &mut [f32]);
}

/// A closed form as a field.
#[derive(Clone, Copy, Debug)]
pub struct FnSdf<F>(pub F);

impl<F: Fn(Vec3) -> f32> SdfBatch for FnSdf<F> {
    fn sdf(&self, points: &[Vec3], out: &mut [f32]) {
        for (value, &p) in out.iter_mut().zip(points) {
            *value = (self.0)(p);
        }
    }
}
