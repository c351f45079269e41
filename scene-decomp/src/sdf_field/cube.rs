//! The op on the GPU: one thread per point.
//!
//! Backward keeps nothing but the inputs: it encodes again, which is cheaper than the memory that
//! a Jacobian takes. A thread scatters its table gradient and leaves the rows whose outer products
//! are the weights' gradients; see [`Row`].

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::{
    AtomicSum, CompareAndSwap, CubeTensor, NativeSum, OuterSum, buffer, contiguous, cubecl, fresh,
    has_native_sum, sigmoid, softplus, units_for, upload, zeros,
};
use hashgrid::cube::{Blend, blend, is_smooth, level_words, locate, scatter};

use super::backward::{DenseTable, SdfFieldBackward, SdfFieldGradients};
use super::{Normal, SdfFieldConfig, SdfFieldOps};
use crate::cube::{Sum, chunks};
use cubecl::prelude::*;

/// Points whose rows are in memory at once: at the default sizes 47 MB.
const CHUNK: usize = 32_768;

/// What backward needs: the op's inputs.
#[derive(Clone, Debug)]
#[allow(unreachable_pub)] // an associated type of a public backend must be public
pub struct Saved {
    points: CubeTensor,
    table: CubeTensor,
    w1: CubeTensor,
    b1: CubeTensor,
    w2: CubeTensor,
    b2: CubeTensor,
    config: SdfFieldConfig,
}

impl Saved {
    fn hidden(&self) -> usize {
        self.b1.shape()[0]
    }

    fn outputs(&self) -> usize {
        self.b2.shape()[0]
    }

    fn sizes(&self) -> Sizes {
        Sizes {
            levels: self.config.layout.levels.len(),
            hidden: self.hidden(),
            outputs: self.outputs(),
            normal: self.config.normal == Normal::Computed,
            smooth: is_smooth(&self.config.layout),
        }
    }

    fn scale(&self) -> f32 {
        0.5 / self.config.half_side
    }

    fn forward(&self) -> CubeTensor {
        let n = self.points.shape()[0];
        let out = fresh(&self.points, [n, self.outputs() + 3]);
        if n == 0 {
            return out;
        }
        let client = &out.client;
        let (count, dim) = units_for(client, n);
        // SAFETY: threads beyond the points return at once; `level_words` has checked the levels,
        // and `sdf_field` the shapes.
        unsafe {
            forward_kernel::launch_unchecked(
                client,
                count,
                dim,
                buffer(&self.points),
                buffer(&self.table),
                upload(client, &level_words(&self.config.layout)),
                buffer(&self.w1),
                buffer(&self.b1),
                buffer(&self.w2),
                buffer(&self.b2),
                buffer(&out),
                n as u32,
                self.config.active_levels as u32,
                self.scale(),
                self.config.beta,
                self.sizes(),
            );
        }
        out
    }

    /// Scatters the gradients of `count` points from `first` on into `table`, if there is one, and
    /// returns the rows that the weights' gradients are made of.
    fn backward(
        &self,
        grad: &CubeTensor,
        first: usize,
        count: usize,
        table: Option<&CubeTensor>,
    ) -> CubeTensor {
        let sizes = self.sizes();
        let row = Row::new(sizes);
        let rows = fresh(&self.points, [count * row.per_point, row.width]);
        if has_native_sum(&rows.client) {
            self.launch_backward::<NativeSum>(grad, first, count, table, &rows);
        } else {
            self.launch_backward::<CompareAndSwap>(grad, first, count, table, &rows);
        }
        rows
    }

