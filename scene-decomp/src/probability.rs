//! m^P: how likely a point of space belongs to the object, from many rough masks.

use glam::{IVec3, Vec3};

/// Samples of m^P on a cube `[-1, 1]^3`, read with trilinear interpolation; 0 outside.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbabilityMap {
    resolution: usize,
    values: Vec<f32>,
    /// The largest value in and around each block of [`BLOCK`] voxels along an axis.
    block_maxima: Vec<f32>,
}

/// Voxels along the edge of a block.
const BLOCK: usize = 8;

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
        let block_maxima = block_maxima(resolution, &values);
        Self {
            resolution,
            values,
            block_maxima,
        }
    }

    /// The largest sample of m^P on the segment of unit `direction` from `origin`, between
    /// distances `near` and `far`, looked up once a voxel. Stops early at `enough`. The segment is to lie in the cube: beyond
    /// it values are those of the border's voxels.
    ///
    /// # Panics
    /// When `far` is no finite number.
    #[must_use]
    pub fn max_along(
        &self,
        origin: Vec3,
        direction: Vec3,
        (near, far): (f32, f32),
        enough: f32,
    ) -> f32 {
        assert!(far.is_finite(), "max_along: a segment to {far}");
        let step = 2.0 / self.resolution as f32;
        let n = self.resolution;
        let voxel = |v: f32| {
            let at = ((v * 0.5 + 0.5) * n as f32).max(0.0) as usize;
            at.min(n - 1)
        };
        let blocks = n.div_ceil(BLOCK);
        let (mut t, mut best) = (near.max(0.0) + 0.25 * step, 0.0f32);
        while t < far && best < enough {
            let p = origin + t * direction;
            let (x, y, z) = (voxel(p.x), voxel(p.y), voxel(p.z));
            let block = ((z / BLOCK) * blocks + y / BLOCK) * blocks + x / BLOCK;
            // A block's maximum covers its neighbours too: nothing larger within a block's edge.
            if self.block_maxima[block] <= best {
                t += BLOCK as f32 * step;
                continue;
            }
            best = best.max(self.values[(z * n + y) * n + x]);
            t += step;
        }
        best
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
        // NaN is outside too.
        if point.is_nan() || point.abs().max_element() > 1.0 {
            return 0.0;
        }
        let ([x, y, z], t) = self.locate(point);
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

    /// The cube of eight samples that `point` lies between, by the number of its first corner.
    #[inline]
    pub(crate) fn cube_of(&self, point: Vec3) -> usize {
        let [x, y, z] = self.locate(point).0;
        (z * self.resolution + y) * self.resolution + x
    }

    /// The first corner of the cube that a point of `[-1, 1]^3` lies in, and where in it.
    #[inline]
    fn locate(&self, point: Vec3) -> ([usize; 3], Vec3) {
        let last = self.resolution as f32 - 1.0;
        let grid = ((point * 0.5 + 0.5) * self.resolution as f32 - 0.5)
            .clamp(Vec3::ZERO, Vec3::splat(last));
        // Truncation, as nothing is negative here: `floor` is a call where SSE4.1 is not certain.
        let below = grid.as_ivec3().min(IVec3::splat((last as i32 - 1).max(0)));
        (
            below.to_array().map(|cell| cell as usize),
            grid - below.as_vec3(),
        )
    }
}

/// For each block the largest value within it and the blocks around it.
fn block_maxima(resolution: usize, values: &[f32]) -> Vec<f32> {
    let blocks = resolution.div_ceil(BLOCK);
    let mut own = vec![0.0f32; blocks.pow(3)];
    for (i, row) in values.chunks(resolution.max(1)).enumerate() {
        let (y, z) = (i % resolution, i / resolution);
        let slots = &mut own[((z / BLOCK) * blocks + y / BLOCK) * blocks..][..blocks];
        for (slot, values) in slots.iter_mut().zip(row.chunks(BLOCK)) {
            *slot = values.iter().copied().fold(*slot, f32::max);
        }
    }
    let around = |v: usize| v.saturating_sub(1)..(v + 2).min(blocks);
    (0..blocks.pow(3))
        .map(|i| {
            let (x, y, z) = (i % blocks, i / blocks % blocks, i / (blocks * blocks));
            let mut largest = 0.0f32;
            for z in around(z) {
                for y in around(y) {
                    for x in around(x) {
                        largest = largest.max(own[(z * blocks + y) * blocks + x]);
                    }
                }
            }
            largest
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn the_largest_value_on_a_segment() {
        let resolution = 32;
        let values: Vec<f32> = (0..resolution * resolution * resolution)
            .map(|cell| {
                let d = ProbabilityMap::centre(resolution, cell).distance(Vec3::splat(0.3));
                (1.0 - 3.0 * d).max(0.0)
            })
            .collect();
        let map = ProbabilityMap::new(resolution, values);
        for k in 0..50 {
            let origin = Vec3::new(-3.0, 0.05 * k as f32 - 1.2, 0.2);
            let direction = Vec3::new(1.0, 0.1, 0.05).normalize();
            let plain = (0..4000)
                .map(|i| map.at(origin + direction * i as f32 * 1e-3 * 1.5))
                .fold(0.0, f32::max);
            let found = map.max_along(origin, direction, (0.0, 6.0), 1.0);
            // A voxel between look-ups of whole voxels, at a slope of 3 per unit.
            assert!((found - plain).abs() < 0.2, "{found} {plain}");
        }
    }

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
