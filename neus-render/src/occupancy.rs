//! Which parts of space may hold something: a grid of cells with a bit each.
//!
//! Cells are numbered `x + r * (y + r * z)` for resolution `r`, over the cube [-half, half]^3: half
//! 1 for the object, half 2 for a background in contracted space. A cell has a value (an opacity,
//! as the caller defines it) that fades unless it is renewed, and a bit that marching reads.
//!
//! ```
//! use glam::Vec3;
//! use neus_render::occupancy::OccupancyGrid;
//!
//! let mut grid = OccupancyGrid::new(16, 1.0);
//! let cell = grid.cell_of(Vec3::new(0.1, 0.2, 0.3)).expect("inside the cube");
//! grid.update(&[cell], &[0.5]);
//! grid.rebuild_bits(0.01);
//! assert!(grid.occupied(grid.centre_of(cell)));
//! assert!(!grid.occupied(Vec3::splat(-0.9)));
//! ```

#[cfg(feature = "cube")]
mod cube;
#[cfg(feature = "cube")]
mod device;

use glam::Vec3;
use rayon::prelude::*;

use crate::random::unit_float;
#[cfg(feature = "cube")]
pub use device::{DeviceBits, DeviceOccupancy};

/// Why stored values can't be a grid's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OccupancyError {
    /// The number of values isn't the number of cells.
    #[error("occupancy grid of resolution {resolution} needs {expected} values, got {found}")]
    ValueCount {
        /// Cells per axis.
        resolution: u32,
        /// `resolution^3`.
        expected: usize,
        /// How many values came.
        found: usize,
    },
}

/// Occupancy of the cube [-half, half]^3 in `resolution^3` cells; see the [module](self).
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    resolution: u32,
    half: f32,
    decay: f32,
    values: Vec<f32>,
    bits: Vec<u64>,
    /// Cells that stay occupied whatever their value.
    protected: Option<Vec<u64>>,
}

impl OccupancyGrid {
    /// How much of its value a cell keeps at an update, unless told otherwise.
    pub const DEFAULT_DECAY: f32 = 0.95;

    /// A grid of `resolution^3` cells over [-half, half]^3, all values zero and nothing occupied.
    ///
    /// # Panics
    /// When `resolution` is 0 or above 1024, or `half` isn't positive.
    pub fn new(resolution: u32, half: f32) -> Self {
        assert!(
            (1..=1024).contains(&resolution),
            "OccupancyGrid::new: resolution {resolution} is not in 1..=1024"
        );
        assert!(
            half > 0.0 && half.is_finite(),
            "OccupancyGrid::new: half {half} is not a positive length"
        );
        let cells = (resolution as usize).pow(3);
        Self {
            resolution,
            half,
            decay: Self::DEFAULT_DECAY,
            values: vec![0.0; cells],
            bits: vec![0; cells.div_ceil(64)],
            protected: None,
        }
    }

    /// The same grid with another decay (see [`update`](Self::update)).
    pub fn with_decay(mut self, decay: f32) -> Self {
        self.decay = decay;
        self
    }

