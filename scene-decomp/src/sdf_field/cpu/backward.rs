//! Backward: tiles of points in parallel, then one scatter task per grid level, which waits for the step where
//! the gradient is sparse.

use std::sync::Arc;

use hashgrid::{FEATURES, GridLayout, cpu as grid};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use tensor_slices::{Scratch, Stopwatch};

use super::forward::{Saved, Tile};
use super::forward_tile::slope_of_hidden;
use super::passes::Passes;
use super::weights::Weights;
use crate::sdf_field::Normal;
use crate::sdf_field::backward::DenseTable;
use crate::tile::partials::{LayerGradient, LayerPartials};
use crate::tile::{POINTS, activation, layer};

/// Jobs that the tiles are dealt to; fixed, so that sums do not depend on the number of threads.
const JOBS: usize = 16;

/// Time spent in backward passes.
pub static BACKWARD: Stopwatch = Stopwatch::new();

/// Gradients of the op's weights, row-major as the weights are.
pub(crate) struct Gradients {
    pub(crate) table: Option<Vec<f32>>,
    pub(crate) w1: Vec<f32>,
    pub(crate) b1: Vec<f32>,
    pub(crate) w2: Vec<f32>,
    pub(crate) b2: Vec<f32>,
}

/// Gradients for `grad [n, 1 + G + 3]`.
pub(crate) fn backward(saved: &Saved, grad: &[f32], dense_table: DenseTable) -> Gradients {
    let _lap = BACKWARD.lap();
    let weights = &saved.weights;
    let tiles = saved.passes.tiles();
    let scatter_len = saved.passes.kind.len_of_places();
    let mut scatter = Scratch::new(tiles * scatter_len);

    let tiles_per_job = tiles.div_ceil(JOBS).max(1);
    let jobs: Vec<JobGradient> = scatter
        .par_chunks_mut(scatter_len * tiles_per_job)
        .enumerate()
        .map(|(job, scatter)| {
            let mut partials = Partials::new(weights);
            let mut working = BackwardWorking::new(weights);
            let lanes = Arch::new().dispatch(BackwardJob {
                saved,
                grad,
                first: job * tiles_per_job,
                scatter,
                partials: &mut partials,
                working: &mut working,
            });
            JobGradient {
                first: partials.first.reduce(lanes),
                second: partials.second.reduce(lanes),
                sdf_row: partials.sdf_row,
            }
        })
        .collect();

    let (mut firsts, mut seconds, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for job in jobs {
        firsts.push(job.first);
        seconds.push(job.second);
        rows.push(job.sdf_row);
    }
    let first = LayerGradient::sum(firsts, weights.hidden, weights.inputs);
    let mut second = LayerGradient::sum(seconds, weights.outputs, weights.hidden);
    for row in rows {
        for (sum, part) in second.weight.iter_mut().zip(row) {
            *sum += part;
        }
    }
    // Levels that are not in use yet have no gradient.
    let mut w1 = vec![0.0; weights.hidden * weights.all_inputs];
    for (row, active) in w1
        .chunks_exact_mut(weights.all_inputs)
        .zip(first.weight.chunks_exact(weights.inputs))
    {
        row[..weights.inputs].copy_from_slice(active);
    }
    Gradients {
        w1,
        b1: first.bias,
        w2: second.weight,
        b2: second.bias,
        table: scatter_table(saved, scatter, dense_table),
    }
}

/// Hits for each block of a level from which on blocks are not marked one by one: few would be left out.
const OFTEN: usize = 2;

/// What comes back to the table.
struct TableGradient {
    layout: Arc<GridLayout>,
    passes: Arc<Passes>,
    /// For each tile `[3 + features, POINTS]`: dL/dn in unit coordinates, and dL/dh.
    tiles: Scratch,
}

impl TableGradient {
    /// Adds one level's share: every tile's points in order, so without atomics.
    fn add(&self, level: usize, grad: &mut [f32], mut touched: Option<&mut [u8]>) {
        let kind = self.passes.kind;
        if let Some(flags) = touched.as_deref_mut()
            && 8 * self.passes.points() >= OFTEN * flags.len()
        {
            flags.fill(1);
            touched = None;
        }
        let tile_len = kind.len_of_places();
        for (tile, back) in self.tiles.chunks_exact(tile_len).enumerate() {
            let place = self.passes.place(tile);
            let count = self.passes.points_on(tile);
            // The first feature's row, after three of positions or normals.
            let first = 3 + 2 * level;
            let rows = grid::ScatterRows {
                position: [
                    row(place, 0, count),
                    row(place, 1, count),
                    row(place, 2, count),
                ],
                d_value: [row(back, first, count), row(back, first + 1, count)],
                normal_part: (kind.normal == Normal::Computed).then(|| {
                    (
                        [row(place, first, count), row(place, first + 1, count)],
                        [
                            row(back, 0, count),
                            row(back, 1, count),
                            row(back, 2, count),
                        ],
                    )
                }),
                // The tiles of both lie one after the other, but for those of tapes here and there.
                prefetch_offset: tile_len,
            };
            grid::scatter_level(&self.layout, level, &rows, grad, touched.as_deref_mut());
        }
    }
}

/// The first `count` values of a row.
#[inline(always)]
fn row(rows: &[f32], row: usize, count: usize) -> &[f32] {
    &rows[row * POINTS..row * POINTS + count]
}

/// The table's gradient: in `config.sparse` once the step asks for it, or now as a dense tensor.
fn scatter_table(saved: &Saved, scatter: Scratch, dense: DenseTable) -> Option<Vec<f32>> {
    let active = saved.config.active_levels;
    let gradient = TableGradient {
        layout: Arc::clone(&saved.config.layout),
        passes: Arc::clone(&saved.passes),
        tiles: scatter,
    };
    if let Some(sparse) = &saved.config.sparse {
        sparse.defer_levels(&saved.config.layout, active, move |level, grad, touched| {
            gradient.add(level, grad, Some(touched))
        });
        return None;
    }
    if dense == DenseTable::Unwanted {
        return None;
    }
    let mut table = vec![0.0; saved.table_len];
    saved
        .config
        .layout
        .split_levels_mut(&mut table, FEATURES)
        .into_par_iter()
        .take(active)
        .enumerate()
        .for_each(|(level, grad)| gradient.add(level, grad, None));
    Some(table)
}

struct Partials {
    first: LayerPartials,
    second: LayerPartials,
    /// Gradient of `W2`'s first row through the normal, `[hidden]`.
    sdf_row: Vec<f32>,
}

/// What one job adds to the gradients.
struct JobGradient {
    first: LayerGradient,
    second: LayerGradient,
    sdf_row: Vec<f32>,
}

impl Partials {
    fn new(weights: &Weights) -> Self {
        Self {
            first: LayerPartials::new(weights.hidden, weights.inputs),
            second: LayerPartials::new(weights.outputs, weights.hidden),
            sdf_row: vec![0.0; weights.hidden],
        }
    }
}

struct BackwardWorking {
    slope: Scratch,
    u: Scratch,
    grad: Scratch,
    dg: Scratch,
    du: Scratch,
    dz: Scratch,
}

impl BackwardWorking {
    fn new(weights: &Weights) -> Self {
        Self {
            slope: Scratch::new(weights.hidden * POINTS),
            u: Scratch::new(weights.hidden * POINTS),
            grad: Scratch::new(weights.columns() * POINTS),
            dg: Scratch::new(weights.inputs * POINTS),
            du: Scratch::new(weights.hidden * POINTS),
            dz: Scratch::new(weights.hidden * POINTS),
        }
    }
}

struct BackwardJob<'a> {
    saved: &'a Saved,
    grad: &'a [f32],
    /// Number of its first tile.
    first: usize,
    /// Beside each of its tiles.
    scatter: &'a mut [f32],
    partials: &'a mut Partials,
    working: &'a mut BackwardWorking,
}

