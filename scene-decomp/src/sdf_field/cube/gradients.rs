//! The way back: the network again, then its gradients and the table's.

use burn::backend::{Cube, TensorMetadata};
use gpu_tensors::{
    AtomicSum, CompareAndSwap, CubeTensor, LANES, NativeSum, Packed, PointMatrix, buffer, constant,
    has_native_sum, layer_gradients, padded, units_for,
};
use hashgrid::FEATURES;
use hashgrid::cube::level_words;

use super::kernels::{hidden_kernel, normals_kernel, outputs_kernel, scatter_kernel};
use super::{Saved, SdfFieldGradients};
use crate::cube::{Sum, chunks};

/// A part of the points.
#[derive(Clone, Copy)]
struct Part {
    first: usize,
    count: usize,
    /// Columns of a matrix, padding included.
    across: usize,
    /// The same with the second columns that normals have.
    stride: usize,
}

/// All gradients for `grad`; the table's are added to `sink`, if there is one, and `table` is passed on.
pub(super) fn gradients(
    saved: &Saved,
    grad: &CubeTensor,
    sink: Option<&CubeTensor>,
    table: Option<CubeTensor>,
) -> SdfFieldGradients<Cube> {
    let sizes = saved.sizes();
    let (hidden, inputs, outputs) = (sizes.hidden, sizes.inputs(), sizes.outputs);
    let mut w1 = Sum::new(&saved.points, [hidden, inputs]);
    let mut b1 = Sum::new(&saved.points, [hidden]);
    let mut w2 = Sum::new(&saved.points, [outputs, hidden]);
    let mut b2 = Sum::new(&saved.points, [outputs]);
    let layers = Layers {
        hidden: Packed::forward(&saved.w1, &saved.b1),
        hidden_back: Packed::backward(&saved.w1),
        output_back: Packed::backward(&saved.w2),
    };
    for (first, count) in chunks(saved.points.shape()[0], saved.at_once()) {
        let across = padded(count);
        let part = Part {
            first,
            count,
            across,
            stride: if sizes.normal { 2 * across } else { across },
        };
        let back = saved.back(&layers, grad, part);
        if let Some(sink) = sink {
            let dx = layers
                .hidden_back
                .first_outputs(&back.d_hidden, saved.active_inputs());
            if has_native_sum(&sink.client) {
                saved.scatter::<NativeSum>(grad, &dx, part, sink);
            } else {
                saved.scatter::<CompareAndSwap>(grad, &dx, part, sink);
            }
        }
        let (w, b) = layer_gradients(&back.d_hidden, &back.inputs);
        w1.add(w);
        b1.add(b);
        let (w, b) = layer_gradients(&back.d_outputs, &back.activation);
        w2.add(w);
        b2.add(b);
    }
    SdfFieldGradients {
        table,
        w1: w1.value(),
        b1: b1.value(),
        w2: w2.value(),
        b2: b2.value(),
    }
}

/// The layers, ready for use.
struct Layers {
    hidden: Packed,
    hidden_back: Packed,
    output_back: Packed,
}

/// Each layer's inputs and its outputs' gradients. The outer products of second columns are what the
/// normal adds to the weights' gradients.
///
/// ```text
/// inputs, d_hidden        x, 1 | dg, 0    dz    | u
/// activation, d_outputs   a, 1 | du σ, 0  d_out | 1, 0..
/// ```
struct Back {
    inputs: PointMatrix,
    d_hidden: PointMatrix,
    activation: PointMatrix,
    d_outputs: PointMatrix,
}

impl Saved {
    fn back(&self, layers: &Layers, grad: &CubeTensor, part: Part) -> Back {
        let sizes = self.sizes();
        let Part {
            first,
            count,
            across,
            stride,
        } = part;
        let (inputs, jacobian) = self.encode(first, count, stride);
        let d_outputs = PointMatrix::fresh(grad, sizes.outputs, stride);
        let client = &grad.client;
        let (cubes, dim) = units_for(client, across * sizes.outputs);
        // SAFETY: threads beyond the rows return at once.
        unsafe {
            outputs_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(grad),
                buffer(&d_outputs.data),
                first as u32,
                count as u32,
                across as u32,
                stride as u32,
                sizes,
            );
        }
        if sizes.normal {
            let (cubes, dim) = units_for(client, across * (sizes.inputs() + 1));
            // SAFETY: threads beyond the rows return at once.
            unsafe {
                normals_kernel::launch_unchecked(
                    client,
                    cubes,
                    dim,
                    buffer(grad),
                    buffer(&jacobian.data),
                    buffer(&inputs.data),
                    first as u32,
                    count as u32,
                    across as u32,
                    self.config.active_levels as u32,
                    self.scale(),
                    sizes,
                );
            }
        }
        let d_hidden = layers.hidden.apply_first(&inputs, self.active_inputs());
        let d_activation = layers.output_back.apply_to(&d_outputs, across);
        let activation = PointMatrix::fresh(grad, sizes.hidden + 1, stride);
        let (cubes, dim) = units_for(client, across / LANES * sizes.hidden);
        // SAFETY: threads beyond the rows return at once.
        unsafe {
            hidden_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&d_hidden.data),
                buffer(&d_activation.data),
                buffer(&self.w2),
                buffer(&activation.data),
                (across / LANES) as u32,
                self.config.beta,
                sizes,
            );
        }
        Back {
            inputs,
            d_hidden,
            activation,
            d_outputs,
        }
    }

    /// Adds to the table's gradient.
    fn scatter<A: AtomicSum>(
        &self,
        grad: &CubeTensor,
        dx: &PointMatrix,
        part: Part,
        table: &CubeTensor,
    ) {
        let active = self.config.active_levels;
        if active == 0 {
            return;
        }
        let client = &table.client;
        let (cubes, dim) = units_for(client, FEATURES * part.across * active);
        // SAFETY: threads beyond points and levels return at once; `level_words` has checked the levels.
        unsafe {
            scatter_kernel::launch_unchecked::<A>(
                client,
                cubes,
                dim,
                buffer(&self.points),
                constant(table, &level_words(&self.config.layout)),
                buffer(grad),
                buffer(&dx.data),
                buffer(table),
                part.first as u32,
                part.count as u32,
                part.across as u32,
                active as u32,
                self.scale(),
                self.sizes(),
            );
        }
    }
}
