//! Encoding a tile of points: gather and blend.

use pulp::{Arch, Simd, WithSimd};

use super::cells::{Cells, LANES, Lane, check_level, locate, prefetch_corner};
use crate::config::Interpolation;
use crate::layout::{FEATURES, GridLayout, LevelLayout};

/// Encodes one tile of `p` points, which are given as three arrays; `p` is a multiple of 16.
///
/// - `active`: number of levels in use; features of levels from `active` on are 0, and so are
///   their derivatives.
/// - `table`: `[entries, 2]`, row-major.
/// - `x`, `y`, `z`: positions in `[0, 1]`, each `[p]`. Outside, a coordinate is clamped, and the
///   derivative along it is 0. NaN counts as 0.
/// - `values`: `[2 L, p]`; feature `f` of level `l` is row `2 l + f`.
/// - `jacobian`: `[2 L, 3, p]`; row `3 k + a` is the derivative of feature `k` along axis `a`.
///
/// The kernel picks the machine's widest vector instructions itself, once per call, which costs
/// nothing next to a tile; it may be called from code that is itself dispatched. A tile of a few
/// hundred points is best: each level's part of the table stays in cache for the whole tile.
///
/// # Panics
/// When a slice's length does not fit.
#[allow(clippy::too_many_arguments)]
pub fn encode_tile(
    layout: &GridLayout,
    active: usize,
    table: &[f32],
    x: &[f32],
    y: &[f32],
    z: &[f32],
    values: &mut [f32],
    jacobian: Option<&mut [f32]>,
) {
    let points = x.len();
    assert!(
        points.is_multiple_of(LANES),
        "encode_tile: {points} points, not a multiple of 16"
    );
    assert_eq!(y.len(), points, "encode_tile: length of y");
    assert_eq!(z.len(), points, "encode_tile: length of z");
    assert_eq!(
        table.len(),
        layout.entries() * FEATURES,
        "encode_tile: length of the table"
    );
    assert_eq!(
        values.len(),
        layout.features() * points,
        "encode_tile: length of values"
    );
    if let Some(jacobian) = &jacobian {
        assert_eq!(
            jacobian.len(),
            layout.features() * 3 * points,
            "encode_tile: length of jacobian"
        );
    }
    Arch::new().dispatch(EncodeTile {
        layout,
        active,
        table,
        position: [x, y, z],
        values,
        jacobian,
    });
}

/// [`encode_tile`]'s arguments, as pulp wants a function with generic body to be written.
pub(super) struct EncodeTile<'a> {
    pub(super) layout: &'a GridLayout,
    pub(super) active: usize,
    pub(super) table: &'a [f32],
    pub(super) position: [&'a [f32]; 3],
    pub(super) values: &'a mut [f32],
    pub(super) jacobian: Option<&'a mut [f32]>,
}

impl WithSimd for EncodeTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let points = self.position[0].len();
        if points == 0 {
            return;
        }
        let mut jacobian = self.jacobian;
        let rows = FEATURES * points;
        let smooth = self.layout.interpolation == Interpolation::Smoothstep;
        let active = self.active.min(self.layout.levels.len());
        let table_of = |level: &LevelLayout| {
            &self.table[FEATURES * level.offset..FEATURES * (level.offset + level.entries)]
        };
        let mut block = Cells::EMPTY;
        for (l, (level, values)) in self
            .layout
            .levels
            .iter()
            .zip(self.values.chunks_exact_mut(rows))
            .enumerate()
        {
            let jacobian = jacobian
                .as_deref_mut()
                .map(|j| &mut j[3 * rows * l..3 * rows * (l + 1)]);
            if l >= active {
                values.fill(0.0);
                if let Some(jacobian) = jacobian {
                    jacobian.fill(0.0);
                }
                continue;
            }
            if l == 0 {
                block = first_block(level, smooth, self.position);
            }
            let next = self.layout.levels[..active]
                .get(l + 1)
                .map(|next| (next, table_of(next)));
            let one = Level {
                level,
                table: table_of(level),
                position: self.position,
                block,
                next,
            };
            block = match (level.hash.is_some(), smooth) {
                (false, false) => one.encode::<false, false>(values, jacobian),
                (false, true) => one.encode::<false, true>(values, jacobian),
                (true, false) => one.encode::<true, false>(values, jacobian),
                (true, true) => one.encode::<true, true>(values, jacobian),
            };
        }
    }
}

