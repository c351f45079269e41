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
    /// Of 64 cubes each: which are everywhere and which nowhere, beside each other as both are asked.
    sides: Vec<[u64; 2]>,
}

/// How far interpolation may round beyond the eight values.
const ROUNDING: f32 = 1e-5;
/// Rows and words that one task takes at least.
const ROWS: usize = 256;
/// The bits of a cube while both lists are made.
const EVERYWHERE: u8 = 1;
const NOWHERE: u8 = 2;

impl LevelSet {
    /// Where `map` is at least `threshold`.
    #[must_use]
    pub fn new(map: &ProbabilityMap, threshold: f32) -> Self {
        let resolution = map.resolution();
        // Of each cube, whether all of its corners are sure to reach the threshold, and whether none does.
        let mut sides = vec![0u8; map.values().len()];
        sides
            .par_chunks_mut(resolution)
            .enumerate()
            .with_min_len(ROWS)
            .for_each_init(
                || (vec![0.0; resolution], vec![0.0; resolution]),
                |(least, most), (row, sides)| {
                    ranges(map, row, least, most);
                    for ((side, least), most) in sides.iter_mut().zip(least).zip(most) {
                        let everywhere = u8::from(*least >= threshold + ROUNDING) * EVERYWHERE;
                        let nowhere = u8::from(*most < threshold - ROUNDING) * NOWHERE;
                        *side = everywhere | nowhere;
                    }
                },
            );
        let sides = sides
            .par_chunks(64)
            .with_min_len(ROWS)
            .map(|sides| {
                [EVERYWHERE, NOWHERE].map(|of| {
                    let bits = sides.iter().enumerate();
                    bits.fold(0, |word, (bit, side)| {
                        word | u64::from(side & of != 0) << bit
                    })
                })
            })
            .collect();
        Self {
            threshold,
            resolution,
            sides,
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
        let ([everywhere, nowhere], bit) = (self.sides[cube / 64], cube % 64);
        if everywhere >> bit & 1 == 1 {
            return true;
        }
        if nowhere >> bit & 1 == 1 {
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

/// The smallest and largest of each cube's corners, of the cubes along x whose number is `row`; those on the far side
/// are flat.
fn ranges(map: &ProbabilityMap, row: usize, least: &mut [f32], most: &mut [f32]) {
    let n = map.resolution();
    let (y, z) = (row % n, row / n);
    let (next_y, next_z) = ((y + 1).min(n - 1), (z + 1).min(n - 1));
    let values = |y: usize, z: usize| &map.values()[(z * n + y) * n..][..n];
    least.copy_from_slice(values(y, z));
    most.copy_from_slice(values(y, z));
    for row in [values(next_y, z), values(y, next_z), values(next_y, next_z)] {
        for ((least, most), value) in least.iter_mut().zip(most.iter_mut()).zip(row) {
            *least = least.min(*value);
            *most = most.max(*value);
        }
    }
    for x in 1..n {
        least[x - 1] = least[x - 1].min(least[x]);
        most[x - 1] = most[x - 1].max(most[x]);
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
