//! Forward: tiles of points in parallel.

use std::sync::Arc;

use hashgrid::{GridLayout, cpu as grid};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use tensor_slices::{Scratch, Stopwatch};

use super::weights::Weights;
use crate::sdf_field::{Normal, SdfFieldConfig};
use crate::tile::transpose::{rows_to_tile, tile_to_rows};
use crate::tile::{POINTS, activation, layer};

/// Whether a forward pass is to be followed by a backward one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Keep {
    Nothing,
    ForBackward,
}

/// Time spent in forward passes that no backward follows.
pub static EVALUATION: Stopwatch = Stopwatch::new();
/// Time spent in forward passes that a backward follows.
pub static FORWARD: Stopwatch = Stopwatch::new();

/// What backward needs.
#[derive(Debug)]
#[allow(unreachable_pub)] // an associated type of a public backend must be public
pub struct Saved {
    pub(super) config: SdfFieldConfig,
    pub(super) weights: Weights,
    pub(super) table_len: usize,
    pub(super) kind: TileKind,
    /// One [`Tile`] after the other.
    pub(super) tiles: Scratch,
    /// Shared with the table's gradient, which is added up after backward has returned.
    pub(super) places: Arc<Places>,
}

/// Where the table's gradient goes to, tile by tile.
#[derive(Debug)]
pub(super) struct Places {
    pub(super) points: usize,
    pub(super) kind: TileKind,
    /// For each tile `[3 + features, POINTS]`: positions in the grid, in `[0, 1]`, and the sdf's derivative
    /// by the features, for the normal.
    pub(super) tiles: Scratch,
}

/// What a tile consists of.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileKind {
    /// Inputs of the MLP.
    pub(super) inputs: usize,
    /// Width of its hidden layer.
    pub(super) hidden: usize,
    pub(super) normal: Normal,
}

/// A tile's rows, each of [`POINTS`] values.
pub(super) struct Tile<'a> {
    /// The MLP's input.
    pub(super) input: &'a [f32],
    /// Of h by the unit positions: 3 for each feature; none without normals.
    pub(super) jacobian: &'a [f32],
    /// The hidden layer.
    pub(super) a: &'a [f32],
}

/// The same to be written.
struct TileMut<'a> {
    input: &'a mut [f32],
    jacobian: &'a mut [f32],
    a: &'a mut [f32],
}

impl TileKind {
    /// Features of the grid.
    pub(super) fn features(self) -> usize {
        self.inputs - 3
    }

    /// Values of a tile.
    pub(super) fn len(self) -> usize {
        (self.inputs + self.rows_of_jacobian() + self.hidden) * POINTS
    }

    fn rows_of_jacobian(self) -> usize {
        match self.normal {
            Normal::Computed => 3 * self.features(),
            Normal::Zero => 0,
        }
    }

    #[inline(always)]
    pub(super) fn rows(self, tile: &[f32]) -> Tile<'_> {
        let (input, rest) = tile.split_at(self.inputs * POINTS);
        let (jacobian, a) = rest.split_at(self.rows_of_jacobian() * POINTS);
        Tile { input, jacobian, a }
    }

    #[inline(always)]
    fn rows_mut(self, tile: &mut [f32]) -> TileMut<'_> {
        let (input, rest) = tile.split_at_mut(self.inputs * POINTS);
        let (jacobian, a) = rest.split_at_mut(self.rows_of_jacobian() * POINTS);
        TileMut { input, jacobian, a }
    }

    /// Values of a tile of [`Places`], and of what backward leaves beside it for the table.
    pub(super) fn len_of_places(self) -> usize {
        (3 + self.features()) * POINTS
    }
}

/// Sdf, feature and normal of `points [n, 3]`: `[n, 1 + G + 3]`.
pub(crate) fn forward(
    points: &[f32],
    table: &[f32],
    weights: Weights,
    config: &SdfFieldConfig,
    keep: Keep,
) -> (Vec<f32>, Option<Saved>) {
    let _lap = match keep {
        Keep::Nothing => EVALUATION.lap(),
        Keep::ForBackward => FORWARD.lap(),
    };
    let n = points.len() / 3;
    let table_len = table.len();
    let layout = &config.active_layout();
    let table = &table[..2 * layout.entries()];
    let mut out = vec![0.0; n * weights.columns()];
    let kind = TileKind {
        inputs: weights.inputs,
        hidden: weights.hidden,
        normal: config.normal,
    };
    let tile_len = kind.len();
    match keep {
        Keep::Nothing => {
            let columns = weights.columns();
            points
                .par_chunks(3 * POINTS)
                .zip(out.par_chunks_mut(columns * POINTS))
                .for_each_init(
                    || (Scratch::new(tile_len), Working::new(&weights)),
                    |(tile, working), (points, out)| {
                        Arch::new().dispatch(ForwardTile {
                            points,
                            table,
                            weights: &weights,
                            config,
                            layout,
                            kind,
                            tile,
                            working,
                            out,
                        });
                    },
                );
            (out, None)
        }
        Keep::ForBackward => {
            // Lanes past the last point enter sums with a zero weight and must be finite: they repeat it.
            let tile_count = n.div_ceil(POINTS);
            let mut tiles = Scratch::new(tile_count * tile_len);
            let mut places = Scratch::new(tile_count * kind.len_of_places());
            let columns = weights.columns();
            points
                .par_chunks(3 * POINTS)
                .zip(out.par_chunks_mut(columns * POINTS))
                .zip(tiles.par_chunks_mut(tile_len))
                .zip(places.par_chunks_mut(kind.len_of_places()))
                .for_each_init(
                    || (Scratch::new(tile_len), Working::new(&weights)),
                    |(tile, working), (((points, out), saved), places)| {
                        Arch::new().dispatch(ForwardTile {
                            points,
                            table,
                            weights: &weights,
                            config,
                            layout,
                            kind,
                            tile,
                            working,
                            out,
                        });
                        // Row by row in its place, it would fetch lines of cache only to overwrite
                        // them, beside those that the encoding waits for.
                        saved.copy_from_slice(tile);
                        let (unit, g) = places.split_at_mut(3 * POINTS);
                        unit.copy_from_slice(&working.unit);
                        if kind.normal == Normal::Computed {
                            g.copy_from_slice(&working.g[3 * POINTS..]);
                        }
                    },
                );
            let saved = Saved {
                config: config.clone(),
                weights,
                table_len,
                kind,
                tiles,
                places: Arc::new(Places {
                    points: n,
                    kind,
                    tiles: places,
                }),
            };
            (out, Some(saved))
        }
    }
}

