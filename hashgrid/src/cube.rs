//! A point's cell on a level, as GPU kernels see it: shared by the encoding and by ops that fuse it.
//!
//! The arithmetic is that of [`cpu`](crate::cpu), one point to a thread. Levels are uploaded as
//! [`level_words`]; tables stay what they are on the CPU, `[entries, 2]`, row-major.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use gpu_tensors::{AtomicSum, cubecl};

use crate::config::Interpolation;
use crate::cpu::PRIMES;
use crate::layout::{FEATURES, GridLayout};
use cubecl::prelude::*;

/// Words per level in [`level_words`].
pub const LEVEL_WORDS: usize = 4;

/// The levels for a kernel: resolution, first entry, mask of the hash, and whether it is hashed.
///
/// # Panics
/// When a level could send a kernel outside its table: the fields are public.
#[must_use]
pub fn level_words(layout: &GridLayout) -> Vec<u32> {
    layout
        .levels
        .iter()
        .flat_map(|level| {
            crate::cpu::check_level(level, FEATURES * level.entries);
            [
                level.resolution,
                level.offset as u32,
                (level.entries as u32).wrapping_sub(1),
                u32::from(level.hashed),
            ]
        })
        .collect()
}

/// Whether weights are those of a smoothstep, as a kernel's constant.
#[must_use]
pub fn is_smooth(layout: &GridLayout) -> bool {
    layout.interpolation == Interpolation::Smoothstep
}

/// Where a point lies along one axis of a level.
#[derive(CubeType, Clone, Copy)]
pub struct Along {
    /// Lower node.
    pub node: u32,
    /// Weight of the upper node.
    pub weight: f32,
    /// Derivative of that weight by the position in `[0, 1]`.
    pub slope: f32,
}

/// Where a point lies on a level.
#[derive(CubeType, Clone, Copy)]
pub struct Cell {
    /// Along x.
    pub x: Along,
    /// Along y.
    pub y: Along,
    /// Along z.
    pub z: Along,
    /// The level's first entry in the table.
    first: u32,
    /// Nodes per axis.
    side: u32,
    /// The hash's mask.
    mask: u32,
    /// 1 for a hashed level, else 0.
    hashed: u32,
}

/// Both features of a cell at a point, and their derivatives by the position.
#[derive(CubeType, Clone, Copy)]
pub struct Blend {
    /// The first feature.
    pub value0: f32,
    /// The second one.
    pub value1: f32,
    /// The first feature's derivative along x, y and z.
    pub x0: f32,
    /// Along y.
    pub y0: f32,
    /// Along z.
    pub z0: f32,
    /// The second feature's derivative along x, y and z.
    pub x1: f32,
    /// Along y.
    pub y1: f32,
    /// Along z.
    pub z1: f32,
}

#[cube]
fn along(position: f32, resolution: u32, #[comptime] smooth: bool) -> Along {
    let scale = f32::cast_from(resolution);
    // Comparisons that NaN fails: it counts as 0.
    let low = select(position > 0.0f32, position, 0.0f32);
    let inside = select(low < 1.0f32, low, 1.0f32);
    let unit = select(position == inside, scale, 0.0f32);
    let scaled = inside * scale;
    let node = min(u32::cast_from(scaled), resolution - 1u32);
    let t = scaled - f32::cast_from(node);
    let mut weight = t;
    let mut slope = unit;
    if smooth {
        weight = t * t * (3.0f32 - 2.0f32 * t);
        slope = 6.0f32 * t * (1.0f32 - t) * unit;
    }
    Along {
        node,
        weight,
        slope,
    }
}

/// The cell of a point in `[0, 1]³`; coordinates outside are clamped, and NaN counts as 0.
#[cube]
pub fn locate(
    x: f32,
    y: f32,
    z: f32,
    levels: &[u32],
    level: usize,
    #[comptime] smooth: bool,
) -> Cell {
    let at = level * comptime!(LEVEL_WORDS);
    let resolution = levels[at];
    Cell {
        x: along(x, resolution, smooth),
        y: along(y, resolution, smooth),
        z: along(z, resolution, smooth),
        first: levels[at + 1],
        side: resolution + 1u32,
        mask: levels[at + 2],
        hashed: levels[at + 3],
    }
}

