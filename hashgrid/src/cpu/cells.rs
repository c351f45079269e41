//! Which cell a point lies in, the table indices of its corners, and its weights: 16 points at once.

use crate::layout::{BLOCK_ENTRIES, FEATURES, LevelLayout};

/// Points handled together, one to a lane.
pub(crate) const LANES: usize = 16;

/// One number for each of 16 points.
pub(crate) type Lane = [f32; LANES];

/// The cells of 16 points on one level. Corner `c` is at `(c & 1, c >> 1 & 1, c >> 2)` of the cell.
pub(crate) struct Cells {
    /// Entry of each corner, relative to the level.
    pub(crate) index: [[u32; LANES]; 8],
    /// Weight of the upper corner along x, y and z.
    pub(crate) weight: [Lane; 3],
    /// Derivative of that weight with respect to the position in `[0, 1]`.
    pub(crate) slope: [Lane; 3],
}

impl Cells {
    /// Storage to be overwritten.
    pub(crate) const EMPTY: Self = Self {
        index: [[0; LANES]; 8],
        weight: [[0.0; LANES]; 3],
        slope: [[0.0; LANES]; 3],
    };
}

/// A point's cell along one axis: its lower node, the upper node's weight, and that weight's slope.
///
/// Positions are clamped to `[0, 1]`, where the slope becomes zero; NaN counts as 0.
#[inline(always)]
fn axis<const SMOOTH: bool>(position: &Lane, resolution: u32) -> ([u32; LANES], Lane, Lane) {
    let scale = resolution as f32;
    let last = resolution as i32 - 1;
    let mut node = [0; LANES];
    let mut weight = [0.0; LANES];
    let mut slope = [0.0; LANES];
    for i in 0..LANES {
        let p = position[i];
        // Written as comparisons so that NaN takes the second arm.
        let low = if p > 0.0 { p } else { 0.0 };
        let inside = if low < 1.0 { low } else { 1.0 };
        let unit = if p == inside { scale } else { 0.0 };
        let scaled = inside * scale;
        // SAFETY: `inside` is in [0, 1] and the resolution at most 2^20.
        let floor: i32 = unsafe { scaled.to_int_unchecked() };
        let cell = if floor < last { floor } else { last };
        let t = scaled - cell as f32;
        node[i] = cell as u32;
        if SMOOTH {
            weight[i] = t * t * (3.0 - 2.0 * t);
            slope[i] = 6.0 * t * (1.0 - t) * unit;
        } else {
            weight[i] = t;
            slope[i] = unit;
        }
    }
    (node, weight, slope)
}

/// The cells of 16 points on `level`. `HASHED` and `SMOOTH` are the level's kind, as constants.
#[inline(always)]
pub(crate) fn locate<const HASHED: bool, const SMOOTH: bool>(
    level: &LevelLayout,
    x: &Lane,
    y: &Lane,
    z: &Lane,
) -> Cells {
    let (x, weight_x, slope_x) = axis::<SMOOTH>(x, level.resolution);
    let (y, weight_y, slope_y) = axis::<SMOOTH>(y, level.resolution);
    let (z, weight_z, slope_z) = axis::<SMOOTH>(z, level.resolution);
    let side = level.resolution + 1;
    let mask = (level.entries as u32).wrapping_sub(1);
    let hash = level.hash.unwrap_or_default();
    let mut index = [[0; LANES]; 8];
    for i in 0..LANES {
        if HASHED {
            let part = |node: u32, axis: usize| hash.part(node, axis);
            let x = [part(x[i], 0), part(x[i] + 1, 0)];
            let y = [part(y[i], 1), part(y[i] + 1, 1)];
            let z = [part(z[i], 2), part(z[i] + 1, 2)];
            let yz = [y[0] ^ z[0], y[1] ^ z[0], y[0] ^ z[1], y[1] ^ z[1]];
            for c in 0..4 {
                index[2 * c][i] = (x[0] ^ yz[c]) & mask;
                index[2 * c + 1][i] = (x[1] ^ yz[c]) & mask;
            }
        } else {
            let first = x[i] + side * (y[i] + side * z[i]);
            for c in 0..8 {
                let step = (c & 1) + side * ((c >> 1 & 1) + side * (c >> 2));
                index[c as usize][i] = first + step;
            }
        }
    }
    Cells {
        index,
        weight: [weight_x, weight_y, weight_z],
        slope: [slope_x, slope_y, slope_z],
    }
}

/// Asks for the cache line of one corner of one of a block's cells.
#[inline(always)]
pub(crate) fn prefetch_corner(table: &[f32], cells: &Cells, corner: usize, point: usize) {
    let entry = FEATURES * cells.index[corner][point] as usize;
    prefetch(table.as_ptr().wrapping_add(entry));
}

/// Asks for the cache line of a value, which need not exist.
#[inline(always)]
pub(crate) fn prefetch(at: *const f32) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch is a hint; it faults for no address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

/// Panics unless every index that [`locate`] can return for `level` lies within `values`.
///
/// This is what the unchecked accesses of the kernels rest on, as a level's fields are public. Blocks are whole, so that
/// there is a flag for each entry's block.
pub(crate) fn check_level(level: &LevelLayout, values: usize) {
    // First, for the nodes' number to fit 64 bits.
    let is_bounded = (1..=1 << 20).contains(&level.resolution) && level.entries <= 1 << 31;
    let fits = |side: u64| {
        if level.hash.is_some() {
            level.entries.is_power_of_two()
        } else {
            side.pow(3) <= level.entries as u64
        }
    };
    assert!(
        is_bounded
            && fits(u64::from(level.resolution) + 1)
            && level.entries.is_multiple_of(BLOCK_ENTRIES),
        "hashgrid: not a valid level: {level:?}"
    );
    assert_eq!(
        values,
        level.entries * FEATURES,
        "hashgrid: number of values for a level of {} entries",
        level.entries
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::Hash;

    fn refused(resolution: u32, entries: usize, hash: Option<Hash>) -> bool {
        let level = LevelLayout {
            resolution,
            offset: 0,
            entries,
            hash,
        };
        let values = entries.saturating_mul(FEATURES);
        std::panic::catch_unwind(|| check_level(&level, values)).is_err()
    }

    #[test]
    fn levels_that_kernels_would_leave_are_refused() {
        let hashed = Some(Hash::Nodes);
        assert!(!refused(2, 32, None));
        assert!(!refused(2, 8, hashed));
        // Of 27 entries the last three are in a block without a flag.
        assert!(refused(2, 27, None));
        assert!(refused(1, 4, hashed));
        assert!(refused(3, 32, None));
        assert!(refused(0, 32, None));
        assert!(refused(2, 24, hashed));
        assert!(refused(u32::MAX, 32, None));
        assert!(refused(2, 1 << 32, hashed));
    }
}
