//! The op over slices, tiles of points in parallel.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use tensor_slices::{Scratch, Stopwatch};

use super::around::{Around, surroundings};
use super::row::row_column;
use super::{MAX_OUTPUTS, Output};
use crate::sdf_field::transposed;
use crate::tile::partials::{LayerGradient, LayerPartials};
use crate::tile::transpose::{rows_to_tile, rows_to_tile_padded, tile_to_rows};
use crate::tile::{POINTS, activation, layer};

/// Jobs that the tiles are dealt to; fixed, so that sums do not depend on the number of threads.
const JOBS: usize = 16;

/// Rows that are not part of the geometry: points and directions.
const FRAME: usize = 6;

/// One layer, both ways round.
#[derive(Clone, Debug)]
struct Layer {
    weight: Vec<f32>,
    transposed: Vec<f32>,
    bias: Vec<f32>,
    inputs: usize,
}

impl Layer {
    fn new(weight: &[f32], bias: &[f32]) -> Self {
        let inputs = weight.len() / bias.len();
        Self {
            weight: weight.to_vec(),
            transposed: transposed(weight, bias.len(), inputs),
            bias: bias.to_vec(),
            inputs,
        }
    }

    fn outputs(&self) -> usize {
        self.bias.len()
    }

    #[inline(always)]
    fn forward<S: Simd>(&self, simd: S, x: &[f32], y: &mut [f32]) {
        layer::forward(simd, &self.weight, Some(&self.bias), x, y);
    }
}

/// The network's three layers.
#[derive(Clone, Debug)]
pub(crate) struct Weights([Layer; 3]);

impl Weights {
    /// From `w1, b1, w2, b2, w3, b3`.
    pub(crate) fn new([w1, b1, w2, b2, w3, b3]: [&[f32]; 6]) -> Self {
        Self([Layer::new(w1, b1), Layer::new(w2, b2), Layer::new(w3, b3)])
    }

    /// Columns of the op's output.
    pub(crate) fn outputs(&self) -> usize {
        self.0[2].outputs()
    }

    /// Rows of one tile in [`Saved`]: both hidden layers.
    fn saved_rows(&self) -> usize {
        self.0[0].outputs() + self.0[1].outputs()
    }
}

/// The op's inputs, point-major.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inputs<'a> {
    /// `[n, 1 + G + 3]`.
    pub(crate) geometry: &'a [f32],
    /// `1 + G + 3`, which without points the values do not tell.
    pub(crate) geometry_columns: usize,
    /// `[n, 3]`.
    pub(crate) points: &'a [f32],
    /// `[n, 3]`.
    pub(crate) directions: &'a [f32],
    /// `[n, E]`.
    pub(crate) extra: &'a [f32],
    /// `[n, 1]`, or empty.
    pub(crate) stretch: &'a [f32],
}

impl<'a> Inputs<'a> {
    fn len(&self) -> usize {
        self.points.len() / 3
    }

    /// The tile beginning at point `first`, as the network's input rows.
    #[inline(always)]
    fn tile(&self, first: usize, inputs: usize, x: &mut [f32]) {
        let geometry = self.geometry_columns;
        let extra = inputs - FRAME - geometry;
        let last = (first + POINTS).min(self.len());
        let rows = |slice: &'a [f32], width: usize| &slice[first * width..last * width];
        let (p, rest) = x.split_at_mut(3 * POINTS);
        let (n, rest) = rest.split_at_mut(3 * POINTS);
        let (v, rest) = rest.split_at_mut(3 * POINTS);
        rows_to_tile(rows(self.points, 3), 3, p);
        rows_to_tile(rows(self.directions, 3), 3, v);
        let (sdf_feature, rest) = rest.split_at_mut((geometry - 3) * POINTS);
        let source = rows(self.geometry, geometry);
        for (p, row) in source.chunks_exact(geometry).enumerate() {
            for (k, &value) in row[..geometry - 3].iter().enumerate() {
                sdf_feature[k * POINTS + p] = value;
            }
            for (k, &value) in row[geometry - 3..].iter().enumerate() {
                n[k * POINTS + p] = value;
            }
        }
        // Lanes past the last point hold what an earlier tile left: finite, and never read.
        if extra > 0 {
            rows_to_tile(rows(self.extra, extra), extra, rest);
        }
    }
}

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
/// Time spent in backward passes.
pub static BACKWARD: Stopwatch = Stopwatch::new();

/// What backward needs.
#[derive(Debug)]
#[allow(unreachable_pub)] // an associated type of a public backend must be public
pub struct Saved {
    weights: Weights,
    geometry_columns: usize,
    n: usize,
    output: Output,
    /// Per tile `[inputs + hidden + hidden, POINTS]`.
    tiles: Scratch,
    /// The op's output, in its shape.
    out: Scratch,
    /// Directions `[n, 3]` of rows; the tiles hold only the share that the network saw.
    directions: Scratch,
}

