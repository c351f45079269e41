//! The op on the GPU: one thread per point.
//!
//! Backward keeps nothing but the inputs and evaluates the network again. A thread leaves the rows
//! whose outer products are the weights' gradients; see [`Row`].

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::{
    CubeTensor, OuterSum, buffer, contiguous, cubecl, fresh, sigmoid, units_for, upload,
};

use super::ColourFieldOps;
use super::backward::{Arguments, ColourFieldBackward};
use crate::cube::{Sum, chunks};
use cubecl::prelude::*;

/// Points whose rows are in memory at once: at the default sizes 38 MB.
const CHUNK: usize = 32_768;

/// What backward needs: the op's inputs.
#[derive(Clone, Debug)]
#[allow(unreachable_pub)] // an associated type of a public backend must be public
pub struct Saved {
    geometry: CubeTensor,
    points: CubeTensor,
    directions: CubeTensor,
    extra: CubeTensor,
    /// `w1, b1, w2, b2, w3, b3`.
    weights: [CubeTensor; 6],
}

impl Saved {
    fn new(arguments: Arguments<Cube>) -> Self {
        let [geometry, points, directions, extra, w1, b1, w2, b2, w3, b3] =
            arguments.map(contiguous);
        Self {
            geometry,
            points,
            directions,
            extra,
            weights: [w1, b1, w2, b2, w3, b3],
        }
    }

    fn points(&self) -> usize {
        self.points.shape()[0]
    }

    fn sizes(&self) -> Sizes {
        let [_, b1, _, b2, _, b3] = self.weights.each_ref().map(|w| w.shape()[0]);
        Sizes {
            geometry: self.geometry.shape()[1],
            extra: self.extra.shape()[1],
            hidden1: b1,
            hidden2: b2,
            outputs: b3,
        }
    }

    /// The further inputs as a kernel's argument: there must be something to bind.
    fn extra(&self) -> BufferArg {
        if self.sizes().extra == 0 {
            upload(&self.points.client, &[0.0f32])
        } else {
            buffer(&self.extra)
        }
    }

    fn forward(&self) -> CubeTensor {
        let (n, sizes) = (self.points(), self.sizes());
        let out = fresh(&self.points, [n, sizes.outputs]);
        if n == 0 {
            return out;
        }
        let client = &out.client;
        let (count, dim) = units_for(client, n);
        let [w1, b1, w2, b2, w3, b3] = self.weights.each_ref().map(buffer);
        // SAFETY: threads beyond the points return at once; `colour_field` has checked the shapes.
        unsafe {
            forward_kernel::launch_unchecked(
                client,
                count,
                dim,
                buffer(&self.geometry),
                buffer(&self.points),
                buffer(&self.directions),
                self.extra(),
                w1,
                b1,
                w2,
                b2,
                w3,
                b3,
                buffer(&out),
                n as u32,
                sizes,
            );
        }
        out
    }

    /// Writes the geometry's gradient of `count` points from `first` on, and returns the rows that
    /// the weights' gradients are made of.
    fn backward(
        &self,
        grad: &CubeTensor,
        geometry: &CubeTensor,
        first: usize,
        count: usize,
    ) -> CubeTensor {
        let sizes = self.sizes();
        let rows = fresh(&self.points, [count, Row::new(sizes).width]);
        let client = &rows.client;
        let (cubes, dim) = units_for(client, count);
        let [w1, b1, w2, b2, w3, b3] = self.weights.each_ref().map(buffer);
        // SAFETY: as in `forward`.
        unsafe {
            backward_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&self.geometry),
                buffer(&self.points),
                buffer(&self.directions),
                self.extra(),
                w1,
                b1,
                w2,
                b2,
                w3,
                b3,
                buffer(grad),
                buffer(&rows),
                buffer(geometry),
                first as u32,
                count as u32,
                sizes,
            );
        }
        rows
    }
}

impl ColourFieldOps for Cube {
    fn colour_field(
        geometry: FloatTensor<Self>,
        points: FloatTensor<Self>,
        directions: FloatTensor<Self>,
        extra: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        w3: FloatTensor<Self>,
        b3: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        Saved::new([geometry, points, directions, extra, w1, b1, w2, b2, w3, b3]).forward()
    }
}

impl ColourFieldBackward for Cube {
    type Saved = Saved;

