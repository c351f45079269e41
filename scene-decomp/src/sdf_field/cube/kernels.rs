//! The kernels: one thread per point, forward and backward.

use gpu_tensors::{AtomicSum, cubecl, sigmoid, softplus};
use hashgrid::cube::{Blend, blend, locate, scatter};

use cubecl::prelude::*;

/// A kernel's constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Sizes {
    pub(super) levels: usize,
    pub(super) hidden: usize,
    pub(super) outputs: usize,
    pub(super) normal: bool,
    pub(super) smooth: bool,
}

impl Sizes {
    pub(super) fn inputs(self) -> usize {
        3 + 2 * self.levels
    }
}

/// Columns of the rows that backward leaves for each point: one, and with normals a second one.
///
/// ```text
/// first   dz | x,  1 | d_out  | a,          1
/// second  u  | dg, 0 | 1, 0.. | du · slope, 0
/// ```
///
/// so that the sums of outer products over all rows are `dW1 | db1` and `dW2 | db2`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) hidden_gradient: usize,
    pub(super) input: usize,
    pub(super) output: usize,
    pub(super) activation: usize,
    pub(super) width: usize,
    pub(super) per_point: usize,
}

impl Row {
    pub(super) fn new(sizes: Sizes) -> Self {
        let input = sizes.hidden;
        let output = input + sizes.inputs() + 1;
        let activation = output + sizes.outputs;
        Self {
            hidden_gradient: 0,
            input,
            output,
            activation,
            width: activation + sizes.hidden + 1,
            per_point: if sizes.normal { 2 } else { 1 },
        }
    }
}

/// Encodes a point into the network's input and, where normals are wanted, its Jacobian `[2 L, 3]`
/// by the position in the unit cube.
#[cube]
fn encode(
    points: &[f32],
    point: usize,
    table: &[f32],
    levels: &[u32],
    active: usize,
    scale: f32,
    x: &mut Array<f32>,
    jacobian: &mut Array<f32>,
    #[comptime] sizes: Sizes,
) {
    let p = point * 3;
    x[0] = points[p];
    x[1] = points[p + 1];
    x[2] = points[p + 2];
    for level in 0..active {
        let cell = locate(
            x[0] * scale + 0.5f32,
            x[1] * scale + 0.5f32,
            x[2] * scale + 0.5f32,
            levels,
            level,
            sizes.smooth,
        );
        let both = blend(&cell, table);
        x[3 + 2 * level] = both.value0;
        x[4 + 2 * level] = both.value1;
        if comptime!(sizes.normal) {
            let at = 6 * level;
            jacobian[at] = both.x0;
            jacobian[at + 1] = both.y0;
            jacobian[at + 2] = both.z0;
            jacobian[at + 3] = both.x1;
            jacobian[at + 4] = both.y1;
            jacobian[at + 5] = both.z1;
        }
    }
}

/// The product of a weight's row, from `start` on, with the first `count` inputs.
#[cube]
fn dot(weights: &[f32], start: usize, x: &Array<f32>, count: usize) -> f32 {
    let mut sum = 0.0f32;
    for k in 0..count {
        sum += weights[start + k] * x[k];
    }
    sum
}

/// One thread per point.
#[cube(launch_unchecked)]
pub(super) fn forward_kernel(
    points: &[f32],
    table: &[f32],
    levels: &[u32],
    w1: &[f32],
    b1: &[f32],
    w2: &[f32],
    b2: &[f32],
    out: &mut [f32],
    n: u32,
    active: u32,
    scale: f32,
    beta: f32,
    #[comptime] sizes: Sizes,
) {
    let point = ABSOLUTE_POS;
    if point < n as usize {
        let all = comptime!(sizes.inputs());
        let hidden = comptime!(sizes.hidden);
        let outputs = comptime!(sizes.outputs);
        let active = active as usize;
        let inputs = 3 + 2 * active;
        let mut x = Array::<f32>::new(all);
        let mut jacobian =
            Array::<f32>::new(comptime!(if sizes.normal { 6 * sizes.levels } else { 1 }));
        encode(
            points,
            point,
            table,
            levels,
            active,
            scale,
            &mut x,
            &mut jacobian,
            sizes,
        );
        let mut value = Array::<f32>::new(outputs);
        for o in 0..outputs {
            value[o] = b2[o];
        }
        let mut g = Array::<f32>::new(all);
        for j in 0..hidden {
            let z = beta * (b1[j] + dot(w1, j * all, &x, inputs));
            let a = softplus(z) / beta;
            for o in 0..outputs {
                value[o] += w2[o * hidden + j] * a;
            }
            if comptime!(sizes.normal) {
                let u = w2[j] * sigmoid(z);
                for k in 0..inputs {
                    g[k] += w1[j * all + k] * u;
                }
            }
        }
        let at = point * (outputs + 3);
        for o in 0..outputs {
            out[at + o] = value[o];
        }
        #[unroll]
        for axis in 0..3usize {
            let mut normal = 0.0f32;
            if comptime!(sizes.normal) {
                for k in 0..2 * active {
                    normal += g[3 + k] * jacobian[3 * k + axis];
                }
                normal = g[axis] + scale * normal;
            }
            out[at + outputs + axis] = normal;
        }
    }
}

