//! What forward does with one tile of points.

use hashgrid::{GridLayout, cpu as grid};
use pulp::{Simd, WithSimd};
use tensor_slices::Scratch;

use super::forward::{TileKind, TileMut};
use super::weights::Weights;
use crate::sdf_field::{Normal, SdfFieldConfig};
use crate::tile::transpose::{rows_to_tile, tile_to_rows};
use crate::tile::{POINTS, activation, layer};

/// What all tiles of a pass have in common.
#[derive(Clone, Copy)]
pub(super) struct Field<'a> {
    /// Entries of the active levels.
    pub(super) table: &'a [f32],
    pub(super) weights: &'a Weights,
    pub(super) config: &'a SdfFieldConfig,
    /// The active levels.
    pub(super) layout: &'a GridLayout,
    pub(super) kind: TileKind,
}

impl<'a> Field<'a> {
    /// `layout` is that of the active levels, `table` may go on behind them.
    pub(super) fn of(
        table: &'a [f32],
        weights: &'a Weights,
        config: &'a SdfFieldConfig,
        layout: &'a GridLayout,
    ) -> Self {
        Self {
            table: &table[..2 * layout.entries()],
            weights,
            config,
            layout,
            kind: TileKind::of(weights, config),
        }
    }

    /// Units of the grid in one of the points' own.
    fn scale(self) -> f32 {
        0.5 / self.config.half_side
    }
}

/// Room for one tile's intermediate rows that backward does not ask for: each is written before it is read.
pub(super) struct WorkingRoom(Scratch);

/// These rows.
pub(super) struct Working<'a> {
    /// Positions in the grid, in `[0, 1]`.
    pub(super) unit: &'a mut [f32],
    z: &'a mut [f32],
    /// Derivative of the hidden layer by `z`.
    slope: &'a mut [f32],
    /// The sdf's derivative by `z`.
    u: &'a mut [f32],
    /// The sdf's derivative by the input.
    pub(super) g: &'a mut [f32],
    out: &'a mut [f32],
}

impl WorkingRoom {
    pub(super) fn new(weights: &Weights) -> Self {
        let rows: usize = Self::counts(weights).iter().sum();
        Self(Scratch::new(rows * POINTS))
    }

    fn counts(weights: &Weights) -> [usize; 6] {
        let (inputs, hidden) = (weights.inputs, weights.hidden);
        [3, hidden, hidden, hidden, inputs, weights.columns()]
    }

    /// Rows of `points` values each.
    pub(super) fn rows_mut(&mut self, weights: &Weights, points: usize) -> Working<'_> {
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
    normal.fill(0.0);
    let features = g[3 * points..].chunks_exact(points);
    // In the order of the Jacobian's rows, which may come from memory.
    for (g, rows) in features.zip(jacobian.chunks_exact(3 * points)) {
        for (n, j) in normal
            .chunks_exact_mut(points)
            .zip(rows.chunks_exact(points))
        {
            for ((n, g), j) in n.iter_mut().zip(g).zip(j) {
                *n += g * j;
            }
        }
    }
    for (n, direct) in normal.iter_mut().zip(g) {
        *n = direct + scale * *n;
    }
}

/// The whole way of one tile.
pub(super) struct ForwardTile<'a> {
    pub(super) field: Field<'a>,
    pub(super) points: &'a [f32],
    /// Values of a row: the tile's points, rounded up.
    pub(super) lanes: usize,
    pub(super) tile: &'a mut [f32],
    pub(super) working: &'a mut WorkingRoom,
    pub(super) out: &'a mut [f32],
}

impl WithSimd for ForwardTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            field,
            working,
            lanes,
            ..
        } = self;
        let working = working.rows_mut(field.weights, lanes);
        let TileMut { input, jacobian, a } = field.kind.rows_mut(self.tile, lanes);
        let (positions, features) = input.split_at_mut(3 * lanes);
        set_out(field, self.points, positions, working.unit);
        let [x, y, z] = axes(working.unit);
        let wanted = (field.kind.normal == Normal::Computed).then_some(&mut *jacobian);
        let levels = field.layout.levels.len();
        grid::encode_tile(field.layout, levels, field.table, x, y, z, features, wanted);
        layers(simd, field, lanes, input, jacobian, a, working, self.out);
    }
}

/// A tile's `points [n, 3]` as rows, and their places in the grid, `[3, points]` either.
#[inline(always)]
pub(super) fn set_out(field: Field<'_>, points: &[f32], positions: &mut [f32], unit: &mut [f32]) {
    rows_to_tile(points, 3, positions);
    let scale = field.scale();
    for (unit, p) in unit.iter_mut().zip(positions.iter()) {
        *unit = p * scale + 0.5;
    }
}

/// The rows of `[3, points]`.
#[inline(always)]
pub(super) fn axes(rows: &[f32]) -> [&[f32]; 3] {
    let (x, yz) = rows.split_at(rows.len() / 3);
    let (y, z) = yz.split_at(x.len());
    [x, y, z]
}

/// From an encoded tile to the rows of `out`; leaves the hidden layer in `a` and, with normals, the sdf's derivative by the
/// input in `working.g`.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(super) fn layers<S: Simd>(
    simd: S,
    field: Field<'_>,
    lanes: usize,
    input: &[f32],
    jacobian: &[f32],
    a: &mut [f32],
    working: Working<'_>,
    out: &mut [f32],
) {
    let weights = field.weights;
    let Working {
        z,
        slope,
        u,
        g,
        out: columns,
        ..
    } = working;
    layer::forward_of(simd, lanes, &weights.w1, Some(&weights.b1), input, z);
    activation::softplus(simd, field.config.beta, z, a, slope);
    let (values, normal) = columns.split_at_mut(weights.outputs * lanes);
    layer::forward_of(simd, lanes, &weights.w2, Some(&weights.b2), a, values);
    if field.kind.normal == Normal::Computed {
        slope_of_hidden(weights, lanes, slope, u);
        layer::forward_of(simd, lanes, &weights.w1_transposed, None, u, g);
        normal_of_tile(g, jacobian, field.scale(), lanes, normal);
    } else {
        normal.fill(0.0);
    }
    tile_to_rows(columns, weights.columns(), out);
}
