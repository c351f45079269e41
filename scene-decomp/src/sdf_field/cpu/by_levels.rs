//! Forward for very many points: one level of the grid at a time for all of them, then the layers.
//!
//! A tile by itself asks for lines of every level, a table of which does not fit the caches: they come from memory, in no
//! order. A level does fit. Read from end to end first, it has its lines in the caches for all tiles, at the price of
//! writing features down and reading them again, which a pass that backward follows does anyway. The values have the same
//! bits.

use hashgrid::{GridLayout, cpu as grid};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use tensor_slices::{Scratch, copy_past_caches};

use super::forward::TileMut;
use super::forward_tile::{Field, WorkingRoom, axes, layers, set_out};
use crate::sdf_field::Normal;
use crate::tile::POINTS;

/// Entries of the largest level for each point, up to which it pays to read that level from end to end. Measured with 2^19
/// entries: the way by tiles is as fast with some 9000 points.
const ENTRIES_PER_POINT: usize = 48;
/// Levels that threads are at, at a time: the caches that they share have room for these, 16 MiB with 2^19 entries, however
/// many threads there are. One at a time has two threads wait for each other (forward, 16 384 points: 7.1 to 8.1 ms instead
/// of 5.1 to 5.9).
const LEVELS_AT_ONCE: usize = 4;
/// Tiles that one task takes at least on a level.
const TILES_PER_TASK: usize = 8;
/// Values of a level that one task reads: 256 KiB.
const FETCHED_PER_TASK: usize = 1 << 16;

/// Whether `points` points are enough for it.
pub(super) fn pays(layout: &GridLayout, points: usize) -> bool {
    let largest = layout.levels.iter().map(|level| level.entries).max();
    points * ENTRIES_PER_POINT >= largest.unwrap_or(0)
}

/// One level's rows of one tile.
struct LevelRows<'a> {
    /// Positions in the grid, in `[0, 1]`, `[3, POINTS]`.
    unit: &'a [f32],
    /// `[2, POINTS]`.
    values: &'a mut [f32],
    /// `[2, 3, POINTS]`; none without normals.
    jacobian: Option<&'a mut [f32]>,
}

/// Fills `out`, and what backward needs: see [`super::forward::forward`].
pub(super) fn forward(
    field: Field<'_>,
    points: &[f32],
    tiles: &mut [f32],
    places: &mut [f32],
    out: &mut [f32],
) {
    let (kind, weights) = (field.kind, field.weights);
    tiles
        .par_chunks_mut(kind.len())
        .zip(places.par_chunks_mut(kind.len_of_places()))
        .zip(points.par_chunks(3 * POINTS))
        .for_each(|((tile, places), points)| {
            let input = kind.rows_mut(tile, POINTS).input;
            set_out(
                field,
                points,
                &mut input[..3 * POINTS],
                &mut places[..3 * POINTS],
            );
        });
    encode(field, tiles, places);
    tiles
        .par_chunks_mut(kind.len())
        .zip(places.par_chunks_mut(kind.len_of_places()))
        .zip(out.par_chunks_mut(weights.columns() * POINTS))
        .for_each_init(
            || {
                (
                    Scratch::new(weights.hidden * POINTS),
                    WorkingRoom::new(weights),
                )
            },
            |(a, working), ((tile, places), out)| {
                Arch::new().dispatch(Layers {
                    field,
                    tile,
                    places,
                    a,
                    working,
                    out,
                });
            },
        );
}

/// Features of all tiles, level by level.
fn encode(field: Field<'_>, tiles: &mut [f32], places: &[f32]) {
    let kind = field.kind;
    let count = tiles.len() / kind.len();
    let mut levels: Vec<Vec<LevelRows<'_>>> = Vec::new();
    levels.resize_with(field.layout.levels.len(), || Vec::with_capacity(count));
    let places = places.chunks_exact(kind.len_of_places());
    for (tile, places) in tiles.chunks_exact_mut(kind.len()).zip(places) {
        let TileMut {
            input, jacobian, ..
        } = kind.rows_mut(tile, POINTS);
        let values = input[3 * POINTS..].chunks_exact_mut(2 * POINTS);
        let mut jacobians = jacobian.chunks_exact_mut(6 * POINTS);
        for (level, values) in levels.iter_mut().zip(values) {
            level.push(LevelRows {
                unit: &places[..3 * POINTS],
                values,
                jacobian: jacobians.next(),
            });
        }
    }
    for (group, levels) in levels.chunks_mut(LEVELS_AT_ONCE).enumerate() {
        levels
            .par_iter_mut()
            .with_max_len(1)
            .enumerate()
            .for_each(|(level, tiles)| {
                encode_all(field, group * LEVELS_AT_ONCE + level, tiles);
            });
    }
}