    fn colour_field_saving(arguments: Arguments<Self>) -> (FloatTensor<Self>, Self::Saved) {
        let saved = Saved::new(arguments);
        (saved.forward(), saved)
    }

    fn colour_field_backward(
        saved: Self::Saved,
        grad: FloatTensor<Self>,
    ) -> [FloatTensor<Self>; 7] {
        let grad = contiguous(grad);
        let (n, sizes) = (saved.points(), saved.sizes());
        let row = Row::new(sizes);
        let geometry = fresh(&saved.points, [n, sizes.geometry]);
        // Each layer's gradient, its input's first column and width.
        let layers = [
            (row.d1, sizes.hidden1, row.input, sizes.inputs()),
            (row.d2, sizes.hidden2, row.h1, sizes.hidden1),
            (row.d3, sizes.outputs, row.h2, sizes.hidden2),
        ];
        let mut weights = layers.map(|(_, a, _, b)| Sum::new(&saved.points, [a, b]));
        let mut biases = layers.map(|(_, a, _, _)| Sum::new(&saved.points, [a]));
        for (first, count) in chunks(n, CHUNK) {
            let rows = saved.backward(&grad, &geometry, first, count);
            for (l, (left, a, right, b)) in layers.into_iter().enumerate() {
                let product = OuterSum::new(&rows, &rows).left_columns(left, a);
                weights[l].add(product.clone().right_columns(right, b).compute([a, b]));
                biases[l].add(product.right_columns(right + b, 1).compute([a]));
            }
        }
        let [w1, w2, w3] = weights.map(Sum::value);
        let [b1, b2, b3] = biases.map(Sum::value);
        [geometry, w1, b1, w2, b2, w3, b3]
    }
}

/// A kernel's constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Sizes {
    /// Columns of the geometry: sdf, features, normal.
    geometry: usize,
    extra: usize,
    hidden1: usize,
    hidden2: usize,
    outputs: usize,
}

impl Sizes {
    fn inputs(self) -> usize {
        6 + self.geometry + self.extra
    }
}

/// Columns of the row that backward leaves for each point: each layer's input followed by a 1, and
/// each layer's gradient before its activation. Their sums of outer products are `dW | db`.
#[derive(Clone, Copy, Debug)]
struct Row {
    input: usize,
    h1: usize,
    h2: usize,
    d1: usize,
    d2: usize,
    d3: usize,
    width: usize,
}

impl Row {
    fn new(sizes: Sizes) -> Self {
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

/// Negative values to zero.
#[cube]
fn relu(values: &mut Array<f32>, #[comptime] count: usize) {
    for i in 0..count {
        values[i] = select(values[i] > 0.0f32, values[i], 0.0f32);
    }
}

/// One thread per point.
#[cube(launch_unchecked)]
fn forward_kernel(
    geometry: &[f32],
    points: &[f32],
    directions: &[f32],
    extra: &[f32],
    w1: &[f32],
    b1: &[f32],
    w2: &[f32],
    b2: &[f32],
    w3: &[f32],
    b3: &[f32],
    out: &mut [f32],
    n: u32,
    #[comptime] sizes: Sizes,
) {
    let point = ABSOLUTE_POS;
    if point < n as usize {
        let mut x = Array::<f32>::new(comptime!(sizes.inputs()));
        let mut h1 = Array::<f32>::new(comptime!(sizes.hidden1));
        let mut h2 = Array::<f32>::new(comptime!(sizes.hidden2));
        let mut y = Array::<f32>::new(comptime!(sizes.outputs));
        input(geometry, points, directions, extra, point, &mut x, sizes);
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
            out[point * comptime!(sizes.outputs) + o] = sigmoid(y[o]);
        }
    }
}

/// One thread per point.
#[cube(launch_unchecked)]
fn backward_kernel(
    geometry: &[f32],
    points: &[f32],
    directions: &[f32],
    extra: &[f32],
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
        layer(w1, b1, &x, &mut h1, inputs, hidden1);
        relu(&mut h1, hidden1);
        layer(w2, b2, &h1, &mut h2, hidden1, hidden2);
        relu(&mut h2, hidden2);
        layer(w3, b3, &h2, &mut y, hidden2, outputs);

        let mut d1 = Array::<f32>::new(hidden1);
        let mut d2 = Array::<f32>::new(hidden2);
        for o in 0..outputs {
            let colour = sigmoid(y[o]);
            let d = grad[point * outputs + o] * colour * (1.0f32 - colour);
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
    }
}
