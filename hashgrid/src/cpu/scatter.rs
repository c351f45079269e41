//! The way back: gradients of values and Jacobians, added into one level's entries.

use pulp::{Arch, Simd, WithSimd};

use super::cells::{Cells, LANES, Lane, check_level, locate, prefetch, prefetch_corner};
use crate::config::Interpolation;
use crate::layout::{BLOCK_ENTRIES, FEATURES, GridLayout, LevelLayout};

/// `(g, dn)`, each row `[n]`: a gradient by a level's Jacobian of the form
/// `dL/dJ[f, axis] = g[f] · dn[axis]`, which is what a normal `n = Jᵀ g` leaves behind.
pub type NormalPart<'a> = ([&'a [f32]; 2], [&'a [f32]; 3]);

/// `n` points, any `n`, and what comes back at each, as rows of `n` values.
#[derive(Clone, Copy, Debug)]
pub struct ScatterRows<'a> {
    /// The positions' x, y and z.
    pub position: [&'a [f32]; 3],
    /// For each of the level's two features, the loss's derivative by the value.
    pub d_value: [&'a [f32]; 2],
    /// `(g, dn)`, what came back through the Jacobian where that has the form
    /// `dL/dJ[f, axis] = g[f] · dn[axis]`: corner `c` receives `g[f] · (dn · ∇w_c)`.
    pub normal_part: Option<NormalPart<'a>>,
    /// Distance in values from each of these rows to the same row of the next call, which is asked for
    /// in advance, for it comes from memory. Only a hint; 0: none.
    pub prefetch_offset: usize,
}

/// Adds the gradients of all points to one level's entries.
///
/// - `grad`: the level's entries, `[entries, 2]`, accumulated into.
/// - `touched`: `touched[b]` becomes 1 when an entry of block `b` (8 entries, counted from the
///   level's first) receives something.
///
/// Levels are independent: run one task per level. Points are taken in order, so that the sums
/// have the same bits however many threads there are.
///
/// # Panics
/// When a slice's length does not fit, or the level does not exist.
pub fn scatter_level(
    layout: &GridLayout,
    level: usize,
    rows: &ScatterRows<'_>,
    grad: &mut [f32],
    touched: Option<&mut [u8]>,
) {
    let slopes = match rows.normal_part {
        None => Slopes::None,
        Some((scale, normal)) => Slopes::Product { scale, normal },
    };
    let (position, d_value) = (rows.position, rows.d_value);
    scatter(layout, level, |level, smooth| Scatter {
        level,
        smooth,
        position,
        d_value,
        slopes,
        prefetch_offset: rows.prefetch_offset,
        grad,
        touched,
    });
}

/// The loss's derivative by a level's Jacobian.
#[derive(Clone, Copy)]
pub(crate) enum Slopes<'a> {
    /// None.
    None,
    /// `dL/dJ[f, axis] = scale[f] · normal[axis]`, each `[n]`.
    Product {
        scale: [&'a [f32]; 2],
        normal: [&'a [f32]; 3],
    },
    /// `dL/dJ[f, axis]`, each `[n]`.
    Full([[&'a [f32]; 3]; 2]),
}

/// [`scatter_level`] with all of the Jacobian's derivative: `d_jacobian[f][axis]`.
pub(crate) fn scatter_full(
    layout: &GridLayout,
    level: usize,
    position: [&[f32]; 3],
    d_value: [&[f32]; 2],
    d_jacobian: [[&[f32]; 3]; 2],
    grad: &mut [f32],
) {
    scatter(layout, level, |level, smooth| Scatter {
        level,
        smooth,
        position,
        d_value,
        slopes: Slopes::Full(d_jacobian),
        prefetch_offset: 0,
        grad,
        touched: None,
    });
}

/// Runs what `with` makes of the level and of whether it is smooth, once its lengths are checked.
fn scatter<'a>(
    layout: &'a GridLayout,
    level: usize,
    with: impl FnOnce(&'a LevelLayout, bool) -> Scatter<'a>,
) {
    let smooth = layout.interpolation == Interpolation::Smoothstep;
    let op = with(&layout.levels[level], smooth);
    op.check();
    Arch::new().dispatch(op);
}

/// The scatter's arguments, as pulp wants a function with generic body to be written.
pub(super) struct Scatter<'a> {
    pub(super) level: &'a LevelLayout,
    pub(super) smooth: bool,
    pub(super) position: [&'a [f32]; 3],
    pub(super) d_value: [&'a [f32]; 2],
    pub(super) slopes: Slopes<'a>,
    /// As in [`ScatterRows`].
    pub(super) prefetch_offset: usize,
    pub(super) grad: &'a mut [f32],
    pub(super) touched: Option<&'a mut [u8]>,
}

impl WithSimd for Scatter<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        match (self.level.hash.is_some(), self.smooth) {
            (false, false) => self.run::<false, false>(),
            (false, true) => self.run::<false, true>(),
            (true, false) => self.run::<true, false>(),
            (true, true) => self.run::<true, true>(),
        }
    }
}

impl Scatter<'_> {
    /// Panics unless all lengths fit.
    fn check(&self) {
        let n = self.position[0].len();
        check_level(self.level, self.grad.len());
        let same = |what: &str, slices: &[&[f32]]| {
            for slice in slices {
                assert_eq!(slice.len(), n, "scatter_level: length of {what}");
            }
        };
        same("position", &self.position);
        same("d_value", &self.d_value);
        match &self.slopes {
            Slopes::None => {}
            Slopes::Product { scale, normal } => {
                same("normal_part's g", scale);
                same("normal_part's dn", normal);
            }
            Slopes::Full(rows) => rows.iter().for_each(|rows| same("d_jacobian", rows)),
        }
        if let Some(touched) = &self.touched {
            assert_eq!(
                touched.len(),
                self.level.entries / BLOCK_ENTRIES,
                "scatter_level: length of touched"
            );
        }
    }

    /// The cells of up to 16 points from `start` on.
    #[inline(always)]
    fn cells<const HASHED: bool, const SMOOTH: bool>(&self, start: usize) -> Cells {
        let count = LANES.min(self.position[0].len() - start);
        let [x, y, z] = take_all(&self.position, start, count);
        locate::<HASHED, SMOOTH>(self.level, &x, &y, &z)
    }

    /// Asks for the cache lines of the next call's rows from `start` on.
    #[inline(always)]
    fn ask_for_next(&self, start: usize) {
        let at = |row: &[f32]| prefetch(row.as_ptr().wrapping_add(self.prefetch_offset + start));
        for row in self.position {
            at(row);
        }
        for row in self.d_value {
            at(row);
        }
        if let Slopes::Product { scale, normal } = self.slopes {
            for row in scale {
                at(row);
            }
            for row in normal {
                at(row);
            }
        }
    }

    #[inline(always)]
    fn run<const HASHED: bool, const SMOOTH: bool>(mut self) {
        let n = self.position[0].len();
        // As on the way forward: one block's cache lines travel while the other's are written.
        let mut ring = [Cells::EMPTY, Cells::EMPTY];
        if n > 0 {
            ring[0] = self.cells::<HASHED, SMOOTH>(0);
        }
        let mut start = 0;
        while start < n {
            let count = LANES.min(n - start);
            let which = (start / LANES) & 1;
            if start + LANES < n {
                ring[1 - which] = self.cells::<HASHED, SMOOTH>(start + LANES);
            }
            let cells = &ring[which];
            let d_value = take_all(&self.d_value, start, count);
            let rows = match self.slopes {
                Slopes::None => corner_gradients(cells, &d_value),
                Slopes::Product { scale, normal } => {
                    let scale = take_all(&scale, start, count);
                    let normal = take_all(&normal, start, count);
                    product_gradients(cells, &d_value, &scale, &normal)
                }
                Slopes::Full(rows) => {
                    let [first, second] = &rows;
                    let slopes = [
                        take_all(first, start, count),
                        take_all(second, start, count),
                    ];
                    full_gradients(cells, &d_value, &slopes)
                }
            };
            if self.prefetch_offset > 0 {
                self.ask_for_next(start);
            }
            let touched = self.touched.as_deref_mut();
            add(self.grad, touched, cells, &rows, count, &ring[1 - which]);
            start += LANES;
        }
    }
}

/// Adds `rows` (`[feature][corner][point]`) of the first `count` points to their entries; the lines of
/// the `following` block's entries are asked for in between.
#[inline(always)]
fn add(
    grad: &mut [f32],
    mut touched: Option<&mut [u8]>,
    cells: &Cells,
    rows: &[[Lane; 8]; FEATURES],
    count: usize,
    following: &Cells,
) {
    // Both features of an entry next to each other, as the table has them: one load, one addition.
    let mut pairs = [[[0.0; FEATURES]; LANES]; 8];
    for c in 0..8 {
        for i in 0..LANES {
            pairs[c][i] = [rows[0][c][i], rows[1][c][i]];
        }
    }
    for i in 0..count {
        for c in 0..8 {
            prefetch_corner(grad, following, c, i);
        }
        for c in 0..8 {
            let entry = cells.index[c][i] as usize;
            let [first, second] = pairs[c][i];
            // SAFETY: `check_level` has proved that every index is an entry of this level, and
            // an entry is two values.
            unsafe {
                let at = grad.as_mut_ptr().add(FEATURES * entry).cast::<[f32; 2]>();
                let [a, b] = *at;
                *at = [a + first, b + second];
            }
            if let Some(touched) = &mut touched {
                // SAFETY: there is one flag for each block of the level's entries.
                unsafe { *touched.get_unchecked_mut(entry / BLOCK_ENTRIES) = 1 };
            }
        }
    }
}

/// 16 values from `start`; lanes from `count` on are 0.
#[inline(always)]
fn take(row: &[f32], start: usize, count: usize) -> Lane {
    let mut out = [0.0; LANES];
    if count == LANES {
        out.copy_from_slice(&row[start..start + LANES]);
    } else {
        out[..count].copy_from_slice(&row[start..start + count]);
    }
    out
}

/// [`take`] from each of `rows`. An array's `map` is not inlined here, and so not vectorised.
#[inline(always)]
fn take_all<const N: usize>(rows: &[&[f32]; N], start: usize, count: usize) -> [Lane; N] {
    let mut out = [[0.0; LANES]; N];
    for k in 0..N {
        out[k] = take(rows[k], start, count);
    }
    out
}

/// `1 − w` and `w` for each axis.
#[inline(always)]
fn both_weights(cells: &Cells) -> [[Lane; 2]; 3] {
    let mut out = [[[0.0; LANES]; 2]; 3];
    for axis in 0..3 {
        for i in 0..LANES {
            out[axis][0][i] = 1.0 - cells.weight[axis][i];
            out[axis][1][i] = cells.weight[axis][i];
        }
    }
    out
}

/// `w_c · d[f]`.
#[inline(always)]
fn corner_gradients(cells: &Cells, d_value: &[Lane; 2]) -> [[Lane; 8]; FEATURES] {
    let [x, y, z] = both_weights(cells);
    let mut out = [[[0.0; LANES]; 8]; FEATURES];
    for c in 0..8 {
        let (cx, cy, cz) = (c & 1, c >> 1 & 1, c >> 2);
        for i in 0..LANES {
            let weight = x[cx][i] * (y[cy][i] * z[cz][i]);
            for f in 0..FEATURES {
                out[f][c][i] = weight * d_value[f][i];
            }
        }
    }
    out
}

/// `w_c · d[f] + scale[f] · (normal · ∇w_c)`.
#[inline(always)]
fn product_gradients(
    cells: &Cells,
    d_value: &[Lane; 2],
    scale: &[Lane; 2],
    normal: &[Lane; 3],
) -> [[Lane; 8]; FEATURES] {
    let [x, y, z] = both_weights(cells);
    let mut step = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for i in 0..LANES {
            step[axis][i] = normal[axis][i] * cells.slope[axis][i];
        }
    }
    let mut out = [[[0.0; LANES]; 8]; FEATURES];
    for c in 0..8 {
        let (cx, cy, cz) = (c & 1, c >> 1 & 1, c >> 2);
        let sign = |upper: usize, v: f32| if upper == 1 { v } else { -v };
        for i in 0..LANES {
            let yz = y[cy][i] * z[cz][i];
            let dyz = sign(cy, step[1][i]) * z[cz][i] + sign(cz, step[2][i]) * y[cy][i];
            let weight = x[cx][i] * yz;
            let slope = sign(cx, step[0][i]) * yz + x[cx][i] * dyz;
            for f in 0..FEATURES {
                out[f][c][i] = weight * d_value[f][i] + slope * scale[f][i];
            }
        }
    }
    out
}

/// `w_c · d[f] + slopes[f] · ∇w_c`.
#[inline(always)]
fn full_gradients(
    cells: &Cells,
    d_value: &[Lane; 2],
    slopes: &[[Lane; 3]; 2],
) -> [[Lane; 8]; FEATURES] {
    let [x, y, z] = both_weights(cells);
    let mut out = [[[0.0; LANES]; 8]; FEATURES];
    for f in 0..FEATURES {
        let mut step = slopes[f];
        for axis in 0..3 {
            for i in 0..LANES {
                step[axis][i] *= cells.slope[axis][i];
            }
        }
        for c in 0..8 {
            let (cx, cy, cz) = (c & 1, c >> 1 & 1, c >> 2);
            let sign = |upper: usize, v: f32| if upper == 1 { v } else { -v };
            for i in 0..LANES {
                let yz = y[cy][i] * z[cz][i];
                let dyz = sign(cy, step[1][i]) * z[cz][i] + sign(cz, step[2][i]) * y[cy][i];
                out[f][c][i] = x[cx][i] * (yz * d_value[f][i] + dyz) + sign(cx, step[0][i]) * yz;
            }
        }
    }
    out
}
