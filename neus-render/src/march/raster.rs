//! Which steps across the box lie in occupied cells, sixteen at a time.
//!
//! Every step's midpoint is looked up, occupied or not. Leaping over empty space from cell to cell
//! takes fewer look-ups, but each of them waits for the one before and for branches that cannot be
//! foreseen; these are independent of each other.

use pulp::{Arch, Simd, WithSimd};

use crate::{occupancy::OccupancyGrid, rays::Ray};

/// Steps looked up together.
const LANES: usize = 16;
/// Steps in a word of flags.
const WORD: usize = 64;

/// Steps of equal length from `begin` to `end`; the first and the last are what is left of one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Raster {
    pub(super) begin: f32,
    pub(super) end: f32,
    /// Where the first step ends.
    pub(super) first: f32,
    pub(super) step: f32,
}

impl Raster {
    /// Where step `k - 1` ends and step `k` begins, counting from 0.
    #[inline(always)]
    pub(super) fn line(&self, k: usize) -> f32 {
        if k == 0 {
            self.begin
        } else {
            (self.first + (k - 1) as f32 * self.step).min(self.end)
        }
    }

    /// Number of steps.
    fn count(&self) -> usize {
        // One more than rounding could ask for: steps without a length are never occupied.
        let rest = ((self.end - self.first) / self.step).max(0.0);
        rest as usize + 3
    }
}

/// A flag for each step: whether its midpoint lies in an occupied cell.
#[derive(Clone, Debug, Default)]
pub(super) struct Flags {
    words: Vec<u64>,
}

impl Flags {
    /// Looks up all steps of `raster` along `ray`, clamped to the box as rounding may demand.
    pub(super) fn look_up(&mut self, grid: &OccupancyGrid, ray: &Ray, raster: &Raster) {
        let count = raster.count();
        self.words.clear();
        self.words.resize(count.div_ceil(WORD), 0);
        Arch::new().dispatch(LookUp {
            grid,
            ray,
            raster,
            words: &mut self.words,
        });
    }

    /// No step is occupied.
    pub(super) fn clear(&mut self) {
        self.words.clear();
    }

    pub(super) fn get(&self, k: usize) -> bool {
        self.words
            .get(k / WORD)
            .is_some_and(|word| word >> (k % WORD) & 1 == 1)
    }

    /// The first step from `k` on that is occupied here or in `other`.
    pub(super) fn next_of_either(&self, other: &Self, k: usize) -> Option<usize> {
        let at = |flags: &Self, w: usize| flags.words.get(w).copied().unwrap_or(0);
        let words = self.words.len().max(other.words.len());
        let mut keep = u64::MAX << (k % WORD);
        for w in k / WORD..words {
            let word = (at(self, w) | at(other, w)) & keep;
            if word != 0 {
                return Some(w * WORD + word.trailing_zeros() as usize);
            }
            keep = u64::MAX;
        }
        None
    }
}

/// [`Flags::look_up`]'s arguments, as pulp wants a function with generic body to be written.
struct LookUp<'a> {
    grid: &'a OccupancyGrid,
    ray: &'a Ray,
    raster: &'a Raster,
    words: &'a mut [u64],
}

impl WithSimd for LookUp<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Raster {
            begin,
            end,
            first,
            step,
        } = *self.raster;
        let lookup = self.grid.lookup();
        let (origin, direction) = (self.ray.origin.to_array(), self.ray.direction.to_array());
        for (w, word) in self.words.iter_mut().enumerate() {
            for part in 0..WORD / LANES {
                let k = (w * WORD + part * LANES) as f32;
                let mut middle = [0.0f32; LANES];
                let mut length = [0.0f32; LANES];
                for i in 0..LANES {
                    let to = (first + (k + i as f32) * step).min(end);
                    let from = (first + (k + i as f32 - 1.0) * step).min(end);
                    let from = if k + i as f32 > 0.0 { from } else { begin };
                    middle[i] = 0.5 * (from + to);
                    length[i] = to - from;
                }
                let mut cell = [0i32; LANES];
                let mut inside = [true; LANES];
                for axis in (0..3).rev() {
                    for i in 0..LANES {
                        let p = origin[axis] + middle[i] * direction[axis];
                        let p = p.clamp(-1.0, 1.0);
                        inside[i] &= p.abs() <= lookup.half;
                        let q = (p + lookup.half) * lookup.scale;
                        let q = if q > 0.0 { q } else { 0.0 };
                        let q = if q < lookup.last { q } else { lookup.last };
                        // SAFETY: q is in [0, 1023], not a number included.
                        let q: i32 = unsafe { q.to_int_unchecked() };
                        cell[i] = cell[i] * lookup.resolution + q;
                    }
                }
                let mut flags = 0u64;
                for i in 0..LANES {
                    // SAFETY: all coordinates are below the resolution.
                    let occupied = unsafe { lookup.is_occupied_unchecked(cell[i] as usize) };
                    flags |= u64::from(occupied & inside[i] & (length[i] > 0.0)) << i;
                }
                *word |= flags << (part * LANES);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::random::unit_float;

    #[test]
    fn flags_are_those_of_single_look_ups() {
        for (resolution, half) in [(128, 1.0), (37, 2.0), (16, 0.7)] {
            let mut grid = OccupancyGrid::new(resolution, half);
            let cells: Vec<u32> = (0..grid.cell_count() as u32)
                .filter(|&cell| unit_float(5, u64::from(cell)) < 0.3)
                .collect();
            grid.update(&cells, &vec![1.0; cells.len()]);
            grid.rebuild_bits(0.5);
            let mut flags = Flags::default();
            for number in 0..200 {
                let at = |k| 2.0 * unit_float(6, 8 * number + k) - 1.0;
                let from = Vec3::new(at(0), at(1), -1.0);
                let ray = Ray::new(from, Vec3::new(at(2), at(3), 1.0) - from).expect("a length");
                let raster = Raster {
                    begin: 0.0,
                    end: 2.0 + at(4).abs(),
                    first: 0.011 * unit_float(6, 8 * number + 5),
                    step: 0.011,
                };
                flags.look_up(&grid, &ray, &raster);
                let mut k = 0;
                while raster.line(k) < raster.end {
                    let (from, to) = (raster.line(k), raster.line(k + 1));
                    let p = ray.at(0.5 * (from + to)).clamp(Vec3::NEG_ONE, Vec3::ONE);
                    assert_eq!(flags.get(k), to > from && grid.occupied(p), "step {k}");
                    k += 1;
                }
                assert_eq!(flags.next_of_either(&Flags::default(), k), None);
                let found = flags.next_of_either(&Flags::default(), 0);
                assert_eq!(found, (0..k).find(|&k| flags.get(k)));
            }
        }
    }
}
