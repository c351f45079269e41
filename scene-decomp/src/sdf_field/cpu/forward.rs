//! Forward: tiles of points in parallel.

use std::sync::Arc;

use hashgrid::{GridLayout, cpu as grid};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use tensor_slices::{Scratch, Stopwatch};

use super::passes::{Computed, Passes, Recording};
use super::tape::{Tape, TapedRows};
use super::weights::Weights;
use crate::sdf_field::{Forward, Normal, SdfFieldConfig};
use crate::tile::transpose::{rows_to_tile, tile_to_rows};
use crate::tile::{GRAIN, POINTS, activation, layer};

/// Tiles that one task of an evaluation takes at least: callers ask about a few at a time, in tasks of their own.
const TILES_PER_TASK: usize = 4;

/// Whether a forward pass is to be followed by a backward one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Keep {
    Nothing,
    ForBackward,
}

/// Time spent in forward passes that no backward follows, and in those that go on tape, which many threads do at once.
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
    /// Shared with the table's gradient, which is added up after backward has returned.
    pub(super) passes: Arc<Passes>,
}

/// What a tile consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    fn of(weights: &Weights, config: &SdfFieldConfig) -> Self {
        Self {
            inputs: weights.inputs,
            hidden: weights.hidden,
            normal: config.normal,
        }
    }

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

    /// Rows of `points` values each.
    #[inline(always)]
    fn rows_mut(self, tile: &mut [f32], points: usize) -> TileMut<'_> {
        let (input, rest) = tile.split_at_mut(self.inputs * points);
        let (jacobian, rest) = rest.split_at_mut(self.rows_of_jacobian() * points);
        let a = &mut rest[..self.hidden * points];
        TileMut { input, jacobian, a }
    }

    /// Values of a tile's places, and of what backward leaves beside them for the table.
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
    let kind = TileKind::of(&weights, config);
    let tile_len = kind.len();
    match keep {
        Keep::Nothing => {
            let columns = weights.columns();
            points
                .par_chunks(3 * POINTS)
                .zip(out.par_chunks_mut(columns * POINTS))
                .with_min_len(TILES_PER_TASK)
                .for_each_init(
                    || (Scratch::new(tile_len), WorkingRoom::new(&weights)),
                    |(tile, working), (points, out)| {
                        Arch::new().dispatch(ForwardTile {
                            points,
                            table,
                            weights: &weights,
                            config,
                            layout,
                            kind,
                            // Nobody reads what lies behind the last point.
                            lanes: (points.len() / 3).next_multiple_of(GRAIN),
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
                    || (Scratch::new(tile_len), WorkingRoom::new(&weights)),
                    |(tile, working), (((points, out), saved), places)| {
                        Arch::new().dispatch(ForwardTile {
                            points,
                            table,
                            weights: &weights,
                            config,
                            layout,
                            kind,
                            lanes: POINTS,
                            tile,
                            working,
                            out,
                        });
                        // Row by row in its place, it would fetch lines of cache only to overwrite
                        // them, beside those that the encoding waits for.
                        saved.copy_from_slice(tile);
                        let rows = working.rows_mut(&weights, POINTS);
                        let (unit, g) = places.split_at_mut(3 * POINTS);
                        unit.copy_from_slice(rows.unit);
                        if kind.normal == Normal::Computed {
                            g.copy_from_slice(&rows.g[3 * POINTS..]);
                        }
                    },
                );
            let recording = Recording::of(kind, n, tiles, places);
            let saved = Saved {
                config: config.clone(),
                weights,
                table_len,
                passes: Arc::new(Passes::of(recording)),
            };
            (out, Some(saved))
        }
    }
}

/// [`forward`] by one thread, which writes what backward needs down on `tape`.
pub(crate) fn forward_to_tape(
    points: &[f32],
    table: &[f32],
    weights: &Weights,
    config: &SdfFieldConfig,
    tape: &Tape,
) -> Vec<f32> {
    let _lap = EVALUATION.lap();
    let layout = &config.active_layout();
    let table = &table[..2 * layout.entries()];
    let columns = weights.columns();
    let mut out = vec![0.0; points.len() / 3 * columns];
    let kind = TileKind::of(weights, config);
    let (mut tile, mut working) = (Scratch::new(kind.len()), WorkingRoom::new(weights));
    let tiles = points.chunks(3 * POINTS);
    for (points, out) in tiles.zip(out.chunks_mut(columns * POINTS)) {
        let count = points.len() / 3;
        let lanes = count.next_multiple_of(GRAIN);
        Arch::new().dispatch(ForwardTile {
            points,
            table,
            weights,
            config,
            layout,
            kind,
            lanes,
            tile: &mut tile,
            working: &mut working,
            out,
        });
        let rows = working.rows_mut(weights, lanes);
        let computed = Computed {
            tile: &tile[..kind.len() / POINTS * lanes],
            unit: rows.unit,
            g: match kind.normal {
                Normal::Computed => &rows.g[3 * lanes..],
                Normal::Zero => &[],
            },
            lanes,
        };
        tape.append(kind, &computed, count, out);
    }
    out
}

/// [`forward`] of rows that are on tapes already, of the same weights and table, for backward.
pub(crate) fn forward_from_tape(
    rows: &TapedRows,
    table_len: usize,
    weights: Weights,
    config: &SdfFieldConfig,
) -> (Vec<f32>, Saved) {
    let _lap = FORWARD.lap();
    let out = rows.out(weights.columns());
    let passes = rows.passes(TileKind::of(&weights, config));
    let saved = Saved {
        // The passes hold the tapes.
        config: SdfFieldConfig {
            forward: Forward::Alone,
            ..config.clone()
        },
        weights,
        table_len,
        passes: Arc::new(passes),
    };
    (out, saved)
}

/// Room for one tile's intermediate rows that backward does not ask for: each is written before it is read.
struct WorkingRoom(Scratch);

/// These rows.
struct Working<'a> {
    /// Positions in the grid, in `[0, 1]`.
    unit: &'a mut [f32],
    z: &'a mut [f32],
    /// Derivative of the hidden layer by `z`.
    slope: &'a mut [f32],
    /// The sdf's derivative by `z`.
    u: &'a mut [f32],
    /// The sdf's derivative by the input.
    g: &'a mut [f32],
    out: &'a mut [f32],
}

impl WorkingRoom {
    fn new(weights: &Weights) -> Self {
        let rows: usize = Self::counts(weights).iter().sum();
        Self(Scratch::new(rows * POINTS))
    }

    fn counts(weights: &Weights) -> [usize; 6] {
        let (inputs, hidden) = (weights.inputs, weights.hidden);
        [3, hidden, hidden, hidden, inputs, weights.columns()]
    }

    /// Rows of `points` values each.
    fn rows_mut(&mut self, weights: &Weights, points: usize) -> Working<'_> {
        let mut rest = &mut *self.0;
        let [unit, z, slope, u, g, out] = Self::counts(weights).map(|count| {
            let (rows, behind) = std::mem::take(&mut rest).split_at_mut(count * points);
            rest = behind;
            rows
        });
        Working {
            unit,
            z,
            slope,
            u,
            g,
            out,
        }
    }
}

