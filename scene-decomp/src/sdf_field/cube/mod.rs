//! The op on the GPU: layers as products of blocks, and kernels around them; see [`kernels`].
//!
//! Backward keeps nothing but the inputs: it encodes again, which is cheaper than the memory that
//! a Jacobian takes.

mod gradients;
mod kernels;

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::{
    CubeTensor, LANES, Packed, PointMatrix, buffer, constant, contiguous, fresh, padded,
    points_at_once, units_for, zeros,
};
use hashgrid::TableReads;
use hashgrid::cube::{DeviceTable, Entries, Half, Single, is_smooth, level_words};

use super::backward::{DenseTable, SdfFieldBackward, SdfFieldGradients};
use super::{Normal, SdfFieldConfig, SdfFieldOps, check};
use crate::cube::{chunks, expect_reachable};
use gradients::gradients;
use kernels::{Sizes, activate_kernel, encode_kernel, finish_kernel};

/// What backward needs: the op's inputs, the table as kernels read it.
#[derive(Clone, Debug)]
#[allow(unreachable_pub)] // an associated type of a public backend must be public
pub struct Saved {
    points: CubeTensor,
    table: DeviceTable,
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

    /// Points whose activations are in memory at once: at the default sizes 2.4 kB each on the way back.
    fn at_once(&self) -> usize {
        points_at_once(&self.points, self.sizes().most_rows())
    }

    /// Inputs of the network that are not zero, the bias' aside.
    fn active_inputs(&self) -> usize {
        3 + 2 * self.config.active_levels
    }

    fn scale(&self) -> f32 {
        0.5 / self.config.half_side
    }

    fn forward(&self) -> CubeTensor {
        let n = self.points.shape()[0];
        let sizes = self.sizes();
        let out = fresh(&self.points, [n, sizes.outputs + 3]);
        let hidden = Packed::forward(&self.w1, &self.b1);
        let output = Packed::forward(&self.w2, &self.b2);
        let back = Packed::backward(&self.w1);
        for (first, count) in chunks(n, self.at_once()) {
            let across = padded(count);
            let (x, jacobian) = self.encode(first, count, across);
            let z = hidden.apply_first(&x, self.active_inputs());
            let (activation, derivative) = self.activate(&z);
            let y = output.apply(&activation);
            let g = if sizes.normal {
                back.first_outputs(&derivative, self.active_inputs())
            } else {
                // Not read.
                derivative
            };
            let client = &out.client;
            let (cubes, dim) = units_for(client, count);
            // SAFETY: threads beyond the points return at once.
            unsafe {
                finish_kernel::launch_unchecked(
                    client,
                    cubes,
                    dim,
                    buffer(&y.data),
                    buffer(&g.data),
                    buffer(&jacobian.data),
                    buffer(&out),
                    first as u32,
                    count as u32,
                    across as u32,
                    self.config.active_levels as u32,
                    self.scale(),
                    sizes,
                );
            }
        }
        out
    }

    /// The network's inputs at `count` points from `first` on, and their Jacobian; the inputs in rows of
    /// `stride` points.
    fn encode(&self, first: usize, count: usize, stride: usize) -> (PointMatrix, PointMatrix) {
        match self.table.reads {
            TableReads::Single => self.encode_from::<Single>(first, count, stride),
            TableReads::Half => self.encode_from::<Half>(first, count, stride),
        }
    }

    fn encode_from<E: Entries>(
        &self,
        first: usize,
        count: usize,
        stride: usize,
    ) -> (PointMatrix, PointMatrix) {
        let sizes = self.sizes();
        let across = padded(count);
        let x = PointMatrix::fresh(&self.points, sizes.inputs() + 1, stride);
        let jacobian = PointMatrix::fresh(&self.points, sizes.derivatives(), across);
        let client = &self.points.client;
        let (cubes, dim) = units_for(client, across * sizes.levels);
        // SAFETY: threads beyond the levels return at once; `level_words` has checked the levels, and
        // `check` the shapes.
        unsafe {
            encode_kernel::launch_unchecked::<E>(
                client,
                cubes,
                dim,
                buffer(&self.points),
                self.table.buffer(),
                constant(&self.points, &level_words(&self.config.layout)),
                buffer(&x.data),
                buffer(&jacobian.data),
                first as u32,
                count as u32,
                across as u32,
                stride as u32,
                self.config.active_levels as u32,
                self.scale(),
                sizes,
            );
        }
        (x, jacobian)
    }

    /// The hidden layer's activation, and the sdf's derivative by the layer where normals are wanted.
    fn activate(&self, z: &PointMatrix) -> (PointMatrix, PointMatrix) {
        let sizes = self.sizes();
        let activation = PointMatrix::fresh(&z.data, sizes.hidden + 1, z.points);
        let rows = if sizes.normal { sizes.hidden } else { 1 };
        let derivative = PointMatrix::fresh(&z.data, rows, z.points);
        let client = &z.data.client;
        let (cubes, dim) = units_for(client, z.points / LANES * sizes.hidden);
        // SAFETY: threads beyond the rows return at once.
        unsafe {
            activate_kernel::launch_unchecked(
                client,
                cubes,
                dim,
                buffer(&z.data),
                buffer(&self.w2),
                buffer(&activation.data),
                buffer(&derivative.data),
                (z.points / LANES) as u32,
                self.config.beta,
                sizes,
            );
        }
        (activation, derivative)
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
        check(
            points.meta.shape(),
            [&table, &w1, &b1, &w2, &b2].map(|tensor| &tensor.meta.shape()[..]),
            &config,
        );
        let (n, outputs) = (points.shape()[0], b2.shape()[0]);
        expect_reachable("sdf_field", n, outputs + 3);
        let saved = Saved {
            points: contiguous(points),
            table: DeviceTable::new(table, &config.layout),
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
        let expected = [saved.points.shape()[0], saved.outputs() + 3];
        assert_eq!(
            grad.meta.shape()[..],
            expected,
            "sdf_field: the result's gradient"
        );
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
