//! What forward passes leave behind for a backward one, tile by tile.

use std::sync::Arc;

use tensor_slices::Scratch;

use super::forward::{Tile, TileKind};
use crate::tile::POINTS;
use crate::tile::transpose::rows_to_tile_padded;

/// Tiles of a buffer that fills up bit by bit. Many tapes are written at once, most of them short.
const TILES_PER_BUFFER: usize = 2;
/// A lane that backward is not asked about.
const NO_ROW: u32 = u32::MAX;

/// Tiles of one kind, each full but the last.
#[derive(Debug)]
pub(super) struct Recording {
    pub(super) kind: TileKind,
    pub(super) points: usize,
    tiles_per_buffer: usize,
    buffers: Vec<Buffer>,
}

/// Some tiles, one after the other.
#[derive(Debug)]
struct Buffer {
    /// [`Tile`]s.
    tiles: Scratch,
    /// For each of them `[3 + features, POINTS]`: positions in the grid, in `[0, 1]`, and the sdf's derivative
    /// by the features, for the normal. By these the table's gradient finds its way.
    places: Scratch,
}

/// A tile that was computed, and what belongs to it: rows of `lanes` values.
pub(super) struct Computed<'a> {
    pub(super) tile: &'a [f32],
    pub(super) unit: &'a [f32],
    /// The sdf's derivative by the features; empty without normals.
    pub(super) g: &'a [f32],
    pub(super) lanes: usize,
}

impl Recording {
    /// Of passes that are still to come.
    pub(super) fn new(kind: TileKind) -> Self {
        Self {
            kind,
            points: 0,
            tiles_per_buffer: TILES_PER_BUFFER,
            buffers: Vec::new(),
        }
    }

    /// Of a pass over `points` points, whose tiles and places are these.
    pub(super) fn of(kind: TileKind, points: usize, tiles: Scratch, places: Scratch) -> Self {
        Self {
            kind,
            points,
            tiles_per_buffer: points.div_ceil(POINTS).max(1),
            buffers: vec![Buffer { tiles, places }],
        }
    }

    fn tiles(&self) -> usize {
        self.points.div_ceil(POINTS)
    }

    /// Appends the first `count` points of a tile.
    pub(super) fn append(&mut self, computed: &Computed<'_>, count: usize) {
        let mut from = 0;
        while from < count {
            let (tile, lane) = (self.points / POINTS, self.points % POINTS);
            let (number, within) = (tile / TILES_PER_BUFFER, tile % TILES_PER_BUFFER);
            let (len, places_len) = (self.kind.len(), self.kind.len_of_places());
            if number == self.buffers.len() {
                self.buffers.push(Buffer {
                    tiles: Scratch::new(TILES_PER_BUFFER * len),
                    places: Scratch::new(TILES_PER_BUFFER * places_len),
                });
            }
            let buffer = &mut self.buffers[number];
            let tile = &mut buffer.tiles[within * len..(within + 1) * len];
            let places = &mut buffer.places[within * places_len..(within + 1) * places_len];
            let (unit, g) = places.split_at_mut(3 * POINTS);
            let fits = (count - from).min(POINTS - lane);
            for (to, rows) in [
                (tile, computed.tile),
                (unit, computed.unit),
                (g, computed.g),
            ] {
                let rows = rows.chunks_exact(computed.lanes);
                for (to, row) in to.chunks_exact_mut(POINTS).zip(rows) {
                    to[lane..lane + fits].copy_from_slice(&row[from..from + fits]);
                }
            }
            self.points += fits;
            from += fits;
        }
    }

    /// Lanes past the last point enter sums with a zero weight and must be finite.
    pub(super) fn pad(&mut self) {
        let (last, count) = (self.points / POINTS, self.points % POINTS);
        if count == 0 {
            return;
        }
        let (len, within) = (self.kind.len(), last % self.tiles_per_buffer);
        let buffer = &mut self.buffers[last / self.tiles_per_buffer];
        let tile = &mut buffer.tiles[within * len..(within + 1) * len];
        for row in tile.chunks_exact_mut(POINTS) {
            row[count..].fill(0.0);
        }
    }

