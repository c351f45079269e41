//! The kernels around the network's layers. Matrices are [`gpu_tensors::PointMatrix`], `across` their
//! points.

// Kernels cannot ask ranges.
#![allow(clippy::manual_range_contains)]

use gpu_tensors::{cubecl, sigmoid};

use crate::colour_field::row::{LEAST_LOG_DENSITY, LENGTH_OFFSET, MOST_LOG_DENSITY, row_column};
use cubecl::prelude::*;

/// A kernel's constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Sizes {
    /// Columns of the geometry: sdf, features, normal.
    pub(super) geometry: usize,
    pub(super) extra: usize,
    pub(super) hidden1: usize,
    pub(super) hidden2: usize,
    pub(super) outputs: usize,
    pub(super) form: Form,
    /// Densities are multiplied by something.
    pub(super) stretched: bool,
}

/// What is written for a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Form {
    /// The network's outputs.
    Colour,
    /// A row with a distance.
    Distance,
    /// A row with a density.
    Density,
}

impl Sizes {
    /// Columns of the result.
    pub(super) fn columns(self) -> usize {
        match self.form {
            Form::Colour => self.outputs,
            Form::Distance | Form::Density => self.outputs + row_column::OTHERS,
        }
    }

    /// Where the network's outputs begin among them.
    fn first_output(self) -> usize {
        match self.form {
            Form::Colour => 0,
            Form::Distance | Form::Density => row_column::COLOUR,
        }
    }

    pub(super) fn inputs(self) -> usize {
        6 + self.geometry + self.extra
    }

    /// Columns of the geometry that are inputs as they are: sdf and features.
    fn own(self) -> usize {
        self.geometry - 3
    }
}

/// The network's inputs at `count` points from `first` on: position, normal, direction, sdf, features,
/// extra, and a one, the bias' input; zeros beyond the points.
///
/// One thread for each point and input.
#[cube(launch_unchecked)]
pub(super) fn input_kernel(
    geometry: &[f32],
    points: &[f32],
    directions: &[f32],
    extra: &[f32],
    x: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    view_share: f32,
    #[comptime] sizes: Sizes,
) {
    let across = across as usize;
    let (point, k) = (ABSOLUTE_POS % across, ABSOLUTE_POS / across);
    let own = comptime!(sizes.own());
    if k < comptime!(sizes.inputs() + 1) {
        let mut value = 0.0f32;
        if point < count as usize {
            let p = first as usize + point;
            let row = p * comptime!(sizes.geometry);
            if k < 3 {
                value = points[3 * p + k];
            } else if k < 6 {
                value = geometry[row + own + k - 3];
            } else if k < 9 {
                value = view_share * directions[3 * p + k - 6];
            } else if k < 9 + own {
                value = geometry[row + k - 9];
            } else if k < comptime!(sizes.inputs()) {
                value = extra[p * comptime!(sizes.extra) + k - 9 - own];
            } else {
                value = 1.0f32;
            }
        }
        x[ABSOLUTE_POS] = value;
    }
}

/// A point's sdf, normal and direction.
#[derive(CubeType, Clone, Copy)]
struct Seen {
    sdf: f32,
    nx: f32,
    ny: f32,
    nz: f32,
    vx: f32,
    vy: f32,
    vz: f32,
}

#[cube]
fn seen(geometry: &[f32], directions: &[f32], point: usize, #[comptime] sizes: Sizes) -> Seen {
    let row = point * comptime!(sizes.geometry);
    let normal = row + comptime!(sizes.own());
    Seen {
        sdf: geometry[row],
        nx: geometry[normal],
        ny: geometry[normal + 1],
        nz: geometry[normal + 2],
        vx: directions[3 * point],
        vy: directions[3 * point + 1],
        vz: directions[3 * point + 2],
    }
}

/// The normal's length.
#[cube]
fn normal_length(at: &Seen) -> f32 {
    (at.nx * at.nx + at.ny * at.ny + at.nz * at.nz + comptime!(LENGTH_OFFSET)).sqrt()
}

/// The density that an sdf stands for.
#[cube]
fn density(sdf: f32, stretch: &[f32], point: usize, #[comptime] sizes: Sizes) -> f32 {
    let log = -sdf;
    let least = comptime!(LEAST_LOG_DENSITY);
    let most = comptime!(MOST_LOG_DENSITY);
    // `clamp` may drop what is no number.
    let log = select(log > most, most, select(log < least, least, log));
    let mut density = log.exp();
    if comptime!(sizes.stretched) {
        density *= stretch[point];
    }
    density
}