/// One tile's intermediate rows that backward does not ask for: each is written before it is read.
struct Working {
    /// Positions in the grid, in `[0, 1]`.
    unit: Scratch,
    z: Scratch,
    /// Derivative of the hidden layer by `z`.
    slope: Scratch,
    /// The sdf's derivative by `z`.
    u: Scratch,
    /// The sdf's derivative by the input.
    g: Scratch,
    out: Scratch,
}

impl Working {
    fn new(weights: &Weights) -> Self {
        let rows = |count: usize| Scratch::new(count * POINTS);
        Self {
            unit: rows(3),
            z: rows(weights.hidden),
            slope: rows(weights.hidden),
            u: rows(weights.hidden),
            g: rows(weights.inputs),
            out: rows(weights.outputs + 3),
        }
    }
}

/// `u = w2 * slope`, the sdf's derivative by `z`.
#[inline(always)]
pub(super) fn slope_of_hidden(weights: &Weights, slope: &[f32], u: &mut [f32]) {
    for ((u, slope), &w) in u
        .chunks_exact_mut(POINTS)
        .zip(slope.chunks_exact(POINTS))
        .zip(&weights.w2)
    {
        for (u, slope) in u.iter_mut().zip(slope) {
            *u = w * slope;
        }
    }
}

/// `n = g_p + J^T g_h` for the tile; `scale` is that of the grid's unit to the points' own.
#[inline(always)]
fn normal_of_tile(g: &[f32], jacobian: &[f32], scale: f32, normal: &mut [f32]) {
    for (axis, n) in normal.chunks_exact_mut(POINTS).enumerate() {
        n.fill(0.0);
        for (k, g) in g[3 * POINTS..].chunks_exact(POINTS).enumerate() {
            let j = &jacobian[(3 * k + axis) * POINTS..(3 * k + axis + 1) * POINTS];
            for ((n, g), j) in n.iter_mut().zip(g).zip(j) {
                *n += g * j;
            }
        }
        let direct = &g[axis * POINTS..(axis + 1) * POINTS];
        for (n, g) in n.iter_mut().zip(direct) {
            *n = g + scale * *n;
        }
    }
}

struct ForwardTile<'a> {
    points: &'a [f32],
    table: &'a [f32],
    weights: &'a Weights,
    config: &'a SdfFieldConfig,
    layout: &'a GridLayout,
    kind: TileKind,
    tile: &'a mut [f32],
    working: &'a mut Working,
    out: &'a mut [f32],
}

impl WithSimd for ForwardTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            weights,
            config,
            working,
            ..
        } = self;
        let TileMut { input, jacobian, a } = self.kind.rows_mut(self.tile);
        rows_to_tile(self.points, 3, &mut input[..3 * POINTS]);
        let scale = 0.5 / config.half_side;
        for (unit, p) in working.unit.iter_mut().zip(&input[..3 * POINTS]) {
            *unit = p * scale + 0.5;
        }
        let wanted = (config.normal == Normal::Computed).then_some(&mut *jacobian);
        encode(
            self.layout,
            self.table,
            &working.unit,
            &mut input[3 * POINTS..],
            wanted,
        );
        layer::forward(simd, &weights.w1, Some(&weights.b1), input, &mut working.z);
        activation::softplus(simd, config.beta, &working.z, a, &mut working.slope);

        let wants_normal = config.normal == Normal::Computed;
        if wants_normal {
            let Working { slope, u, g, .. } = &mut *working;
            slope_of_hidden(weights, slope, u);
            layer::forward(simd, &weights.w1_transposed, None, u, g);
        }
        let (values, normal) = working.out.split_at_mut(weights.outputs * POINTS);
        layer::forward(simd, &weights.w2, Some(&weights.b2), a, values);
        if wants_normal {
            normal_of_tile(&working.g, jacobian, scale, normal);
        } else {
            normal.fill(0.0);
        }
        tile_to_rows(&working.out, weights.columns(), self.out);
    }
}

/// Encodes the tile's unit positions `[3, POINTS]`; `layout` and `table` end with the active levels.
#[inline(always)]
fn encode(
    layout: &GridLayout,
    table: &[f32],
    unit: &[f32],
    values: &mut [f32],
    jacobian: Option<&mut [f32]>,
) {
    let (x, yz) = unit.split_at(POINTS);
    let (y, z) = yz.split_at(POINTS);
    grid::encode_tile(
        layout,
        layout.levels.len(),
        table,
        x,
        y,
        z,
        values,
        jacobian,
    );
}
