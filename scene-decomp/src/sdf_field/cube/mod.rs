//! The op on the GPU: one thread per point.
//!
//! Backward keeps nothing but the inputs: it encodes again, which is cheaper than the memory that
//! a Jacobian takes. A thread scatters its table gradient and leaves the rows whose outer products
//! are the weights' gradients; see [`Row`].

mod kernels;

use burn::backend::{Cube, TensorMetadata, tensor::FloatTensor};
use gpu_tensors::{
    AtomicSum, CompareAndSwap, CubeTensor, NativeSum, OuterSum, buffer, contiguous, fresh,
    has_native_sum, units_for, upload, zeros,
};
use hashgrid::cube::{is_smooth, level_words};

use super::backward::{DenseTable, SdfFieldBackward, SdfFieldGradients};
use super::{Normal, SdfFieldConfig, SdfFieldOps};
use crate::cube::{Sum, chunks};
use kernels::{Row, Sizes, backward_kernel, forward_kernel};

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