/// Writes the results of `count` points from the network's outputs before their sigmoid.
///
/// One thread per point.
#[cube(launch_unchecked)]
pub(super) fn finish_kernel(
    geometry: &[f32],
    directions: &[f32],
    stretch: &[f32],
    y: &[f32],
    out: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    #[comptime] sizes: Sizes,
) {
    if ABSOLUTE_POS < count as usize {
        let point = first as usize + ABSOLUTE_POS;
        let at = point * comptime!(sizes.columns());
        if comptime!(sizes.form != Form::Colour) {
            let seen = seen(geometry, directions, point, sizes);
            let mut value = seen.sdf;
            if comptime!(sizes.form == Form::Density) {
                value = density(seen.sdf, stretch, point, sizes);
            }
            out[at + comptime!(row_column::FIRST)] = value;
            out[at + comptime!(row_column::SLOPE)] =
                seen.nx * seen.vx + seen.ny * seen.vy + seen.nz * seen.vz;
            out[at + comptime!(sizes.columns() - 1)] = normal_length(&seen);
        }
        for o in 0..comptime!(sizes.outputs) {
            let value = y[o * across as usize + ABSOLUTE_POS];
            out[at + comptime!(sizes.first_output()) + o] = sigmoid(value);
        }
    }
}

/// From the network's outputs before their sigmoid to their gradients, in place; zeros beyond the points.
///
/// One thread for each point and output.
#[cube(launch_unchecked)]
pub(super) fn outputs_kernel(
    grad: &[f32],
    y: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    #[comptime] sizes: Sizes,
) {
    let across = across as usize;
    let (point, o) = (ABSOLUTE_POS % across, ABSOLUTE_POS / across);
    if o < comptime!(sizes.outputs) {
        let mut value = 0.0f32;
        if point < count as usize {
            let row = (first as usize + point) * comptime!(sizes.columns());
            let colour = sigmoid(y[ABSOLUTE_POS]);
            value = grad[row + comptime!(sizes.first_output()) + o] * colour * (1.0f32 - colour);
        }
        y[ABSOLUTE_POS] = value;
    }
}

/// The geometry's gradients of `count` points, from the inputs' and, for rows, what is around the
/// network's outputs.
///
/// One thread per point.
#[cube(launch_unchecked)]
pub(super) fn geometry_kernel(
    geometry: &[f32],
    directions: &[f32],
    stretch: &[f32],
    grad: &[f32],
    dx: &[f32],
    d_geometry: &mut [f32],
    first: u32,
    count: u32,
    across: u32,
    #[comptime] sizes: Sizes,
) {
    if ABSOLUTE_POS < count as usize {
        let point = first as usize + ABSOLUTE_POS;
        let across = across as usize;
        let own = comptime!(sizes.own());
        let at = point * comptime!(sizes.geometry);
        let mut sdf = dx[9 * across + ABSOLUTE_POS];
        let mut nx = dx[3 * across + ABSOLUTE_POS];
        let mut ny = dx[4 * across + ABSOLUTE_POS];
        let mut nz = dx[5 * across + ABSOLUTE_POS];
        if comptime!(sizes.form != Form::Colour) {
            let from = point * comptime!(sizes.columns());
            let seen = seen(geometry, directions, point, sizes);
            let mut first = grad[from + comptime!(row_column::FIRST)];
            if comptime!(sizes.form == Form::Density) {
                let log = -seen.sdf;
                let inside =
                    log >= comptime!(LEAST_LOG_DENSITY) && log <= comptime!(MOST_LOG_DENSITY);
                let density = density(seen.sdf, stretch, point, sizes);
                first = select(inside, -first * density, 0.0f32);
            }
            sdf += first;
            let slope = grad[from + comptime!(row_column::SLOPE)];
            let length = grad[from + comptime!(sizes.columns() - 1)] / normal_length(&seen);
            nx += slope * seen.vx + length * seen.nx;
            ny += slope * seen.vy + length * seen.ny;
            nz += slope * seen.vz + length * seen.nz;
        }
        d_geometry[at] = sdf;
        for k in 1..own {
            d_geometry[at + k] = dx[(9 + k) * across + ABSOLUTE_POS];
        }
        d_geometry[at + own] = nx;
        d_geometry[at + own + 1] = ny;
        d_geometry[at + own + 2] = nz;
    }
}