/// One level of all tiles.
fn encode_all(field: Field<'_>, level: usize, tiles: &mut [LevelRows<'_>]) {
    grid::level_values(field.layout, level, field.table)
        .par_chunks(FETCHED_PER_TASK)
        .for_each(grid::fetch);
    tiles
        .par_iter_mut()
        .with_min_len(TILES_PER_TASK)
        .for_each_init(
            || Scratch::new(8 * POINTS),
            |room, rows| encode_rows(field, level, room, rows),
        );
}

/// One level of one tile, by way of `room`, which stays in the cache.
fn encode_rows(field: Field<'_>, level: usize, room: &mut [f32], rows: &mut LevelRows<'_>) {
    let (values, jacobian) = room.split_at_mut(2 * POINTS);
    let wanted = rows.jacobian.is_some().then_some(&mut *jacobian);
    grid::encode_level(
        field.layout,
        level,
        field.table,
        axes(rows.unit),
        values,
        wanted,
    );
    match &mut rows.jacobian {
        Some(to) => copy_past_caches([(rows.values, values), (to, jacobian)]),
        None => copy_past_caches([(rows.values, values)]),
    }
}

/// What follows the encoding of a tile.
struct Layers<'a> {
    field: Field<'a>,
    tile: &'a mut [f32],
    places: &'a mut [f32],
    /// Room for the hidden layer.
    a: &'a mut [f32],
    working: &'a mut WorkingRoom,
    out: &'a mut [f32],
}

impl WithSimd for Layers<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            field, a, working, ..
        } = self;
        let rows = field.kind.rows_mut(self.tile, POINTS);
        let room = working.rows_mut(field.weights, POINTS);
        layers(
            simd,
            field,
            POINTS,
            rows.input,
            rows.jacobian,
            a,
            room,
            self.out,
        );
        copy_past_caches([(rows.a, a)]);
        if field.kind.normal == Normal::Computed {
            let g = working.rows_mut(field.weights, POINTS).g;
            copy_past_caches([(&mut self.places[3 * POINTS..], &g[3 * POINTS..])]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hashgrid::GridConfig;

    use super::*;
    use crate::sdf_field::SdfFieldConfig;
    use crate::sdf_field::cpu::forward::{Keep, by_tiles};
    use crate::sdf_field::cpu::weights::Weights;

    fn numbers(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        (0..count)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 23) as f32 - 1.0
            })
            .collect()
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    /// With dense and hashed levels, some not in use, and a last tile that is not full.
    #[test]
    fn what_it_leaves_has_the_bits_of_the_way_by_tiles() {
        let grid = GridConfig {
            levels: 6,
            finest_resolution: 128,
            log2_table_size: 12,
            ..GridConfig::default()
        };
        for (normal, active_levels) in [
            (Normal::Computed, 5),
            (Normal::Zero, 6),
            (Normal::Computed, 0),
        ] {
            let config = SdfFieldConfig {
                layout: Arc::new(GridLayout::new(&grid)),
                active_levels,
                half_side: 1.5,
                beta: 100.0,
                normal,
                sparse: None,
                forward: crate::sdf_field::Forward::Alone,
            };
            let (hidden, outputs) = (10, 3);
            let weights = Weights::new(
                &config,
                &numbers(hidden * 15, 1),
                &numbers(hidden, 2),
                &numbers(outputs * hidden, 3),
                &numbers(outputs, 4),
                Keep::ForBackward,
            );
            let (n, tiles) = (300, 3);
            let points: Vec<f32> = numbers(3 * n, 5).iter().map(|p| 1.6 * p).collect();
            let table = numbers(2 * config.layout.entries(), 6);
            let layout = config.active_layout();
            assert!(pays(&layout, n), "else forward would not come here");
            let field = Field::of(&table, &weights, &config, &layout);
            type Way = fn(Field<'_>, &[f32], &mut [f32], &mut [f32], &mut [f32]);
            let run = |way: Way| {
                // Room is handed out with what was in it.
                let mut saved = vec![f32::NAN; tiles * field.kind.len()];
                let mut places = vec![f32::NAN; tiles * field.kind.len_of_places()];
                let mut out = vec![f32::NAN; n * weights.columns()];
                way(field, &points, &mut saved, &mut places, &mut out);
                [bits(&saved), bits(&places), bits(&out)]
            };
            assert_eq!(run(forward), run(by_tiles));
        }
    }
}