/// Colours or rows, `[n, output.columns(C)]`.
pub(crate) fn forward(
    inputs: Inputs<'_>,
    weights: Weights,
    output: Output,
    keep: Keep,
) -> (Vec<f32>, Option<Saved>) {
    let _lap = match keep {
        Keep::Nothing => EVALUATION.lap(),
        Keep::ForBackward => FORWARD.lap(),
    };
    let n = inputs.len();
    let outputs = output.columns(weights.outputs());
    let width = weights.0[0].inputs;
    let tile_len = (width + weights.saved_rows()) * POINTS;
    let mut out = vec![0.0; n * outputs];
    let run = |index: usize, tile: &mut [f32], out: &mut [f32]| {
        Arch::new().dispatch(ForwardTile {
            inputs,
            first: index * POINTS,
            weights: &weights,
            output,
            tile,
            out,
        });
    };
    if keep == Keep::Nothing {
        out.par_chunks_mut(outputs * POINTS)
            .enumerate()
            .for_each_init(
                // What lanes past the last point hold is never read.
                || Scratch::new(tile_len),
                |tile, (index, out)| run(index, tile, out),
            );
        return (out, None);
    }
    let mut tiles = Scratch::new(n.div_ceil(POINTS) * tile_len);
    if !n.is_multiple_of(POINTS) {
        // The lanes past the last point enter sums with a zero weight, and must be finite.
        let last = tiles.len() - tile_len;
        tiles[last..].fill(0.0);
    }
    out.par_chunks_mut(outputs * POINTS)
        .zip(tiles.par_chunks_mut(tile_len))
        .enumerate()
        .for_each(|(index, (out, tile))| run(index, tile, out));
    let keep = |values: &[f32]| {
        let mut kept = Scratch::new(values.len());
        kept.copy_from_slice(values);
        kept
    };
    let geometry_columns = inputs.geometry_columns;
    let saved = Saved {
        weights,
        geometry_columns,
        n,
        output,
        tiles,
        out: keep(&out),
        directions: match output {
            Output::Colour => Scratch::new(0),
            Output::Row(_) => keep(inputs.directions),
        },
    };
    (out, Some(saved))
}

struct ForwardTile<'a> {
    inputs: Inputs<'a>,
    first: usize,
    weights: &'a Weights,
    output: Output,
    tile: &'a mut [f32],
    out: &'a mut [f32],
}

/// `x` where positive, else zero. What is no number stays so: as zero it would go unnoticed.
#[inline(always)]
fn relu(values: &mut [f32]) {
    for value in values {
        *value = if *value <= 0.0 { 0.0 } else { *value };
    }
}

/// `d` where the activation was positive, else zero.
#[inline(always)]
fn relu_backward(activation: &[f32], d: &mut [f32]) {
    for (d, &a) in d.iter_mut().zip(activation) {
        *d = if a > 0.0 { *d } else { 0.0 };
    }
}

impl WithSimd for ForwardTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [first, second, third] = &self.weights.0;
        let (x, rest) = self.tile.split_at_mut(first.inputs * POINTS);
        let (h1, h2) = rest.split_at_mut(first.outputs() * POINTS);
        self.inputs.tile(self.first, first.inputs, x);
        let outputs = third.outputs();
        let mut rows = [0.0; (MAX_OUTPUTS + row_column::OTHERS) * POINTS];
        let rows = &mut rows[..self.output.columns(outputs) * POINTS];
        let out = match self.output {
            Output::Colour => &mut rows[..],
            Output::Row(config) => {
                let stretch = self.inputs.stretch.get(self.first..).unwrap_or_default();
                surroundings(config, stretch, x, rows);
                &mut rows[row_column::COLOUR * POINTS..][..outputs * POINTS]
            }
        };
        first.forward(simd, x, h1);
        relu(h1);
        second.forward(simd, h1, h2);
        relu(h2);
        third.forward(simd, h2, out);
        activation::sigmoid(simd, out);
        tile_to_rows(rows, self.output.columns(outputs), self.out);
    }
}

/// Gradients of the op's tracked inputs.
pub(crate) struct Gradients {
    pub(crate) geometry: Vec<f32>,
    pub(crate) geometry_columns: usize,
    pub(crate) w1: Vec<f32>,
    pub(crate) b1: Vec<f32>,
    pub(crate) w2: Vec<f32>,
    pub(crate) b2: Vec<f32>,
    pub(crate) w3: Vec<f32>,
    pub(crate) b3: Vec<f32>,
}