    /// A grid from what [`values`](Self::values) gave; call
    /// [`rebuild_bits`](Self::rebuild_bits) before marching.
    ///
    /// # Errors
    /// [`OccupancyError::ValueCount`] unless there are `resolution^3` values.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn from_values(
        resolution: u32,
        half: f32,
        values: Vec<f32>,
    ) -> Result<Self, OccupancyError> {
        let mut grid = Self::new(resolution, half);
        if values.len() != grid.values.len() {
            return Err(OccupancyError::ValueCount {
                resolution,
                expected: grid.values.len(),
                found: values.len(),
            });
        }
        grid.values = values;
        Ok(grid)
    }

    /// Cells per axis.
    pub fn resolution(&self) -> u32 {
        self.resolution
    }

    /// Half the edge of the cube.
    pub fn half(&self) -> f32 {
        self.half
    }

    /// How many cells there are, `resolution^3`.
    pub fn cell_count(&self) -> usize {
        self.values.len()
    }

    /// Edge length of a cell.
    pub fn cell_size(&self) -> f32 {
        2.0 * self.half / self.resolution as f32
    }

    /// All values, [resolution^3], to be stored in a checkpoint.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The mean of all values, a common upper bound of the threshold.
    pub fn mean(&self) -> f32 {
        let sum: f64 = self.values.iter().map(|&v| f64::from(v)).sum();
        (sum / self.values.len() as f64) as f32
    }

    /// Renews cells: `value = max(value * decay, new)`. Cells that are not named keep theirs.
    ///
    /// A new value that is not a number counts as no news.
    ///
    /// # Panics
    /// When the lengths differ or a cell doesn't exist.
    pub fn update(&mut self, cells: &[u32], values: &[f32]) {
        assert_eq!(
            cells.len(),
            values.len(),
            "OccupancyGrid::update: {} cells but {} values",
            cells.len(),
            values.len()
        );
        for (&cell, &new) in cells.iter().zip(values) {
            let value = &mut self.values[cell as usize];
            *value = (*value * self.decay).max(new);
        }
    }

    /// Sets every value, and with it (for a value above zero) every cell occupied.
    pub fn set_all(&mut self, value: f32) {
        self.values.fill(value);
        self.rebuild_bits(0.0);
    }

    /// Marks cells that [`rebuild_bits`](Self::rebuild_bits) never empties; adds to earlier ones.
    /// They are occupied at once.
    ///
    /// # Panics
    /// When a cell doesn't exist.
    pub fn protect(&mut self, cells: impl IntoIterator<Item = u32>) {
        let count = self.values.len();
        let words = self.bits.len();
        let protected = self.protected.get_or_insert_with(|| vec![0; words]);
        for cell in cells {
            let cell = cell as usize;
            assert!(cell < count, "OccupancyGrid::protect: no cell {cell}");
            protected[cell / 64] |= 1 << (cell % 64);
        }
        for (word, &keep) in self.bits.iter_mut().zip(protected.iter()) {
            *word |= keep;
        }
    }

    /// Ends all protection; bits change at the next [`rebuild_bits`](Self::rebuild_bits).
    pub fn unprotect(&mut self) {
        self.protected = None;
    }

    /// Occupied from now on: cells whose value exceeds `threshold`, and protected ones.
    pub fn rebuild_bits(&mut self, threshold: f32) {
        self.bits
            .par_iter_mut()
            .zip(self.values.par_chunks(64))
            .with_min_len(256)
            .for_each(|(word, values)| {
                *word = values
                    .iter()
                    .enumerate()
                    .fold(0, |word, (i, &v)| word | (u64::from(v > threshold) << i));
            });
        if let Some(protected) = &self.protected {
            for (word, &keep) in self.bits.iter_mut().zip(protected) {
                *word |= keep;
            }
        }
    }

    /// How many cells are occupied.
    pub fn occupied_count(&self) -> usize {
        self.bits.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// The numbers of all occupied cells, ascending.
    pub fn occupied_cells(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.values.len() as u32).filter(|&cell| self.cell_occupied(cell))
    }

    /// Whether cell `cell` is occupied.
    #[inline]
    pub fn cell_occupied(&self, cell: u32) -> bool {
        (self.bits[cell as usize / 64] >> (cell % 64)) & 1 == 1
    }

    /// Whether the cell that `p` lies in is occupied; false outside the cube.
    #[inline]
    pub fn occupied(&self, p: Vec3) -> bool {
        self.cell_of(p).is_some_and(|cell| self.cell_occupied(cell))
    }

    /// The cell that `p` lies in, its upper border included; `None` outside the cube.
    #[inline]
    pub fn cell_of(&self, p: Vec3) -> Option<u32> {
        // Not-a-number coordinates fail the comparison, too.
        if !p.abs().cmple(Vec3::splat(self.half)).all() {
            return None;
        }
        let [x, y, z] = self.floor(p);
        Some(x + self.resolution * (y + self.resolution * z))
    }

    #[inline]
    fn floor(&self, p: Vec3) -> [u32; 3] {
        let scale = self.resolution as f32 / (2.0 * self.half);
        let last = self.resolution - 1;
        let q = (p + self.half) * scale;
        [q.x, q.y, q.z].map(|v| (v as u32).min(last))
    }

    fn coordinates(&self, cell: u32) -> [u32; 3] {
        let r = self.resolution;
        [cell % r, (cell / r) % r, cell / (r * r)]
    }

    /// The centre of a cell.
    pub fn centre_of(&self, cell: u32) -> Vec3 {
        let [x, y, z] = self.coordinates(cell).map(|c| c as f32 + 0.5);
        Vec3::new(x, y, z) * self.cell_size() - self.half
    }

    /// A point spread evenly over a cell, the same for the same seed.
    pub fn jittered(&self, cell: u32, seed: u64) -> Vec3 {
        let base = u64::from(cell) * 3;
        let offset = Vec3::new(
            unit_float(seed, base),
            unit_float(seed, base + 1),
            unit_float(seed, base + 2),
        ) - 0.5;
        self.centre_of(cell) + offset * self.cell_size()
    }

    /// What looking up many points at once needs to know.
    #[inline(always)]
    pub(crate) fn lookup(&self) -> Lookup<'_> {
        Lookup {
            bits: &self.bits,
            resolution: self.resolution as i32,
            half: self.half,
            scale: self.resolution as f32 / (2.0 * self.half),
            last: (self.resolution - 1) as f32,
        }
    }
}

/// A grid's cells for vector code, numbered as [`OccupancyGrid`]'s.
#[derive(Clone, Copy)]
pub(crate) struct Lookup<'a> {
    bits: &'a [u64],
    pub(crate) resolution: i32,
    pub(crate) half: f32,
    /// Cells per unit of length.
    pub(crate) scale: f32,
    /// The largest coordinate of a cell.
    pub(crate) last: f32,
}

impl Lookup<'_> {
    /// Whether a cell is occupied.
    ///
    /// # Safety
    /// `cell` must be below `resolution^3`.
    #[inline(always)]
    pub(crate) unsafe fn is_occupied_unchecked(&self, cell: usize) -> bool {
        debug_assert!(cell / 64 < self.bits.len());
        // SAFETY: the caller promises that the cell exists, and each has a bit.
        let word = unsafe { *self.bits.get_unchecked(cell / 64) };
        (word >> (cell % 64)) & 1 == 1
    }
}