    fn tile(&self, tile: usize) -> &[f32] {
        let (len, within) = (self.kind.len(), tile % self.tiles_per_buffer);
        &self.buffers[tile / self.tiles_per_buffer].tiles[within * len..(within + 1) * len]
    }

    fn place(&self, tile: usize) -> &[f32] {
        let (len, within) = (self.kind.len_of_places(), tile % self.tiles_per_buffer);
        &self.buffers[tile / self.tiles_per_buffer].places[within * len..(within + 1) * len]
    }
}

/// The passes that one backward pass follows: an op's own, or those of tapes.
#[derive(Debug)]
pub(super) struct Passes {
    pub(super) kind: TileKind,
    recordings: Vec<Arc<Recording>>,
    /// Of each tile: its recording, and its number there.
    tiles: Vec<(usize, usize)>,
    /// The op's row of each lane of all tiles; `None` where rows and lanes have the same order.
    row_of_lane: Option<Vec<u32>>,
}

impl Passes {
    /// One whose rows are in order.
    pub(super) fn of(recording: Recording) -> Self {
        Self {
            kind: recording.kind,
            tiles: (0..recording.tiles()).map(|tile| (0, tile)).collect(),
            recordings: vec![Arc::new(recording)],
            row_of_lane: None,
        }
    }

    /// Those of tapes: row `i` is the point `rows[i].1` of recording `rows[i].0`.
    pub(super) fn taped(
        kind: TileKind,
        recordings: Vec<Arc<Recording>>,
        rows: &[(u32, u32)],
    ) -> Self {
        let mut firsts = Vec::with_capacity(recordings.len());
        let mut tiles = Vec::new();
        for (number, recording) in recordings.iter().enumerate() {
            firsts.push(tiles.len());
            tiles.extend((0..recording.tiles()).map(|tile| (number, tile)));
        }
        let mut row_of_lane = vec![NO_ROW; POINTS * tiles.len()];
        for (row, (of, point)) in rows.iter().enumerate() {
            let lane = &mut row_of_lane[POINTS * firsts[*of as usize] + *point as usize];
            assert_eq!(*lane, NO_ROW, "TapedRows: a point is learnt from twice");
            *lane = row as u32;
        }
        Self {
            kind,
            recordings,
            tiles,
            row_of_lane: Some(row_of_lane),
        }
    }

    /// Number of tiles.
    pub(super) fn tiles(&self) -> usize {
        self.tiles.len()
    }

    /// Points on all tiles.
    pub(super) fn points(&self) -> usize {
        self.recordings.iter().map(|of| of.points).sum()
    }

    /// Points on a tile, which are its first lanes.
    pub(super) fn points_on(&self, tile: usize) -> usize {
        let (of, tile) = self.tiles[tile];
        POINTS.min(self.recordings[of].points - tile * POINTS)
    }

    pub(super) fn tile(&self, tile: usize) -> Tile<'_> {
        let (of, tile) = self.tiles[tile];
        self.kind.rows(self.recordings[of].tile(tile))
    }

    /// `[3 + features, POINTS]`: positions in the grid, in `[0, 1]`, and the sdf's derivative by the features.
    pub(super) fn place(&self, tile: usize) -> &[f32] {
        let (of, tile) = self.tiles[tile];
        self.recordings[of].place(tile)
    }

    /// Fills `to: [width, POINTS]` with those rows of a gradient `[n, width]` that belong to a tile, and zeros
    /// where there is none.
    #[inline(always)]
    pub(super) fn gradient_of_tile(&self, tile: usize, grad: &[f32], width: usize, to: &mut [f32]) {
        let first = POINTS * tile;
        let Some(row_of_lane) = &self.row_of_lane else {
            let end = first + self.points_on(tile);
            return rows_to_tile_padded(&grad[width * first..width * end], width, to);
        };
        to.fill(0.0);
        for (lane, &row) in row_of_lane[first..first + POINTS].iter().enumerate() {
            if row != NO_ROW {
                let row = &grad[width * row as usize..width * (row as usize + 1)];
                for (k, value) in row.iter().enumerate() {
                    to[k * POINTS + lane] = *value;
                }
            }
        }
    }
}