/// The table's entry of corner `c`, which is at `(c & 1, c >> 1 & 1, c >> 2)` of the cell.
#[cube]
pub fn entry(cell: &Cell, #[comptime] c: u32) -> usize {
    let x = cell.x.node + comptime!(c & 1);
    let y = cell.y.node + comptime!(c >> 1 & 1);
    let z = cell.z.node + comptime!(c >> 2);
    let dense = x + cell.side * (y + cell.side * z);
    let hash = (x ^ (y * comptime!(PRIMES[0])) ^ (z * comptime!(PRIMES[1]))) & cell.mask;
    (cell.first + select(cell.hashed == 1u32, hash, dense)) as usize
}

#[cube]
fn lerp(a: f32, b: f32, w: f32) -> f32 {
    a + w * (b - a)
}

/// One feature of the cell at the point, with its derivatives: value, x, y, z.
#[cube]
fn blend_one(cell: &Cell, table: &[f32], #[comptime] feature: usize) -> (f32, f32, f32, f32) {
    let c0 = table[entry(cell, 0u32) * 2 + feature];
    let c1 = table[entry(cell, 1u32) * 2 + feature];
    let c2 = table[entry(cell, 2u32) * 2 + feature];
    let c3 = table[entry(cell, 3u32) * 2 + feature];
    let c4 = table[entry(cell, 4u32) * 2 + feature];
    let c5 = table[entry(cell, 5u32) * 2 + feature];
    let c6 = table[entry(cell, 6u32) * 2 + feature];
    let c7 = table[entry(cell, 7u32) * 2 + feature];
    let (wx, wy, wz) = (cell.x.weight, cell.y.weight, cell.z.weight);
    let (e0, e1) = (lerp(c0, c1, wx), lerp(c2, c3, wx));
    let (e2, e3) = (lerp(c4, c5, wx), lerp(c6, c7, wx));
    let (near, far) = (lerp(e0, e1, wy), lerp(e2, e3, wy));
    let along_x = lerp(lerp(c1 - c0, c3 - c2, wy), lerp(c5 - c4, c7 - c6, wy), wz);
    let along_y = lerp(e1 - e0, e3 - e2, wz);
    (
        lerp(near, far, wz),
        along_x * cell.x.slope,
        along_y * cell.y.slope,
        (far - near) * cell.z.slope,
    )
}

/// Both features of the cell at the point, and their derivatives by it.
#[cube]
pub fn blend(cell: &Cell, table: &[f32]) -> Blend {
    let (value0, x0, y0, z0) = blend_one(cell, table, 0usize);
    let (value1, x1, y1, z1) = blend_one(cell, table, 1usize);
    Blend {
        value0,
        value1,
        x0,
        y0,
        z0,
        x1,
        y1,
        z1,
    }
}

/// Adds the gradients of a cell's values and derivatives to its corners' entries of `grad`.
#[cube]
pub fn scatter<A: AtomicSum>(grad: &[Atomic<A::Word>], cell: &Cell, d: &Blend) {
    #[unroll]
    for c in 0..8u32 {
        let (ux, uy, uz) = comptime!((c & 1 == 1, c >> 1 & 1 == 1, c >> 2 == 1));
        let (x, dx) = factor(&cell.x, ux);
        let (y, dy) = factor(&cell.y, uy);
        let (z, dz) = factor(&cell.z, uz);
        let weight = x * (y * z);
        let (along_x, along_y, along_z) = (dx * (y * z), dy * (x * z), dz * (x * y));
        let at = entry(cell, c) * 2;
        A::add(
            &grad[at],
            weight * d.value0 + along_x * d.x0 + along_y * d.y0 + along_z * d.z0,
        );
        A::add(
            &grad[at + 1],
            weight * d.value1 + along_x * d.x1 + along_y * d.y1 + along_z * d.z1,
        );
    }
}

/// A corner's weight along an axis and its derivative.
#[cube]
fn factor(along: &Along, #[comptime] upper: bool) -> (f32, f32) {
    if upper {
        (along.weight, along.slope)
    } else {
        (1.0f32 - along.weight, -along.slope)
    }
}