/// One thread per point; see the CPU kernel's backward for the chain rule.
#[cube(launch_unchecked)]
pub(super) fn backward_kernel<A: AtomicSum>(
    points: &[f32],
    table: &[f32],
    levels: &[u32],
    w1: &[f32],
    b1: &[f32],
    w2: &[f32],
    grad: &[f32],
    rows: &mut [f32],
    table_gradient: &[Atomic<A::Word>],
    first: u32,
    count: u32,
    active: u32,
    scale: f32,
    beta: f32,
    #[comptime] sizes: Sizes,
    #[comptime] scattered: bool,
) {
    if ABSOLUTE_POS < count as usize {
        let point = first as usize + ABSOLUTE_POS;
        let row = comptime!(Row::new(sizes));
        let all = comptime!(sizes.inputs());
        let hidden = comptime!(sizes.hidden);
        let outputs = comptime!(sizes.outputs);
        let active = active as usize;
        let inputs = 3 + 2 * active;
        let mut x = Array::<f32>::new(all);
        let mut jacobian =
            Array::<f32>::new(comptime!(if sizes.normal { 6 * sizes.levels } else { 1 }));
        encode(
            points,
            point,
            table,
            levels,
            active,
            scale,
            &mut x,
            &mut jacobian,
            sizes,
        );

        let at = point * (outputs + 3);
        let (nx, ny, nz) = (
            grad[at + outputs],
            grad[at + outputs + 1],
            grad[at + outputs + 2],
        );
        let mut dg = Array::<f32>::new(all);
        if comptime!(sizes.normal) {
            dg[0] = nx;
            dg[1] = ny;
            dg[2] = nz;
            for k in 0..2 * active {
                let j = 3 * k;
                dg[3 + k] =
                    scale * (jacobian[j] * nx + jacobian[j + 1] * ny + jacobian[j + 2] * nz);
            }
        }

        // The point's one or two rows.
        let base = ABSOLUTE_POS * comptime!(row.per_point * row.width);
        let second = base + comptime!(row.width);
        let mut g = Array::<f32>::new(all);
        let mut dx = Array::<f32>::new(all);
        for j in 0..hidden {
            let z = beta * (b1[j] + dot(w1, j * all, &x, inputs));
            let a = softplus(z) / beta;
            let slope = sigmoid(z);
            let mut da = 0.0f32;
            for o in 0..outputs {
                da += w2[o * hidden + j] * grad[at + o];
            }
            let mut dz = da * slope;
            if comptime!(sizes.normal) {
                let w = w2[j];
                let u = w * slope;
                let du = dot(w1, j * all, &dg, inputs);
                dz += du * u * beta * (1.0f32 - slope);
                for k in 3..inputs {
                    g[k] += w1[j * all + k] * u;
                }
                rows[second + j] = u;
                rows[second + comptime!(row.activation) + j] = du * slope;
            }
            for k in 3..inputs {
                dx[k] += w1[j * all + k] * dz;
            }
            rows[base + j] = dz;
            rows[base + comptime!(row.activation) + j] = a;
        }
        for k in 0..all {
            rows[base + comptime!(row.input) + k] = x[k];
        }
        rows[base + comptime!(row.input) + all] = 1.0f32;
        rows[base + comptime!(row.activation) + hidden] = 1.0f32;
        for o in 0..outputs {
            rows[base + comptime!(row.output) + o] = grad[at + o];
        }
        if comptime!(sizes.normal) {
            for k in 0..all {
                rows[second + comptime!(row.input) + k] = dg[k];
            }
            rows[second + comptime!(row.input) + all] = 0.0f32;
            rows[second + comptime!(row.activation) + hidden] = 0.0f32;
            for o in 0..outputs {
                rows[second + comptime!(row.output) + o] = select(o == 0, 1.0f32, 0.0f32);
            }
        }

        if comptime!(scattered) {
            for level in 0..active {
                let cell = locate(
                    x[0] * scale + 0.5f32,
                    x[1] * scale + 0.5f32,
                    x[2] * scale + 0.5f32,
                    levels,
                    level,
                    sizes.smooth,
                );
                let k = 3 + 2 * level;
                let (g0, g1) = (scale * g[k], scale * g[k + 1]);
                let d = Blend {
                    value0: dx[k],
                    value1: dx[k + 1],
                    x0: g0 * nx,
                    y0: g0 * ny,
                    z0: g0 * nz,
                    x1: g1 * nx,
                    y1: g1 * ny,
                    z1: g1 * nz,
                };
                scatter::<A>(table_gradient, &cell, &d);
            }
        }
    }
}
