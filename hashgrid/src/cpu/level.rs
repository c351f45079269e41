//! Encoding one level: gather and blend.

use std::hint::black_box;

use pulp::{Arch, Simd, WithSimd};

use super::cells::{Cells, LANES, Lane, check_level, locate, prefetch_corner};
use crate::config::Interpolation;
use crate::layout::{BLOCK_ENTRIES, FEATURES, GridLayout, LevelLayout};

/// Encodes one tile of `p` points on one level: what [`encode_tile`](super::encode_tile) does on each, with the
/// same bits.
///
/// Whoever has very many points goes level by level, each for all tiles, and has [`fetch`] read
/// [`level_values`] first: then corners are in the caches, whatever the table's size. A point asks for up to eight lines in
/// no order, so that one for every 48 entries is enough for reading all of them in order to cost less.
///
/// - `table`: `[entries, 2]` of all levels, row-major.
/// - `position`: x, y and z in `[0, 1]`, each `[p]`, `p` a multiple of 16.
/// - `values`: `[2, p]`, `jacobian`: `[2, 3, p]`, the level's features and their derivatives.
///
/// # Panics
/// When there is no such level, or a slice's length does not fit.
pub fn encode_level(
    layout: &GridLayout,
    level: usize,
    table: &[f32],
    position: [&[f32]; 3],
    values: &mut [f32],
    jacobian: Option<&mut [f32]>,
) {
    let points = position[0].len();
    assert!(
        points.is_multiple_of(LANES),
        "encode_level: {points} points, not a multiple of 16"
    );
    for axis in position {
        assert_eq!(axis.len(), points, "encode_level: length of a coordinate");
    }
    assert_eq!(
        values.len(),
        FEATURES * points,
        "encode_level: length of values"
    );
    if let Some(jacobian) = &jacobian {
        assert_eq!(
            jacobian.len(),
            3 * FEATURES * points,
            "encode_level: length of jacobian"
        );
    }
    Arch::new().dispatch(EncodeLevel {
        level: &layout.levels[level],
        smooth: layout.interpolation == Interpolation::Smoothstep,
        table: level_values(layout, level, table),
        position,
        values,
        jacobian,
    });
}

/// Reads `values` of a table from end to end, for [`encode_level`] to find them in the caches. Memory hands out lines in a
/// row several times as fast as lines in no order.
pub fn fetch(values: &[f32]) {
    let lines = values.chunks(FEATURES * BLOCK_ENTRIES);
    black_box(lines.map(|line| line[0]).sum::<f32>());
}

/// One level's part of `table` (`[entries, 2]` of all levels).
///
/// # Panics
/// When there is no such level, or the table is too short.
#[must_use]
pub fn level_values<'a>(layout: &GridLayout, level: usize, table: &'a [f32]) -> &'a [f32] {
    let level = &layout.levels[level];
    &table[FEATURES * level.offset..FEATURES * (level.offset + level.entries)]
}

struct EncodeLevel<'a> {
    level: &'a LevelLayout,
    smooth: bool,
    /// The level's entries.
    table: &'a [f32],
    position: [&'a [f32]; 3],
    values: &'a mut [f32],
    jacobian: Option<&'a mut [f32]>,
}

impl WithSimd for EncodeLevel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        if self.values.is_empty() {
            return;
        }
        let one = Level {
            level: self.level,
            table: self.table,
            position: self.position,
            block: first_block(self.level, self.table, self.smooth, self.position),
            next: None,
        };
        one.encode(self.smooth, self.values, self.jacobian);
    }
}

/// The cells of the first 16 points on a level of which `table` has the entries.
///
/// # Panics
/// When it has not: [`check_level`].
#[inline(always)]
pub(super) fn first_block(
    level: &LevelLayout,
    table: &[f32],
    smooth: bool,
    position: [&[f32]; 3],
) -> Cells {
    check_level(level, table.len());
    let [x, y, z] = position.map(|axis| &axis.as_chunks::<LANES>().0[0]);
    match (level.hash.is_some(), smooth) {
        (false, false) => locate::<false, false>(level, x, y, z),
        (false, true) => locate::<false, true>(level, x, y, z),
        (true, false) => locate::<true, false>(level, x, y, z),
        (true, true) => locate::<true, true>(level, x, y, z),
    }
}

/// One level of a tile.
pub(super) struct Level<'a> {
    pub(super) level: &'a LevelLayout,
    /// This level's entries.
    pub(super) table: &'a [f32],
    pub(super) position: [&'a [f32]; 3],
    /// The first 16 points' cells.
    pub(super) block: Cells,
    /// The level after this one, with its entries.
    pub(super) next: Option<(&'a LevelLayout, &'a [f32])>,
}

impl Level<'_> {
    /// `values` is `[2, p]`, `jacobian` `[2, 3, p]`; returns the first cells of the next level.
    ///
    /// While 16 points' corners are gathered, the cache lines of the next 16, or of the next level's
    /// first, are on their way.
    #[inline(always)]
    pub(super) fn encode(
        self,
        smooth: bool,
        values: &mut [f32],
        jacobian: Option<&mut [f32]>,
    ) -> Cells {
        match (self.level.hash.is_some(), smooth) {
            (false, false) => self.encode_as::<false, false>(values, jacobian),
            (false, true) => self.encode_as::<false, true>(values, jacobian),
            (true, false) => self.encode_as::<true, false>(values, jacobian),
            (true, true) => self.encode_as::<true, true>(values, jacobian),
        }
    }

    #[inline(always)]
    fn encode_as<const HASHED: bool, const SMOOTH: bool>(
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
                *following = first_block(next, table, SMOOTH, self.position);
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
