//! The op on the GPU: layers as products of blocks, and kernels around them; see [`kernels`].
//!
//! Backward keeps nothing but the inputs and evaluates the network again.

mod kernels;

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::cubecl::prelude::BufferArg;
use gpu_tensors::{
    CubeTensor, Packed, PointMatrix, buffer, constant, contiguous, fresh, layer_gradients, padded,
    points_at_once, units_for,
};

use super::backward::{Arguments, ColourFieldBackward};
use super::{ColourFieldOps, Output, Reading, check};
use crate::cube::{Sum, chunks, expect_reachable};
use kernels::{Form, Sizes, finish_kernel, geometry_kernel, input_kernel, outputs_kernel};

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
        ] = arguments;
        check(
            [&geometry, &points, &directions, &extra, &stretch].map(|t| &t.meta.shape()[..]),
            [&w1, &w2, &w3].map(|t| &t.meta.shape()[..]),
            [&b1, &b2, &b3].map(|t| &t.meta.shape()[..]),
        );
        let saved = Self {
            geometry: contiguous(geometry),
            points: contiguous(points),
            directions: contiguous(directions),
            extra: contiguous(extra),
            stretch: contiguous(stretch),
            weights: [w1, b1, w2, b2, w3, b3].map(contiguous),
            output,
        };
        let sizes = saved.sizes();
        let columns = sizes.geometry.max(sizes.extra).max(sizes.columns());
        expect_reachable("colour_field", saved.points(), columns);
        saved
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

    /// Points whose activations are in memory at once: at the default sizes 1.7 kB each on the way back.
    fn at_once(&self) -> usize {
        let sizes = self.sizes();
        let widest = sizes.hidden1.max(sizes.hidden2).max(sizes.inputs()) + 1;
        points_at_once(&self.points, widest)
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
            constant(&self.points, &[1.0f32])
        }
    }

    /// The further inputs as a kernel's argument: there must be something to bind.
    fn extra(&self) -> BufferArg {
        if self.sizes().extra == 0 {
            constant(&self.points, &[0.0f32])
        } else {
            buffer(&self.extra)
        }
    }

    fn forward(&self) -> CubeTensor {
        let (n, sizes) = (self.points(), self.sizes());
        let out = fresh(&self.points, [n, sizes.columns()]);
        let layers = self.layers();
        for (first, count) in chunks(n, self.at_once()) {
            let [.., y] = self.activations(&layers, first, count);
            let client = &out.client;
            let (cubes, dim) = units_for(client, count);
            // SAFETY: threads beyond the points return at once; `check` has seen the shapes.
            unsafe {
                finish_kernel::launch_unchecked(
                    client,
                    cubes,
                    dim,
                    buffer(&self.geometry),
                    buffer(&self.directions),
                    self.stretch(),
                    buffer(&y.data),
                    buffer(&out),
                    first as u32,
                    count as u32,
                    y.points as u32,
                    sizes,
                );
            }
        }
        out
    }

    /// The layers, ready for use.
    fn layers(&self) -> [Packed; 3] {
        let [w1, b1, w2, b2, w3, b3] = &self.weights;
        [(w1, b1), (w2, b2), (w3, b3)].map(|(w, b)| Packed::forward(w, b))
    }

    /// The inputs of all layers at `count` points from `first` on, and the outputs before their sigmoid.
    fn activations(&self, layers: &[Packed; 3], first: usize, count: usize) -> [PointMatrix; 4] {
        let sizes = self.sizes();
        let x = PointMatrix::fresh(&self.points, sizes.inputs() + 1, padded(count));
        let client = &self.points.client;
        let (cubes, dim) = units_for(client, x.points * x.rows);
        // SAFETY: threads beyond the rows return at once; `check` has seen the shapes.
        unsafe {
            input_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&self.geometry),
                buffer(&self.points),
                buffer(&self.directions),
                self.extra(),
                buffer(&x.data),
                first as u32,
                count as u32,
                x.points as u32,
                self.view_share(),
                sizes,
            );
        }
        let h1 = layers[0].relu(&x);
        let h2 = layers[1].relu(&h1);
        let y = layers[2].apply(&h2);
        [x, h1, h2, y]
    }

    /// Writes the geometry's gradient of `count` points from `first` on, and returns each layer's inputs
    /// and its outputs' gradients.
    fn backward(
        &self,
        [forward, back]: &[[Packed; 3]; 2],
        grad: &CubeTensor,
        d_geometry: &CubeTensor,
        first: usize,
        count: usize,
    ) -> [(PointMatrix, PointMatrix); 3] {
        let sizes = self.sizes();
        let [x, h1, h2, d3] = self.activations(forward, first, count);
        let across = x.points;
        let client = &grad.client;
        let (cubes, dim) = units_for(client, across * sizes.outputs);
        // SAFETY: threads beyond the rows return at once.
        unsafe {
            outputs_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(grad),
                buffer(&d3.data),
                first as u32,
                count as u32,
                across as u32,
                sizes,
            );
        }
        let d2 = back[2].gated(&d3, &h2);
        let d1 = back[1].gated(&d2, &h1);
        let dx = back[0].apply(&d1);
        let (cubes, dim) = units_for(client, count);
        // SAFETY: threads beyond the points return at once.
        unsafe {
            geometry_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&self.geometry),
                buffer(&self.directions),
                self.stretch(),
                buffer(grad),
                buffer(&dx.data),
                buffer(d_geometry),
                first as u32,
                count as u32,
                across as u32,
                sizes,
            );
        }
        [(x, d1), (h1, d2), (h2, d3)]
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
        let (n, sizes) = (saved.points(), saved.sizes());
        assert_eq!(
            grad.meta.shape()[..],
            [n, sizes.columns()],
            "colour_field: the result's gradient"
        );
        let grad = contiguous(grad);
        let geometry = fresh(&saved.points, [n, sizes.geometry]);
        let [w1, _, w2, _, w3, _] = &saved.weights;
        let layers = [saved.layers(), [w1, w2, w3].map(Packed::backward)];
        let mut weights = [w1, w2, w3].map(|w| Sum::new(w, [w.shape()[0], w.shape()[1]]));
        let mut biases = [w1, w2, w3].map(|w| Sum::new(w, [w.shape()[0]]));
        for (first, count) in chunks(n, saved.at_once()) {
            let parts = saved.backward(&layers, &grad, &geometry, first, count);
            for (l, (inputs, d_outputs)) in parts.iter().enumerate() {
                let (weight, bias) = layer_gradients(d_outputs, inputs);
                weights[l].add(weight);
                biases[l].add(bias);
            }
        }
        let [w1, w2, w3] = weights.map(Sum::value);
        let [b1, b2, b3] = biases.map(Sum::value);
        [geometry, w1, b1, w2, b2, w3, b3]
    }
}
