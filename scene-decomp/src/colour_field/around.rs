//! The columns around the network's outputs in rows for compositing, tile by tile.

use super::row::{LEAST_LOG_DENSITY, LENGTH_OFFSET, MOST_LOG_DENSITY, density_of, row_column};
use super::{Reading, RowConfig};
use crate::tile::POINTS;

/// The rows of a tile around the network's outputs, from its inputs `x`; afterwards the directions in
/// `x` are those that the network is to see.
#[inline(always)]
pub(super) fn surroundings(config: RowConfig, stretch: &[f32], x: &mut [f32], rows: &mut [f32]) {
    let (head, tail) = rows.split_at_mut(row_column::COLOUR * POINTS);
    let (first, slope) = head.split_at_mut(POINTS);
    let length = tail.len() - POINTS;
    let length = &mut tail[length..];
    let raw = &x[9 * POINTS..10 * POINTS];
    match config.reading {
        Reading::Distance => first.copy_from_slice(raw),
        Reading::Density => {
            for (first, raw) in first.iter_mut().zip(raw) {
                *first = density_of(*raw);
            }
            for (first, stretch) in first.iter_mut().zip(stretch) {
                *first *= stretch;
            }
        }
    }
    let row = |k: usize| &x[k * POINTS..(k + 1) * POINTS];
    let (n, v) = ([row(3), row(4), row(5)], [row(6), row(7), row(8)]);
    for p in 0..POINTS {
        slope[p] = n[0][p] * v[0][p] + n[1][p] * v[1][p] + n[2][p] * v[2][p];
        let square = n[0][p] * n[0][p] + n[1][p] * n[1][p] + n[2][p] * n[2][p];
        length[p] = (square + LENGTH_OFFSET).sqrt();
    }
    for v in &mut x[6 * POINTS..9 * POINTS] {
        *v *= config.view_share;
    }
}

/// A tile's part of the op, point-major: `[n, columns]` each.
pub(super) struct Around<'a> {
    pub(super) grad: &'a [f32],
    pub(super) rows: &'a [f32],
    pub(super) columns: usize,
    pub(super) directions: &'a [f32],
}

impl Around<'_> {
    /// Adds to `geometry` `[n, columns_of_geometry]` what comes through the columns around the colours;
    /// `x` are the network's inputs.
    #[inline(always)]
    pub(super) fn add_to(
        &self,
        config: RowConfig,
        x: &[f32],
        geometry: &mut [f32],
        geometry_columns: usize,
    ) {
        let points = self
            .grad
            .chunks_exact(self.columns)
            .zip(self.rows.chunks_exact(self.columns))
            .zip(self.directions.chunks_exact(3))
            .zip(geometry.chunks_exact_mut(geometry_columns));
        let last = self.columns - 1;
        for (p, (((grad, row), direction), geometry)) in points.enumerate() {
            let first = grad[row_column::FIRST];
            geometry[0] += match config.reading {
                Reading::Distance => first,
                Reading::Density => {
                    let log = -x[9 * POINTS + p];
                    if (LEAST_LOG_DENSITY..=MOST_LOG_DENSITY).contains(&log) {
                        -first * row[row_column::FIRST]
                    } else {
                        0.0
                    }
                }
            };
            let (slope, length) = (grad[row_column::SLOPE], grad[last] / row[last]);
            let normal = &mut geometry[geometry_columns - 3..];
            for (axis, d) in normal.iter_mut().enumerate() {
                *d += slope * direction[axis] + length * x[(3 + axis) * POINTS + p];
            }
        }
    }
}
