//! Forward: tiles of points in parallel.

use std::sync::Arc;

use pulp::Arch;
use rayon::prelude::*;
use tensor_slices::{Scratch, Stopwatch};

use super::by_levels;
use super::forward_tile::{Field, ForwardTile, WorkingRoom};
use super::passes::{Computed, Passes, Recording};
use super::tape::{Tape, TapedRows};
use super::weights::Weights;
use crate::sdf_field::{Forward, Normal, SdfFieldConfig};
use crate::tile::{GRAIN, POINTS};

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
pub(super) struct TileMut<'a> {
    pub(super) input: &'a mut [f32],
    pub(super) jacobian: &'a mut [f32],
    pub(super) a: &'a mut [f32],
}

impl TileKind {
    pub(super) fn of(weights: &Weights, config: &SdfFieldConfig) -> Self {
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
    pub(super) fn rows_mut(self, tile: &mut [f32], points: usize) -> TileMut<'_> {
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
    let layout = &config.active_layout();
    let field = Field::of(table, &weights, config, layout);
    let (kind, columns) = (field.kind, weights.columns());
    let mut out = vec![0.0; n * columns];
    match keep {
        Keep::Nothing => {
            points
                .par_chunks(3 * POINTS)
                .zip(out.par_chunks_mut(columns * POINTS))
                .with_min_len(TILES_PER_TASK)
                .for_each_init(
                    || (Scratch::new(kind.len()), WorkingRoom::new(&weights)),
                    |(tile, working), (points, out)| {
                        Arch::new().dispatch(ForwardTile {
                            field,
                            points,
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
            let tile_count = n.div_ceil(POINTS);
            let mut tiles = Scratch::new(tile_count * kind.len());
            let mut places = Scratch::new(tile_count * kind.len_of_places());
            if by_levels::pays(layout, n) {
                by_levels::forward(field, points, &mut tiles, &mut places, &mut out);
            } else {
                by_tiles(field, points, &mut tiles, &mut places, &mut out);
            }
            let recording = Recording::of(kind, n, tiles, places);
            let saved = Saved {
                config: config.clone(),
                weights,
                table_len: table.len(),
                passes: Arc::new(Passes::of(recording)),
            };
            (out, Some(saved))
        }
    }
}

/// All levels and layers of one tile, then those of the next.
pub(super) fn by_tiles(
    field: Field<'_>,
    points: &[f32],
    tiles: &mut [f32],
    places: &mut [f32],
    out: &mut [f32],
) {
    let (kind, weights) = (field.kind, field.weights);
    points
        .par_chunks(3 * POINTS)
        .zip(out.par_chunks_mut(weights.columns() * POINTS))
        .zip(tiles.par_chunks_mut(kind.len()))
        .zip(places.par_chunks_mut(kind.len_of_places()))
        .for_each_init(
            || (Scratch::new(kind.len()), WorkingRoom::new(weights)),
            |(tile, working), (((points, out), saved), places)| {
                Arch::new().dispatch(ForwardTile {
                    field,
                    points,
                    // Lanes past the last point enter sums with a zero weight and must be finite: they repeat it.
                    lanes: POINTS,
                    tile,
                    working,
                    out,
                });
                // Row by row in its place, it would fetch lines of cache only to overwrite them, beside those that
                // the encoding waits for. Not past the caches: they hold so few tiles until backward.
                let rows = working.rows_mut(weights, POINTS);
                let (unit, g) = places.split_at_mut(3 * POINTS);
                saved.copy_from_slice(tile);
                unit.copy_from_slice(rows.unit);
                if kind.normal == Normal::Computed {
                    g.copy_from_slice(&rows.g[3 * POINTS..]);
                }
            },
        );
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
    let field = Field::of(table, weights, config, layout);
    let (kind, columns) = (field.kind, weights.columns());
    let mut out = vec![0.0; points.len() / 3 * columns];
    let (mut tile, mut working) = (Scratch::new(kind.len()), WorkingRoom::new(weights));
    let tiles = points.chunks(3 * POINTS);
    for (points, out) in tiles.zip(out.chunks_mut(columns * POINTS)) {
        let count = points.len() / 3;
        let lanes = count.next_multiple_of(GRAIN);
        Arch::new().dispatch(ForwardTile {
            field,
            points,
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