/// `u = w2 * slope`, the sdf's derivative by `z`.
#[inline(always)]
pub(super) fn slope_of_hidden(weights: &Weights, points: usize, slope: &[f32], u: &mut [f32]) {
    for ((u, slope), &w) in u
        .chunks_exact_mut(points)
        .zip(slope.chunks_exact(points))
        .zip(&weights.w2)
    {
        for (u, slope) in u.iter_mut().zip(slope) {
            *u = w * slope;
        }
    }
}

/// `n = g_p + J^T g_h` for the tile; `scale` is that of the grid's unit to the points' own.
#[inline(always)]
fn normal_of_tile(g: &[f32], jacobian: &[f32], scale: f32, points: usize, normal: &mut [f32]) {
    for (axis, n) in normal.chunks_exact_mut(points).enumerate() {
        n.fill(0.0);
        for (k, g) in g[3 * points..].chunks_exact(points).enumerate() {
            let j = &jacobian[(3 * k + axis) * points..(3 * k + axis + 1) * points];
            for ((n, g), j) in n.iter_mut().zip(g).zip(j) {
                *n += g * j;
            }
        }
        let direct = &g[axis * points..(axis + 1) * points];
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
    /// Values of a row: the tile's points, rounded up.
    lanes: usize,
    tile: &'a mut [f32],
    working: &'a mut WorkingRoom,
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
            lanes,
            ..
        } = self;
        let Working {
            unit,
            z,
            slope,
            u,
            g,
            out,
        } = working.rows_mut(weights, lanes);
        let TileMut { input, jacobian, a } = self.kind.rows_mut(self.tile, lanes);
        rows_to_tile(self.points, 3, &mut input[..3 * lanes]);
        let scale = 0.5 / config.half_side;
        for (unit, p) in unit.iter_mut().zip(&input[..3 * lanes]) {
            *unit = p * scale + 0.5;
        }
        let wants_normal = config.normal == Normal::Computed;
        let wanted = wants_normal.then_some(&mut *jacobian);
        encode(
            self.layout,
            self.table,
            unit,
            &mut input[3 * lanes..],
            wanted,
        );
        layer::forward_of(simd, lanes, &weights.w1, Some(&weights.b1), input, z);
        activation::softplus(simd, config.beta, z, a, slope);
        if wants_normal {
            slope_of_hidden(weights, lanes, slope, u);
            layer::forward_of(simd, lanes, &weights.w1_transposed, None, u, g);
        }
        let (values, normal) = out.split_at_mut(weights.outputs * lanes);
        layer::forward_of(simd, lanes, &weights.w2, Some(&weights.b2), a, values);
        if wants_normal {
            normal_of_tile(g, jacobian, scale, lanes, normal);
        } else {
            normal.fill(0.0);
        }
        tile_to_rows(out, weights.columns(), self.out);
    }
}

/// Encodes the tile's unit positions `[3, points]`; `layout` and `table` end with the active levels.
#[inline(always)]
fn encode(
    layout: &GridLayout,
    table: &[f32],
    unit: &[f32],
    values: &mut [f32],
    jacobian: Option<&mut [f32]>,
) {
    let (x, yz) = unit.split_at(unit.len() / 3);
    let (y, z) = yz.split_at(x.len());
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
