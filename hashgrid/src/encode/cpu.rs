//! The ops over slices: row-major points in, row-major results out, tiles and levels in parallel.

use rayon::prelude::*;

use super::EncodeConfig;
use crate::cpu::{LANES, ScatterRows, encode_tile, scatter_full, scatter_level};
use crate::layout::FEATURES;

/// Points handled by one task at a time.
const TILE: usize = 256;

/// What is returned for each feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// The value.
    Value,
    /// The value and its derivatives along x, y and z.
    WithJacobian,
}

impl Form {
    /// Numbers per feature.
    pub(super) fn width(self) -> usize {
        match self {
            Self::Value => 1,
            Self::WithJacobian => 4,
        }
    }
}

/// A tile's memory, kept by a thread from tile to tile.
struct Tile {
    position: [Vec<f32>; 3],
    values: Vec<f32>,
    jacobian: Vec<f32>,
}

impl Tile {
    fn new(config: &EncodeConfig, form: Form) -> Self {
        let values = config.layout.features() * TILE;
        Self {
            position: [vec![0.0; TILE], vec![0.0; TILE], vec![0.0; TILE]],
            values: vec![0.0; values],
            jacobian: vec![
                0.0;
                if form == Form::WithJacobian {
                    3 * values
                } else {
                    0
                }
            ],
        }
    }

    /// Encodes up to [`TILE`] points `[count, 3]`; returns the tile's width, which is `count`
    /// rounded up to whole lanes.
    fn encode(&mut self, points: &[f32], table: &[f32], config: &EncodeConfig) -> usize {
        let count = points.len() / 3;
        let width = count.next_multiple_of(LANES);
        for (axis, position) in self.position.iter_mut().enumerate() {
            for (to, point) in position.iter_mut().zip(points.chunks_exact(3)) {
                *to = point[axis];
            }
            position[count..width].fill(0.0);
        }
        let [x, y, z] = &self.position;
        let features = config.layout.features();
        let jacobian =
            (!self.jacobian.is_empty()).then(|| &mut self.jacobian[..3 * features * width]);
        encode_tile(
            &config.layout,
            config.active_levels,
            table,
            &x[..width],
            &y[..width],
            &z[..width],
            &mut self.values[..features * width],
            jacobian,
        );
        width
    }
}

/// `[n, 2 L]` or `[n, 2 L, 4]` for `points` `[n, 3]`.
pub(super) fn forward(
    points: &[f32],
    table: &[f32],
    config: &EncodeConfig,
    form: Form,
) -> Vec<f32> {
    let features = config.layout.features();
    let row = features * form.width();
    let mut out = vec![0.0; points.len() / 3 * row];
    out.par_chunks_mut(TILE * row)
        .zip(points.par_chunks(TILE * 3))
        .for_each_init(
            || Tile::new(config, form),
            |tile, (out, points)| {
                let width = tile.encode(points, table, config);
                for (i, out) in out.chunks_exact_mut(row).enumerate() {
                    for (k, out) in out.chunks_exact_mut(form.width()).enumerate() {
                        out[0] = tile.values[k * width + i];
                        for (axis, out) in out[1..].iter_mut().enumerate() {
                            *out = tile.jacobian[(3 * k + axis) * width + i];
                        }
                    }
                }
            },
        );
    out
}

/// The table's gradient `[entries, 2]`; `grad` has the shape that [`forward`] returned.
///
/// One task per level, each adding its points in order: the same bits for any number of threads.
pub(super) fn table_gradient(
    points: &[f32],
    grad: &[f32],
    config: &EncodeConfig,
    form: Form,
) -> Vec<f32> {
    let layout = &config.layout;
    let n = points.len() / 3;
    let position = [0, 1, 2].map(|axis| points.iter().skip(axis).step_by(3).copied().collect());
    let position: [Vec<f32>; 3] = position;
    let row = layout.features() * form.width();
    let mut out = vec![0.0; FEATURES * layout.entries()];
    layout
        .split_levels_mut(&mut out, FEATURES)
        .into_par_iter()
        .take(config.active_levels)
        .with_max_len(1)
        .enumerate()
        .for_each(|(level, out)| {
            // This level's columns of `grad`, each as a row of its own.
            let own = FEATURES * form.width();
            let mut rows = vec![0.0; own * n];
            for (i, grad) in grad.chunks_exact(row).enumerate() {
                for (r, value) in grad[level * own..(level + 1) * own].iter().enumerate() {
                    rows[r * n + i] = *value;
                }
            }
            let at = |r: usize| &rows[r * n..(r + 1) * n];
            let position = [0, 1, 2].map(|a| &position[a][..]);
            match form {
                Form::Value => {
                    let rows = ScatterRows {
                        position,
                        d_value: [at(0), at(1)],
                        normal_part: None,
                        prefetch_offset: 0,
                    };
                    scatter_level(layout, level, &rows, out, None);
                }
                Form::WithJacobian => {
                    let d_jacobian = [[at(1), at(2), at(3)], [at(5), at(6), at(7)]];
                    scatter_full(layout, level, position, [at(0), at(4)], d_jacobian, out);
                }
            }
        });
    out
}

/// The points' gradient `[n, 3]`: `dL/dp = Jᵀ dL/dh`, where `grad` is `[n, 2 L]`.
pub(super) fn points_gradient(
    points: &[f32],
    table: &[f32],
    grad: &[f32],
    config: &EncodeConfig,
) -> Vec<f32> {
    let features = config.layout.features();
    let mut out = vec![0.0; points.len()];
    out.par_chunks_mut(TILE * 3)
        .zip(points.par_chunks(TILE * 3))
        .zip(grad.par_chunks(TILE * features))
        .for_each_init(
            || Tile::new(config, Form::WithJacobian),
            |tile, ((out, points), grad)| {
                let width = tile.encode(points, table, config);
                for (i, (out, grad)) in out
                    .chunks_exact_mut(3)
                    .zip(grad.chunks_exact(features))
                    .enumerate()
                {
                    for (k, grad) in grad.iter().enumerate() {
                        for (axis, out) in out.iter_mut().enumerate() {
                            *out += grad * tile.jacobian[(3 * k + axis) * width + i];
                        }
                    }
                }
            },
        );
    out
}