impl WithSimd for BackwardJob<'_> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let passes = &self.saved.passes;
        let columns = self.saved.weights.columns();
        let len = passes.kind.len_of_places();
        for (i, scatter) in self.scatter.chunks_exact_mut(len).enumerate() {
            let number = self.first + i;
            passes.gradient_of_tile(number, self.grad, columns, &mut self.working.grad);
            let tile = passes.tile(number);
            backward_tile(simd, self.saved, tile, scatter, self.partials, self.working);
        }
        S::F32_LANES
    }
}

/// The chain rule of one tile, whose gradient is in `working`. With `d` for the loss' derivative:
///
/// ```text
/// dg = J dn        du = W1 dg        dW1 += u dg^T      dw2 += du * slope
/// da = W2^T dout   dz = da * slope + du * w2 * slope'   dW1 += dz x^T     dx = W1^T dz
/// ```
///
/// and the table receives `dh` through the value and `g dn^T` through the Jacobian.
#[inline(always)]
fn backward_tile<S: Simd>(
    simd: S,
    saved: &Saved,
    tile: Tile<'_>,
    scatter: &mut [f32],
    partials: &mut Partials,
    working: &mut BackwardWorking,
) {
    let weights = &saved.weights;
    let beta = saved.config.beta;
    let scale = 0.5 / saved.config.half_side;
    let BackwardWorking {
        slope,
        u,
        grad,
        dg,
        du,
        dz,
    } = working;
    activation::slope_of_softplus(simd, beta, tile.a, slope);
    let (d_out, d_normal) = grad.split_at(weights.outputs * POINTS);

    let (dn_unit, d_h) = scatter.split_at_mut(3 * POINTS);
    if saved.config.normal == Normal::Computed {
        slope_of_hidden(weights, POINTS, slope, u);
        for (unit, dn) in dn_unit.iter_mut().zip(d_normal) {
            *unit = scale * dn;
        }
        dg[..3 * POINTS].copy_from_slice(d_normal);
        for (k, dg) in dg[3 * POINTS..].chunks_exact_mut(POINTS).enumerate() {
            let j = &tile.jacobian[3 * k * POINTS..3 * (k + 1) * POINTS];
            for p in 0..POINTS {
                dg[p] = j[p] * dn_unit[p]
                    + j[POINTS + p] * dn_unit[POINTS + p]
                    + j[2 * POINTS + p] * dn_unit[2 * POINTS + p];
            }
        }
        layer::forward(simd, &weights.w1, None, dg, du);
        layer::outer(simd, u, dg, &mut partials.first.weight);
    }

    layer::forward(simd, &weights.w2_transposed, None, d_out, dz);
    for j in 0..weights.hidden {
        let w = weights.w2[j];
        let rows = j * POINTS..(j + 1) * POINTS;
        let (slope, du, dz) = (&slope[rows.clone()], &du[rows.clone()], &mut dz[rows]);
        if saved.config.normal == Normal::Zero {
            for (dz, slope) in dz.iter_mut().zip(slope) {
                *dz *= slope;
            }
            continue;
        }
        let mut sum = [0.0f32; 16];
        for block in (0..POINTS).step_by(16) {
            for (lane, sum) in sum.iter_mut().enumerate() {
                let p = block + lane;
                *sum += du[p] * slope[p];
                dz[p] = dz[p] * slope[p] + du[p] * w * beta * slope[p] * (1.0 - slope[p]);
            }
        }
        partials.sdf_row[j] += sum.iter().sum::<f32>();
    }
    layer::outer(simd, d_out, tile.a, &mut partials.second.weight);
    partials.second.add_bias(d_out);
    layer::outer(simd, dz, tile.input, &mut partials.first.weight);
    partials.first.add_bias(dz);
    layer::forward(
        simd,
        &weights.w1_transposed[3 * weights.hidden..],
        None,
        dz,
        d_h,
    );
}