    fn launch_backward<A: AtomicSum>(
        &self,
        grad: &CubeTensor,
        first: usize,
        count: usize,
        table: Option<&CubeTensor>,
        rows: &CubeTensor,
    ) {
        let client = &rows.client;
        let (cubes, dim) = units_for(client, count);
        let sink = match table {
            Some(table) => buffer(table),
            None => upload(client, &[0.0f32]),
        };
        // SAFETY: as in `forward`; without a table the kernel has no scatter.
        unsafe {
            backward_kernel::launch_unchecked::<A>(
                client,
                cubes,
                dim,
                buffer(&self.points),
                buffer(&self.table),
                upload(client, &level_words(&self.config.layout)),
                buffer(&self.w1),
                buffer(&self.b1),
                buffer(&self.w2),
                buffer(grad),
                buffer(rows),
                sink,
                first as u32,
                count as u32,
                self.config.active_levels as u32,
                self.scale(),
                self.config.beta,
                self.sizes(),
                table.is_some(),
            );
        }
    }
}

impl SdfFieldOps for Cube {
    fn sdf_field(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        config: SdfFieldConfig,
    ) -> FloatTensor<Self> {
        Self::sdf_field_saving(points, table, w1, b1, w2, b2, config).0
    }
}

impl SdfFieldBackward for Cube {
    type Saved = Saved;

    fn sdf_field_saving(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        config: SdfFieldConfig,
    ) -> (FloatTensor<Self>, Self::Saved) {
        let saved = Saved {
            points: contiguous(points),
            table: contiguous(table),
            w1: contiguous(w1),
            b1: contiguous(b1),
            w2: contiguous(w2),
            b2: contiguous(b2),
            config,
        };
        (saved.forward(), saved)
    }

    fn sdf_field_backward(
        saved: Self::Saved,
        grad: FloatTensor<Self>,
        dense_table: DenseTable,
    ) -> SdfFieldGradients<Self> {
        let grad = contiguous(grad);
        match &saved.config.sparse {
            Some(sparse) => sparse.accumulate_on_device(&saved.points, |table| {
                gradients(&saved, &grad, Some(table), None)
            }),
            None if dense_table == DenseTable::Wanted => {
                let table = zeros(&saved.points, [saved.config.layout.entries(), 2]);
                gradients(&saved, &grad, Some(&table), Some(table.clone()))
            }
            None => gradients(&saved, &grad, None, None),
        }
    }
}

fn gradients(
    saved: &Saved,
    grad: &CubeTensor,
    sink: Option<&CubeTensor>,
    table: Option<CubeTensor>,
) -> SdfFieldGradients<Cube> {
    let (hidden, outputs) = (saved.hidden(), saved.outputs());
    let inputs = saved.w1.shape()[1];
    let row = Row::new(saved.sizes());
    let mut w1 = Sum::new(&saved.points, [hidden, inputs]);
    let mut b1 = Sum::new(&saved.points, [hidden]);
    let mut w2 = Sum::new(&saved.points, [outputs, hidden]);
    let mut b2 = Sum::new(&saved.points, [outputs]);
    for (first, count) in chunks(saved.points.shape()[0], CHUNK) {
        let rows = saved.backward(grad, first, count, sink);
        let product = |left: usize, a: usize, right: usize, b: usize| {
            OuterSum::new(&rows, &rows)
                .left_columns(left, a)
                .right_columns(right, b)
        };
        w1.add(product(row.hidden_gradient, hidden, row.input, inputs).compute([hidden, inputs]));
        b1.add(product(row.hidden_gradient, hidden, row.input + inputs, 1).compute([hidden]));
        w2.add(product(row.output, outputs, row.activation, hidden).compute([outputs, hidden]));
        b2.add(product(row.output, outputs, row.activation + hidden, 1).compute([outputs]));
    }
    SdfFieldGradients {
        table,
        w1: w1.value(),
        b1: b1.value(),
        w2: w2.value(),
        b2: b2.value(),
    }
}

/// A kernel's constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Sizes {
    levels: usize,
    hidden: usize,
    outputs: usize,
    normal: bool,
    smooth: bool,
}

impl Sizes {
    fn inputs(self) -> usize {
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
struct Row {
    hidden_gradient: usize,
    input: usize,
    output: usize,
    activation: usize,
    width: usize,
    per_point: usize,
}

impl Row {
    fn new(sizes: Sizes) -> Self {
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
fn forward_kernel(
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
fn backward_kernel<A: AtomicSum>(
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