/// The cells of a level's first 16 points.
#[inline(always)]
fn first_block(level: &LevelLayout, smooth: bool, position: [&[f32]; 3]) -> Cells {
    let [x, y, z] = position.map(|axis| &axis.as_chunks::<LANES>().0[0]);
    match (level.hash.is_some(), smooth) {
        (false, false) => locate::<false, false>(level, x, y, z),
        (false, true) => locate::<false, true>(level, x, y, z),
        (true, false) => locate::<true, false>(level, x, y, z),
        (true, true) => locate::<true, true>(level, x, y, z),
    }
}

/// One level of a tile.
struct Level<'a> {
    level: &'a LevelLayout,
    /// This level's entries.
    table: &'a [f32],
    position: [&'a [f32]; 3],
    /// The first 16 points' cells.
    block: Cells,
    /// The level after this one, with its entries.
    next: Option<(&'a LevelLayout, &'a [f32])>,
}

impl Level<'_> {
    /// `values` is `[2, p]`, `jacobian` `[2, 3, p]`; returns the first cells of the next level.
    ///
    /// While 16 points' corners are gathered, the cache lines of the next 16, or of the next level's
    /// first, are on their way.
    #[inline(always)]
    fn encode<const HASHED: bool, const SMOOTH: bool>(
        self,
        values: &mut [f32],
        mut jacobian: Option<&mut [f32]>,
    ) -> Cells {
        let Self { level, table, .. } = self;
        check_level(level, table.len());
        let [x, y, z] = self.position.map(|axis| axis.as_chunks::<LANES>().0);
        let blocks = x.len();
        let values = values.as_chunks_mut::<LANES>().0;
        let mut ring = [self.block, Cells::EMPTY];
        for b in 0..blocks {
            let following = &mut ring[(b + 1) & 1];
            let mut ahead = table;
            if b + 1 < blocks {
                *following = locate::<HASHED, SMOOTH>(level, &x[b + 1], &y[b + 1], &z[b + 1]);
            } else if let Some((next, table)) = self.next {
                *following = first_block(next, SMOOTH, self.position);
                ahead = table;
            }
            let (cells, following) = (&ring[b & 1], &ring[(b + 1) & 1]);
            let corners = gather(table, cells, ahead, following);
            match &mut jacobian {
                None => {
                    for f in 0..FEATURES {
                        values[f * blocks + b] = blend(&corners[f], &cells.weight);
                    }
                }
                Some(jacobian) => {
                    let jacobian = jacobian.as_chunks_mut::<LANES>().0;
                    for f in 0..FEATURES {
                        let (value, gradient) = blend_with_gradient(&corners[f], cells);
                        values[f * blocks + b] = value;
                        for axis in 0..3 {
                            jacobian[(3 * f + axis) * blocks + b] = gradient[axis];
                        }
                    }
                }
            }
        }
        let [even, odd] = ring;
        if blocks & 1 == 0 { even } else { odd }
    }
}

