//! The op on the GPU: one thread per point.
//!
//! Backward keeps nothing but the inputs and evaluates the network again. A thread leaves the rows
//! whose outer products are the weights' gradients; see [`Row`].

mod kernels;

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::cubecl::prelude::BufferArg;
use gpu_tensors::{CubeTensor, OuterSum, buffer, contiguous, fresh, units_for, upload};

use super::backward::{Arguments, ColourFieldBackward};
use super::{ColourFieldOps, Output, Reading};
use crate::cube::{Sum, chunks};
use kernels::{Form, Row, Sizes, backward_kernel, forward_kernel};

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
    stretch: CubeTensor,
    /// `w1, b1, w2, b2, w3, b3`.
    weights: [CubeTensor; 6],
    output: Output,
}

impl Saved {
    fn new(arguments: Arguments<Cube>, output: Output) -> Self {
        let [
            geometry,
            points,
            directions,
            extra,
            stretch,
            w1,
            b1,
            w2,
            b2,
            w3,
            b3,
        ] = arguments.map(contiguous);
        Self {
            geometry,
            points,
            directions,
            extra,
            stretch,
            weights: [w1, b1, w2, b2, w3, b3],
            output,
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
            form: match self.output {
                Output::Colour => Form::Colour,
                Output::Row(row) if row.reading == Reading::Density => Form::Density,
                Output::Row(_) => Form::Distance,
            },
            stretched: self.stretch.shape()[1] > 0,
        }
    }

    /// Factor on the directions that the network sees.
    fn view_share(&self) -> f32 {
        match self.output {
            Output::Colour => 1.0,
            Output::Row(row) => row.view_share,
        }
    }

    /// The stretches as a kernel's argument.
    fn stretch(&self) -> BufferArg {
        if self.sizes().stretched {
            buffer(&self.stretch)
        } else {
            upload(&self.points.client, &[1.0f32])
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
        let out = fresh(&self.points, [n, sizes.columns()]);
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
                self.stretch(),
                w1,
                b1,
                w2,
                b2,
                w3,
                b3,
                buffer(&out),
                n as u32,
                self.view_share(),
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
                self.stretch(),
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
                self.view_share(),
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
        stretch: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        w3: FloatTensor<Self>,
        b3: FloatTensor<Self>,
        output: Output,
    ) -> FloatTensor<Self> {
        let arguments = [
            geometry, points, directions, extra, stretch, w1, b1, w2, b2, w3, b3,
        ];
        Saved::new(arguments, output).forward()
    }
}

impl ColourFieldBackward for Cube {
    type Saved = Saved;

    fn colour_field_saving(
        arguments: Arguments<Self>,
        output: Output,
    ) -> (FloatTensor<Self>, Self::Saved) {
        let saved = Saved::new(arguments, output);
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
