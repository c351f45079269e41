//! m^P: how likely a point of space belongs to the object, from many rough masks.

use glam::Vec3;

/// Samples of m^P on a cube `[-1, 1]^3`, read with trilinear interpolation; 0 outside.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbabilityMap {
    resolution: usize,
    values: Vec<f32>,
}

impl ProbabilityMap {
    /// `values: [resolution^3]` at cell centres, x fastest.
    ///
    /// # Panics
    /// When the number of values is not the cube of the resolution.
    #[must_use]
    pub fn new(resolution: usize, values: Vec<f32>) -> Self {
        assert_eq!(
            values.len(),
            resolution.pow(3),
            "ProbabilityMap: {} values for resolution {resolution}",
            values.len()
        );
        Self { resolution, values }
    }

    /// Cells per axis.
    #[must_use]
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// The samples, x fastest.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Centre of a cell, in the order of [`ProbabilityMap::values`].
    #[must_use]
    pub fn centre(resolution: usize, cell: usize) -> Vec3 {
        let (x, y, z) = (
            cell % resolution,
            cell / resolution % resolution,
            cell / (resolution * resolution),
        );
        let at = |i: usize| (2.0 * i as f32 + 1.0) / resolution as f32 - 1.0;
        Vec3::new(at(x), at(y), at(z))
    }

    /// m^P at `point`.
    #[must_use]
    pub fn at(&self, point: Vec3) -> f32 {
        if !(point.abs().max_element() <= 1.0) {
            return 0.0;
        }
        let last = self.resolution as f32 - 1.0;
        let grid = ((point * 0.5 + 0.5) * self.resolution as f32 - 0.5)
            .clamp(Vec3::ZERO, Vec3::splat(last));
        let base = grid.floor().min(Vec3::splat((last - 1.0).max(0.0)));
        let t = grid - base;
        let (x, y, z) = (base.x as usize, base.y as usize, base.z as usize);
        let step = usize::from(self.resolution > 1);
        let value = |dx: usize, dy: usize, dz: usize| {
            let (x, y, z) = (x + dx * step, y + dy * step, z + dz * step);
            self.values[(z * self.resolution + y) * self.resolution + x]
        };
        let lerp = |a: f32, b: f32, t: f32| a + t * (b - a);
        let plane = |dz: usize| {
            lerp(
                lerp(value(0, 0, dz), value(1, 0, dz), t.x),
                lerp(value(0, 1, dz), value(1, 1, dz), t.x),
                t.y,
            )
        };
        lerp(plane(0), plane(1), t.z)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn reads_a_linear_function_back() {
        let resolution = 8;
        let values = (0..512)
            .map(|cell| ProbabilityMap::centre(resolution, cell).dot(Vec3::new(0.1, 0.2, -0.3)))
            .collect();
        let map = ProbabilityMap::new(resolution, values);
        for p in [Vec3::ZERO, Vec3::new(0.3, -0.5, 0.7), Vec3::splat(-0.8)] {
            assert!((map.at(p) - p.dot(Vec3::new(0.1, 0.2, -0.3))).abs() < 1e-6);
        }
        assert_eq!(map.at(Vec3::splat(1.1)), 0.0);
        assert_eq!(map.at(Vec3::NAN), 0.0);
    }
}
