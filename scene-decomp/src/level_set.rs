//! Where m^P reaches a threshold: mostly told by two bits instead of eight values.

use glam::Vec3;
use rayon::prelude::*;

use crate::probability::ProbabilityMap;

/// The part of space where a map reaches a threshold.
///
/// Each cube between eight neighbouring samples has one bit for "everywhere" and one for "nowhere"; the
/// map is read only in cubes that the boundary runs through. Answers are those of
/// [`ProbabilityMap::at`], at a fraction of the memory traffic.
#[derive(Clone, Debug)]
pub struct LevelSet {
    threshold: f32,
    resolution: usize,
    everywhere: Vec<u64>,
    nowhere: Vec<u64>,
}

/// How far interpolation may round beyond the eight values.
const ROUNDING: f32 = 1e-5;

impl LevelSet {
    /// Where `map` is at least `threshold`.
    #[must_use]
    pub fn new(map: &ProbabilityMap, threshold: f32) -> Self {
        let resolution = map.resolution();
        let values = map.values();
        let last = resolution - 1;
        // The smallest and largest of a cube's corners; cubes on the far side are flat.
        let range = |cube: usize| {
            let (x, y, z) = (
                cube % resolution,
                cube / resolution % resolution,
                cube / (resolution * resolution),
            );
            let mut range = (f32::INFINITY, f32::NEG_INFINITY);
            for z in z..=(z + 1).min(last) {
                for y in y..=(y + 1).min(last) {
                    for x in x..=(x + 1).min(last) {
                        let value = values[(z * resolution + y) * resolution + x];
                        range = (range.0.min(value), range.1.max(value));
                    }
                }
            }
            range
        };
        let (everywhere, nowhere) = (0..values.len().div_ceil(64))
            .into_par_iter()
            .map(|word| {
                let mut bits = (0u64, 0u64);
                for (bit, cube) in (64 * word..values.len().min(64 * word + 64)).enumerate() {
                    let (least, most) = range(cube);
                    bits.0 |= u64::from(least >= threshold + ROUNDING) << bit;
                    bits.1 |= u64::from(most < threshold - ROUNDING) << bit;
                }
                bits
            })
            .unzip();
        Self {
            threshold,
            resolution,
            everywhere,
            nowhere,
        }
    }

    /// Whether `map`, which this was made from, reaches the threshold at `point`.
    #[inline]
    #[must_use]
    pub fn contains(&self, map: &ProbabilityMap, point: Vec3) -> bool {
        // NaN is outside too.
        if point.is_nan() || point.abs().max_element() > 1.0 {
            return self.threshold <= 0.0;
        }
        let cube = map.cube_of(point);
        let (word, bit) = (cube / 64, cube % 64);
        if self.everywhere[word] >> bit & 1 == 1 {
            return true;
        }
        if self.nowhere[word] >> bit & 1 == 1 {
            return false;
        }
        map.at(point) >= self.threshold
    }

    /// Cells per axis of the map.
    #[must_use]
    pub fn resolution(&self) -> usize {
        self.resolution
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_those_of_the_map() {
        let resolution = 19;
        let values = (0..resolution * resolution * resolution)
            .map(|cell| {
                let p = ProbabilityMap::centre(resolution, cell);
                (0.5 + (3.0 * p.x).sin() * (4.0 * p.y).cos() * 0.6 + 0.2 * p.z).clamp(0.0, 1.0)
            })
            .collect();
        let map = ProbabilityMap::new(resolution, values);
        for threshold in [0.0, 0.25, 0.4, 0.999, 1.1] {
            let set = LevelSet::new(&map, threshold);
            let mut inside = 0;
            for i in 0..40_000u32 {
                let at = |k: u32| {
                    let bits = (4 * i + k).wrapping_mul(0x9e37_79b9) >> 8;
                    1.05 * (bits as f32 / 8_388_608.0 - 1.0)
                };
                let p = Vec3::new(at(0), at(1), at(2));
                assert_eq!(set.contains(&map, p), map.at(p) >= threshold, "{p}");
                inside += u32::from(set.contains(&map, p));
            }
            assert!(threshold > 0.5 || inside > 1000, "{threshold}: {inside}");
        }
        let set = LevelSet::new(&map, 0.5);
        assert!(!set.contains(&map, Vec3::NAN));
    }
}
