//! A point's cell on a level, as GPU kernels see it: shared by the encoding and by ops that fuse it.
//!
//! The arithmetic is that of [`cpu`](crate::cpu), one point to a thread. Levels are uploaded as
//! [`level_words`]; tables stay what they are on the CPU, `[entries, 2]`, row-major, and are read by
//! [`Entries`].

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

mod entries;

use gpu_tensors::{AtomicSum, cubecl};

use crate::config::Interpolation;
use crate::hash::PRIMES;
use crate::layout::GridLayout;
use cubecl::prelude::*;
pub use entries::{DeviceTable, Entries, Half, Single};

/// Words per level in [`level_words`].
pub const LEVEL_WORDS: usize = 4;

/// The levels for a kernel: resolution, first entry, mask of the hash, and 0 for a level without one, else 1 more
/// than the base-2 logarithm of the side of what is hashed as one.
///
/// # Panics
/// When a level could send a kernel outside a table of [`GridLayout::entries`], as the fields are public: one that is not
/// valid by itself or does not begin where the one before it ends, the first one at 0, or so many entries that 32 bits do not
/// count their values.
#[must_use]
pub fn level_words(layout: &GridLayout) -> Vec<u32> {
    layout.check_for_kernels();
    layout
        .levels
        .iter()
        .flat_map(|level| {
            [
                level.resolution,
                level.offset as u32,
                (level.entries as u32).wrapping_sub(1),
                level.hash.map_or(0, |hash| hash.block_shift() + 1),
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
    /// Whether nodes are hashed.
    hashed: bool,
    /// Base-2 logarithm of the side of what is hashed as one.
    block_shift: u32,
}

/// Both features of an entry.
pub type Pair = Vector<f32, Const<2>>;

/// Both features of a cell at a point, and their derivatives by the position.
#[derive(CubeType, Clone, Copy)]
pub struct Blend {
    /// The features.
    pub value: Pair,
    /// Their derivatives along x.
    pub x: Pair,
    /// Along y.
    pub y: Pair,
    /// Along z.
    pub z: Pair,
}

/// A pair of two numbers.
#[cube]
pub fn pair(first: f32, second: f32) -> Pair {
    let mut both = Pair::new(first);
    both.insert(1usize, second);
    both
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
        hashed: levels[at + 3] != 0u32,
        block_shift: max(levels[at + 3], 1u32) - 1u32,
    }
}

/// The table's entry of corner `c`, which is at `(c & 1, c >> 1 & 1, c >> 2)` of the cell.
#[cube]
pub fn entry(cell: &Cell, #[comptime] c: u32) -> usize {
    let x = cell.x.node + comptime!(c & 1);
    let y = cell.y.node + comptime!(c >> 1 & 1);
    let z = cell.z.node + comptime!(c >> 2);
    let dense = x + cell.side * (y + cell.side * z);
    let hash = (part(cell, x, 0u32) ^ part(cell, y, 1u32) ^ part(cell, z, 2u32)) & cell.mask;
    (cell.first + select(cell.hashed, hash, dense)) as usize
}

/// What a node's position along an axis adds to its hash: `Hash::part`.
#[cube]
fn part(cell: &Cell, node: u32, #[comptime] axis: u32) -> u32 {
    let shift = cell.block_shift;
    let block = node >> shift;
    let within = node - (block << shift);
    ((block * comptime!(PRIMES[axis as usize])) << (shift * 3u32)) | (within << (shift * axis))
}

#[cube]
fn lerp(a: Pair, b: Pair, w: Pair) -> Pair {
    a + w * (b - a)
}

/// Both features of the cell at the point, and their derivatives by it. The table is `[entries]`.
#[cube]
pub fn blend<E: Entries>(cell: &Cell, table: &[E::Word]) -> Blend {
    let c0 = E::entry(table, entry(cell, 0u32));
    let c1 = E::entry(table, entry(cell, 1u32));
    let c2 = E::entry(table, entry(cell, 2u32));
    let c3 = E::entry(table, entry(cell, 3u32));
    let c4 = E::entry(table, entry(cell, 4u32));
    let c5 = E::entry(table, entry(cell, 5u32));
    let c6 = E::entry(table, entry(cell, 6u32));
    let c7 = E::entry(table, entry(cell, 7u32));
    let wx = Pair::new(cell.x.weight);
    let wy = Pair::new(cell.y.weight);
    let wz = Pair::new(cell.z.weight);
    let (e0, e1) = (lerp(c0, c1, wx), lerp(c2, c3, wx));
    let (e2, e3) = (lerp(c4, c5, wx), lerp(c6, c7, wx));
    let (near, far) = (lerp(e0, e1, wy), lerp(e2, e3, wy));
    let along_x = lerp(lerp(c1 - c0, c3 - c2, wy), lerp(c5 - c4, c7 - c6, wy), wz);
    let along_y = lerp(e1 - e0, e3 - e2, wz);
    Blend {
        value: lerp(near, far, wz),
        x: along_x * Pair::new(cell.x.slope),
        y: along_y * Pair::new(cell.y.slope),
        z: (far - near) * Pair::new(cell.z.slope),
    }
}

/// The gradients of one feature of a cell at a point, and of its derivatives by the position.
#[derive(CubeType, Clone, Copy)]
pub struct FeatureGradient {
    /// Of the feature.
    pub value: f32,
    /// Of its derivative along x.
    pub x: f32,
    /// Along y.
    pub y: f32,
    /// Along z.
    pub z: f32,
}

/// Adds the gradients of a cell's value and derivatives to its corners' entries of `grad`, of one of both features.
///
/// A thread takes one: its neighbour takes the other in the same instruction, and memory that adds by lines is asked
/// once for both.
#[cube]
pub fn scatter<A: AtomicSum>(
    grad: &[Atomic<A::Word>],
    cell: &Cell,
    feature: usize,
    d: &FeatureGradient,
) {
    #[unroll]
    for c in 0..8u32 {
        let (ux, uy, uz) = comptime!((c & 1 == 1, c >> 1 & 1 == 1, c >> 2 == 1));
        let (x, dx) = factor(&cell.x, ux);
        let (y, dy) = factor(&cell.y, uy);
        let (z, dz) = factor(&cell.z, uz);
        let sum =
            x * (y * z) * d.value + dx * (y * z) * d.x + dy * (x * z) * d.y + dz * (x * y) * d.z;
        A::add(&grad[entry(cell, c) * 2 + feature], sum);
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