/// Both features of the eight corners of 16 cells: `[feature][corner][point]`; the lines of the
/// `following` ones, of the table `ahead`, are asked for in between. All at once they would wait for
/// one another.
///
/// Each corner is one 8-byte load. On x86-64 they are paired by hand: left to itself the compiler
/// emits gather instructions, which take longer here than the loads they stand for.
#[inline(always)]
fn gather(table: &[f32], cells: &Cells, ahead: &[f32], following: &Cells) -> [[Lane; 8]; FEATURES] {
    let mut corners = [[[0.0; LANES]; 8]; FEATURES];
    let entry = |c: usize, i: usize| {
        table
            .as_ptr()
            .wrapping_add(FEATURES * cells.index[c][i] as usize)
    };
    #[cfg(target_arch = "x86_64")]
    for c in 0..8 {
        for i in 0..LANES {
            prefetch_corner(ahead, following, c, i);
        }
        for i in (0..LANES).step_by(4) {
            use std::arch::x86_64::{
                _mm_castpd_ps as single, _mm_load_sd, _mm_loadh_pd, _mm_shuffle_ps, _mm_storeu_ps,
            };
            let (p0, p1) = (entry(c, i).cast::<f64>(), entry(c, i + 1).cast());
            let (p2, p3) = (entry(c, i + 2).cast(), entry(c, i + 3).cast());
            // SAFETY: `check_level` has proved that every index is an entry of this level, and an
            // entry is two values, 8 bytes, for which these loads want no alignment. The stores
            // write 4 of a lane's values, from a multiple of 4 on. SSE is part of x86-64.
            unsafe {
                let low = single(_mm_loadh_pd(_mm_load_sd(p0), p1));
                let high = single(_mm_loadh_pd(_mm_load_sd(p2), p3));
                let [first, second] = &mut corners;
                _mm_storeu_ps(
                    first[c].as_mut_ptr().add(i),
                    _mm_shuffle_ps::<0b10_00_10_00>(low, high),
                );
                _mm_storeu_ps(
                    second[c].as_mut_ptr().add(i),
                    _mm_shuffle_ps::<0b11_01_11_01>(low, high),
                );
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    for c in 0..8 {
        for i in 0..LANES {
            prefetch_corner(ahead, following, c, i);
            // SAFETY: as above; the compiler merges the two loads.
            let pair = unsafe { *entry(c, i).cast::<[f32; 2]>() };
            corners[0][c][i] = pair[0];
            corners[1][c][i] = pair[1];
        }
    }
    corners
}

/// `a + w (b − a)`, point by point.
#[inline(always)]
fn lerp(a: &Lane, b: &Lane, w: &Lane) -> Lane {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = a[i] + w[i] * (b[i] - a[i]);
    }
    out
}

/// `b − a`, point by point.
#[inline(always)]
fn difference(a: &Lane, b: &Lane) -> Lane {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = b[i] - a[i];
    }
    out
}

/// The trilinear blend of a cell's corners: along x, then y, then z.
#[inline(always)]
fn blend(corners: &[Lane; 8], [x, y, z]: &[Lane; 3]) -> Lane {
    let near = lerp(
        &lerp(&corners[0], &corners[1], x),
        &lerp(&corners[2], &corners[3], x),
        y,
    );
    let far = lerp(
        &lerp(&corners[4], &corners[5], x),
        &lerp(&corners[6], &corners[7], x),
        y,
    );
    lerp(&near, &far, z)
}

/// The blend and its derivative with respect to the position, from one tree: the derivative along
/// an axis replaces the interpolation along it by a difference.
#[inline(always)]
fn blend_with_gradient(corners: &[Lane; 8], cells: &Cells) -> (Lane, [Lane; 3]) {
    let [x, y, z] = &cells.weight;
    let [c0, c1, c2, c3, c4, c5, c6, c7] = corners;
    let (e0, e1) = (lerp(c0, c1, x), lerp(c2, c3, x));
    let (e2, e3) = (lerp(c4, c5, x), lerp(c6, c7, x));
    let (d0, d1) = (difference(c0, c1), difference(c2, c3));
    let (d2, d3) = (difference(c4, c5), difference(c6, c7));
    let (near, far) = (lerp(&e0, &e1, y), lerp(&e2, &e3, y));
    let along_x = lerp(&lerp(&d0, &d1, y), &lerp(&d2, &d3, y), z);
    let along_y = lerp(&difference(&e0, &e1), &difference(&e2, &e3), z);
    let along_z = difference(&near, &far);
    let mut gradient = [along_x, along_y, along_z];
    for axis in 0..3 {
        for i in 0..LANES {
            gradient[axis][i] *= cells.slope[axis][i];
        }
    }
    (lerp(&near, &far, z), gradient)
}