/// Gradients for `grad`, in the output's shape.
pub(crate) fn backward(saved: &Saved, grad: &[f32]) -> Gradients {
    let _lap = BACKWARD.lap();
    let [first, second, third] = &saved.weights.0;
    let outputs = saved.output.columns(third.outputs());
    let columns = saved.geometry_columns;
    let tile_len = (first.inputs + saved.weights.saved_rows()) * POINTS;
    let mut geometry = vec![0.0; saved.n * columns];
    let tiles_per_job = saved.n.div_ceil(POINTS).div_ceil(JOBS).max(1);
    let points_per_job = tiles_per_job * POINTS;
    let jobs: Vec<[LayerGradient; 3]> = grad
        .par_chunks(outputs * points_per_job)
        .zip(saved.out.par_chunks(outputs * points_per_job))
        .zip(saved.tiles.par_chunks(tile_len * tiles_per_job))
        .zip(geometry.par_chunks_mut(columns * points_per_job))
        .enumerate()
        .map(|(job, (((grad, out), tiles), geometry))| {
            let mut partials =
                [first, second, third].map(|l| LayerPartials::new(l.outputs(), l.inputs));
            let lanes = Arch::new().dispatch(BackwardJob {
                weights: &saved.weights,
                output: saved.output,
                directions: saved
                    .directions
                    .get(3 * job * points_per_job..)
                    .unwrap_or_default(),
                grad,
                out,
                tiles,
                geometry,
                columns,
                partials: &mut partials,
            });
            partials.map(|of| of.reduce(lanes))
        })
        .collect();
    let (mut firsts, mut seconds, mut thirds) = (Vec::new(), Vec::new(), Vec::new());
    for [one, two, three] in jobs {
        firsts.push(one);
        seconds.push(two);
        thirds.push(three);
    }
    let [one, two, three] = [(first, firsts), (second, seconds), (third, thirds)]
        .map(|(layer, parts)| LayerGradient::sum(parts, layer.outputs(), layer.inputs));
    Gradients {
        geometry,
        geometry_columns: columns,
        w1: one.weight,
        b1: one.bias,
        w2: two.weight,
        b2: two.bias,
        w3: three.weight,
        b3: three.bias,
    }
}

struct BackwardJob<'a> {
    weights: &'a Weights,
    output: Output,
    /// Of rows, from the job's first point on.
    directions: &'a [f32],
    grad: &'a [f32],
    out: &'a [f32],
    tiles: &'a [f32],
    geometry: &'a mut [f32],
    columns: usize,
    partials: &'a mut [LayerPartials; 3],
}

impl WithSimd for BackwardJob<'_> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let [first, second, third] = &self.weights.0;
        let [p1, p2, p3] = self.partials;
        let outputs = third.outputs();
        let columns = self.output.columns(outputs);
        let tile_len = (first.inputs + self.weights.saved_rows()) * POINTS;
        let mut d_rows = vec![0.0; columns * POINTS];
        let mut rows = vec![0.0; columns * POINTS];
        let colours = match self.output {
            Output::Colour => 0..outputs * POINTS,
            Output::Row(_) => {
                let first = row_column::COLOUR * POINTS;
                first..first + outputs * POINTS
            }
        };
        let mut d_h2 = vec![0.0; second.outputs() * POINTS];
        let mut d_h1 = vec![0.0; first.outputs() * POINTS];
        let mut d_x = vec![0.0; first.inputs * POINTS];
        let tiles = self
            .grad
            .chunks(columns * POINTS)
            .zip(self.out.chunks(columns * POINTS))
            .zip(self.tiles.chunks_exact(tile_len))
            .zip(self.geometry.chunks_mut(self.columns * POINTS))
            .enumerate();
        for (index, (((grad, out), tile), geometry)) in tiles {
            let (x, rest) = tile.split_at(first.inputs * POINTS);
            let (h1, h2) = rest.split_at(first.outputs() * POINTS);
            rows_to_tile_padded(grad, columns, &mut d_rows);
            rows_to_tile_padded(out, columns, &mut rows);
            let d_out = &mut d_rows[colours.clone()];
            for (d, &o) in d_out.iter_mut().zip(&rows[colours.clone()]) {
                *d *= o * (1.0 - o);
            }
            layer::outer(simd, d_out, h2, &mut p3.weight);
            p3.add_bias(d_out);
            layer::forward(simd, &third.transposed, None, d_out, &mut d_h2);
            relu_backward(h2, &mut d_h2);
            layer::outer(simd, &d_h2, h1, &mut p2.weight);
            p2.add_bias(&d_h2);
            layer::forward(simd, &second.transposed, None, &d_h2, &mut d_h1);
            relu_backward(h1, &mut d_h1);
            layer::outer(simd, &d_h1, x, &mut p1.weight);
            p1.add_bias(&d_h1);
            layer::forward(simd, &first.transposed, None, &d_h1, &mut d_x);
            // Input rows: p, n, v, sdf, feature, extra; geometry columns: sdf, feature, n.
            let own = self.columns - 3;
            for (p, row) in geometry.chunks_exact_mut(self.columns).enumerate() {
                for (k, value) in row[..own].iter_mut().enumerate() {
                    *value = d_x[(9 + k) * POINTS + p];
                }
                for (k, value) in row[own..].iter_mut().enumerate() {
                    *value = d_x[(3 + k) * POINTS + p];
                }
            }
            if let Output::Row(config) = self.output {
                let around = Around {
                    grad,
                    rows: out,
                    columns,
                    directions: &self.directions[3 * index * POINTS..],
                };
                around.add_to(config, x, geometry, self.columns);
            }
        }
        S::F32_LANES
    }
}
