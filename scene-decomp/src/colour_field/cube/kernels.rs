//! The kernels: one thread per point.

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
}

/// Columns of the row that backward leaves for each point: each layer's input followed by a 1, and
/// each layer's gradient before its activation. Their sums of outer products are `dW | db`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) input: usize,
    pub(super) h1: usize,
    pub(super) h2: usize,
    pub(super) d1: usize,
    pub(super) d2: usize,
    pub(super) d3: usize,
    pub(super) width: usize,
}

impl Row {
    pub(super) fn new(sizes: Sizes) -> Self {
        let h1 = sizes.inputs() + 1;
        let h2 = h1 + sizes.hidden1 + 1;
        let d1 = h2 + sizes.hidden2 + 1;
        let d2 = d1 + sizes.hidden1;
        let d3 = d2 + sizes.hidden2;
        Self {
            input: 0,
            h1,
            h2,
            d1,
            d2,
            d3,
            width: d3 + sizes.outputs,
        }
    }
}

/// The network's input for a point: position, normal, direction, sdf, features, extra.
#[cube]
fn input(
    geometry: &[f32],
    points: &[f32],
    directions: &[f32],
    extra: &[f32],
    point: usize,
    x: &mut Array<f32>,
    #[comptime] sizes: Sizes,
) {
    let columns = comptime!(sizes.geometry);
    let own = comptime!(sizes.geometry - 3);
    let row = point * columns;
    #[unroll]
    for axis in 0..3usize {
        x[axis] = points[point * 3 + axis];
        x[3 + axis] = geometry[row + own + axis];
        x[6 + axis] = directions[point * 3 + axis];
    }
    for k in 0..own {
        x[9 + k] = geometry[row + k];
    }
    if comptime!(sizes.extra > 0) {
        for k in 0..comptime!(sizes.extra) {
            x[comptime!(9 + sizes.geometry - 3) + k] = extra[point * comptime!(sizes.extra) + k];
        }
    }
}

/// A layer before its activation.
#[cube]
fn layer(
    weight: &[f32],
    bias: &[f32],
    x: &Array<f32>,
    y: &mut Array<f32>,
    #[comptime] inputs: usize,
    #[comptime] outputs: usize,
) {
    for o in 0..outputs {
        let mut sum = bias[o];
        for k in 0..inputs {
            sum += weight[o * inputs + k] * x[k];
        }
        y[o] = sum;
    }
}

/// Writes the columns around the network's outputs, from its inputs.
#[cube]
fn surroundings(
    x: &Array<f32>,
    stretch: &[f32],
    point: usize,
    out: &mut [f32],
    #[comptime] sizes: Sizes,
) {
    let at = point * comptime!(sizes.columns());
    let mut first = x[9];
    if comptime!(sizes.form == Form::Density) {
        first = clamp(
            -first,
            comptime!(LEAST_LOG_DENSITY),
            comptime!(MOST_LOG_DENSITY),
        )
        .exp();
        if comptime!(sizes.stretched) {
            first *= stretch[point];
        }
    }
    out[at + comptime!(row_column::FIRST)] = first;
    out[at + comptime!(row_column::SLOPE)] = x[3] * x[6] + x[4] * x[7] + x[5] * x[8];
    out[at + comptime!(sizes.columns() - 1)] = normal_length(x);
}

/// The length of the normal among the network's inputs.
#[cube]
fn normal_length(x: &Array<f32>) -> f32 {
    (x[3] * x[3] + x[4] * x[4] + x[5] * x[5] + comptime!(LENGTH_OFFSET)).sqrt()
}

/// Negative values to zero.
#[cube]
fn relu(values: &mut Array<f32>, #[comptime] count: usize) {
    for i in 0..count {
        values[i] = select(values[i] > 0.0f32, values[i], 0.0f32);
    }
}

/// One thread per point.
#[cube(launch_unchecked)]
pub(super) fn forward_kernel(
    geometry: &[f32],
    points: &[f32],
    directions: &[f32],
    extra: &[f32],
    stretch: &[f32],
    w1: &[f32],
    b1: &[f32],
    w2: &[f32],
    b2: &[f32],
    w3: &[f32],
    b3: &[f32],
    out: &mut [f32],
    n: u32,
    view_share: f32,
    #[comptime] sizes: Sizes,
) {
    let point = ABSOLUTE_POS;
    if point < n as usize {
        let mut x = Array::<f32>::new(comptime!(sizes.inputs()));
        let mut h1 = Array::<f32>::new(comptime!(sizes.hidden1));
        let mut h2 = Array::<f32>::new(comptime!(sizes.hidden2));
        let mut y = Array::<f32>::new(comptime!(sizes.outputs));
        input(geometry, points, directions, extra, point, &mut x, sizes);
        if comptime!(sizes.form != Form::Colour) {
            surroundings(&x, stretch, point, out, sizes);
        }
        for axis in 6..9usize {
            x[axis] *= view_share;
        }
        layer(
            w1,
            b1,
            &x,
            &mut h1,
            comptime!(sizes.inputs()),
            sizes.hidden1,
        );
        relu(&mut h1, sizes.hidden1);
        layer(w2, b2, &h1, &mut h2, sizes.hidden1, sizes.hidden2);
        relu(&mut h2, sizes.hidden2);
        layer(w3, b3, &h2, &mut y, sizes.hidden2, sizes.outputs);
        for o in 0..comptime!(sizes.outputs) {
            out[point * comptime!(sizes.columns()) + comptime!(sizes.first_output()) + o] =
                sigmoid(y[o]);
        }
    }
}

/// One thread per point.
#[cube(launch_unchecked)]
pub(super) fn backward_kernel(
    geometry: &[f32],
    points: &[f32],
    directions: &[f32],
    extra: &[f32],
    stretch: &[f32],
    w1: &[f32],
    b1: &[f32],
    w2: &[f32],
    b2: &[f32],
    w3: &[f32],
    b3: &[f32],
    grad: &[f32],
    rows: &mut [f32],
    d_geometry: &mut [f32],
    first: u32,
    count: u32,
    view_share: f32,
    #[comptime] sizes: Sizes,
) {
    if ABSOLUTE_POS < count as usize {
        let point = first as usize + ABSOLUTE_POS;
        let row = comptime!(Row::new(sizes));
        let base = ABSOLUTE_POS * comptime!(row.width);
        let inputs = comptime!(sizes.inputs());
        let hidden1 = comptime!(sizes.hidden1);
        let hidden2 = comptime!(sizes.hidden2);
        let outputs = comptime!(sizes.outputs);
        let mut x = Array::<f32>::new(inputs);
        let mut h1 = Array::<f32>::new(hidden1);
        let mut h2 = Array::<f32>::new(hidden2);
        let mut y = Array::<f32>::new(outputs);
        input(geometry, points, directions, extra, point, &mut x, sizes);
        for axis in 6..9usize {
            x[axis] *= view_share;
        }
        layer(w1, b1, &x, &mut h1, inputs, hidden1);
        relu(&mut h1, hidden1);
        layer(w2, b2, &h1, &mut h2, hidden1, hidden2);
        relu(&mut h2, hidden2);
        layer(w3, b3, &h2, &mut y, hidden2, outputs);

        let from = point * comptime!(sizes.columns());
        let mut d1 = Array::<f32>::new(hidden1);
        let mut d2 = Array::<f32>::new(hidden2);
        for o in 0..outputs {
            let colour = sigmoid(y[o]);
            let d = grad[from + comptime!(sizes.first_output()) + o] * colour * (1.0f32 - colour);
            rows[base + comptime!(row.d3) + o] = d;
            for j in 0..hidden2 {
                d2[j] += w3[o * hidden2 + j] * d;
            }
        }
        for j in 0..hidden2 {
            let d = select(h2[j] > 0.0f32, d2[j], 0.0f32);
            rows[base + comptime!(row.d2) + j] = d;
            rows[base + comptime!(row.h2) + j] = h2[j];
            for i in 0..hidden1 {
                d1[i] += w2[j * hidden1 + i] * d;
            }
        }
        rows[base + comptime!(row.h2) + hidden2] = 1.0f32;
        let mut dx = Array::<f32>::new(inputs);
        for i in 0..hidden1 {
            let d = select(h1[i] > 0.0f32, d1[i], 0.0f32);
            rows[base + comptime!(row.d1) + i] = d;
            rows[base + comptime!(row.h1) + i] = h1[i];
            for k in 3..inputs {
                dx[k] += w1[i * inputs + k] * d;
            }
        }
        rows[base + comptime!(row.h1) + hidden1] = 1.0f32;
        for k in 0..inputs {
            rows[base + comptime!(row.input) + k] = x[k];
        }
        rows[base + comptime!(row.input) + inputs] = 1.0f32;
        // Input columns: p, n, v, sdf, feature, extra; geometry columns: sdf, feature, n.
        let own = comptime!(sizes.geometry - 3);
        let at = point * comptime!(sizes.geometry);
        for k in 0..own {
            d_geometry[at + k] = dx[9 + k];
        }
        #[unroll]
        for axis in 0..3usize {
            d_geometry[at + own + axis] = dx[3 + axis];
        }
        if comptime!(sizes.form != Form::Colour) {
            let mut first = grad[from + comptime!(row_column::FIRST)];
            if comptime!(sizes.form == Form::Density) {
                let log = -x[9];
                let inside = clamp(
                    log,
                    comptime!(LEAST_LOG_DENSITY),
                    comptime!(MOST_LOG_DENSITY),
                );
                let mut density = inside.exp();
                if comptime!(sizes.stretched) {
                    density *= stretch[point];
                }
                first = select(inside == log, -first * density, 0.0f32);
            }
            d_geometry[at] += first;
            let slope = grad[from + comptime!(row_column::SLOPE)];
            let length = grad[from + comptime!(sizes.columns() - 1)] / normal_length(&x);
            #[unroll]
            for axis in 0..3usize {
                d_geometry[at + own + axis] +=
                    slope * directions[point * 3 + axis] + length * x[3 + axis];
            }
        }
    }
}
