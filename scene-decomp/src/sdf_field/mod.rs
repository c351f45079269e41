//! The fused `sdf field` op: encoding, MLP and normal in one pass, with its backward by hand.
//!
//! For points `p` the op computes (method: FoCoR and BaCo, section "Two fields")
//!
//! ```text
//! x   = [p, h(p)]                      h: multi-resolution hash encoding      [3 + 2 L]
//! z   = W1 x + b1,  a = softplus_beta(z)                                      [hidden]
//! out = W2 a + b2 = (sdf, feature)                                            [1 + G]
//! n   = d sdf / d p = J^T W1^T (w2 * softplus'(z)),  J = dx / dp               [3]
//! ```
//!
//! where `w2` is the first row of `W2`. Since `n` is an output like any other, losses on the normal
//! (Eikonal) and colours that depend on it need first-order autodiff only: the derivative of `n`
//! with respect to the table and the weights is part of this op's backward.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod adapters;
mod autodiff;
mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;

use std::sync::Arc;

use burn::Tensor;
use burn::backend::{Backend, Dispatch, backend_extension, tensor::FloatTensor};
use hashgrid::{GridLayout, SparseGrad};

pub(crate) use cpu::transposed;
pub use cpu::{BACKWARD, EVALUATION, FORWARD, Tape, TapedRows};

/// Whether the op computes normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Normal {
    /// The gradient of the sdf.
    Computed,
    /// Zeros, at half the cost: for a field that is read as a density.
    Zero,
}

/// Whether a forward pass is for one that follows, or follows one.
#[derive(Clone, Debug, Default)]
pub enum Forward {
    /// Neither.
    #[default]
    Alone,
    /// Outside autodiff: what a backward pass needs goes to the tape. GPUs' kernels leave it as it is.
    Taped(Tape),
    /// Under autodiff: these rows, one for each point, were computed before, of the same weights and levels, and
    /// are not again. GPUs' kernels compute them. No rows at all, which is what a tape of theirs has, are as
    /// [`Forward::Alone`].
    FromTape(TapedRows),
}

/// What the op needs besides its tensors.
#[derive(Clone, Debug)]
pub struct SdfFieldConfig {
    /// The hash grid's levels.
    pub layout: Arc<GridLayout>,
    /// Levels in use; the features of later ones read as zero.
    pub active_levels: usize,
    /// The field covers the cube `[-half_side, half_side]^3` of the points' frame.
    pub half_side: f32,
    /// The softplus' sharpness.
    pub beta: f32,
    /// Whether the normal is wanted at all.
    pub normal: Normal,
    /// Where the table's gradient goes; `None` registers a dense one with autodiff.
    pub sparse: Option<SparseGrad>,
    /// What came before, or comes after.
    pub forward: Forward,
}

impl SdfFieldConfig {
    /// The layout without the levels that are not in use.
    pub(crate) fn active_layout(&self) -> GridLayout {
        GridLayout {
            levels: self.layout.levels[..self.active_levels].to_vec(),
            interpolation: self.layout.interpolation,
            device_reads: self.layout.device_reads,
        }
    }
}

/// The op's tensors.
#[derive(Clone, Debug)]
pub struct SdfFieldWeights {
    /// The hash table, `[entries, 2]`.
    pub table: Tensor<2>,
    /// Hidden layer, `[hidden, 3 + 2 L]`.
    pub w1: Tensor<2>,
    /// Hidden bias, `[hidden]`.
    pub b1: Tensor<1>,
    /// Output layer, `[1 + G, hidden]`: the sdf's row first.
    pub w2: Tensor<2>,
    /// Output bias, `[1 + G]`.
    pub b2: Tensor<1>,
}

/// `sdf field`, as backends supply it.
#[backend_extension(NdArray, Flex, Cube: cfg(feature = "cube"), Autodiff)]
pub trait SdfFieldOps: Backend {
    /// See [`sdf_field`].
    fn sdf_field(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        config: SdfFieldConfig,
    ) -> FloatTensor<Self>;
}

/// Signed distance, geometry feature and normal of `points: [n, 3]`: `[n, 1 + G + 3]`.
///
/// Columns: sdf (in the points' unit), `G` features, then the normal, which is the gradient of the
/// sdf and of unit length only where the field is a distance. Gradients flow to all weights; the
/// points are constants.
///
/// # Panics
/// When a shape or the sparse gradient does not fit the layout, or there are taped rows, but of another field or not one for
/// each point. On a GPU also when points or results are more than `2^32 − 1` numbers: ask in smaller batches.
#[must_use]
pub fn sdf_field(points: Tensor<2>, weights: SdfFieldWeights, config: SdfFieldConfig) -> Tensor<2> {
    check_tensors(&points, &weights, &config);
    Tensor::from_dispatch(Dispatch::sdf_field(
        points.into_dispatch(),
        weights.table.into_dispatch(),
        weights.w1.into_dispatch(),
        weights.b1.into_dispatch(),
        weights.w2.into_dispatch(),
        weights.b2.into_dispatch(),
        config,
    ))
}

/// [`check`] for tensors of any backend.
fn check_tensors(points: &Tensor<2>, weights: &SdfFieldWeights, config: &SdfFieldConfig) {
    let SdfFieldWeights {
        table,
        w1,
        b1,
        w2,
        b2,
    } = weights;
    check(
        &points.dims(),
        [
            &table.dims(),
            &w1.dims(),
            &b1.dims(),
            &w2.dims(),
            &b2.dims(),
        ],
        config,
    );
}

/// What kernels rest on: the shapes of the points and of `[table, w1, b1, w2, b2]`, and that the rest of `config` is of the
/// same layout.
fn check(points: &[usize], [table, w1, b1, w2, b2]: [&[usize]; 5], config: &SdfFieldConfig) {
    let columns = 3 + 2 * config.layout.levels.len();
    let &[n, 3] = points else {
        panic!("sdf_field: points are {points:?}, not [n, 3]");
    };
    assert_eq!(
        table,
        [config.layout.entries(), 2],
        "sdf_field: the table does not fit its layout"
    );
    let (hidden, outputs) = (w1[0], w2[0]);
    assert_eq!(
        w1,
        [hidden, columns],
        "sdf_field: w1 is {w1:?}, but the layout asks for [hidden, {columns}]"
    );
    assert_eq!(
        w2,
        [outputs, hidden],
        "sdf_field: w2 is {w2:?}, but w1 has {hidden} rows"
    );
    assert_eq!(b1, [hidden], "sdf_field: b1 does not fit w1");
    assert_eq!(b2, [outputs], "sdf_field: b2 does not fit w2");
    assert!(
        config.active_levels <= config.layout.levels.len(),
        "sdf_field: {} active levels of {}",
        config.active_levels,
        config.layout.levels.len()
    );
    if let Some(sparse) = &config.sparse {
        // Kernels add to it without looking at its size.
        assert_eq!(
            sparse.entries(),
            config.layout.entries(),
            "sdf_field: the gradient does not fit the layout"
        );
    }
    if let Forward::FromTape(rows) = &config.forward {
        let taped = rows.len();
        assert!(
            taped == n || rows.is_empty(),
            "sdf_field: {taped} taped rows of {n} points"
        );
    }
}

/// What one backend keeps from forward to backward, and how it goes back.
pub(crate) mod backward {
    use super::{Backend, FloatTensor, SdfFieldConfig};

    /// Gradients of the op's five weights; `table` is `None` when it went to the sparse sink.
    #[derive(Debug)]
    pub struct SdfFieldGradients<B: Backend> {
        pub table: Option<FloatTensor<B>>,
        pub w1: FloatTensor<B>,
        pub b1: FloatTensor<B>,
        pub w2: FloatTensor<B>,
        pub b2: FloatTensor<B>,
    }

    /// The kernels behind autodiff.
    pub trait SdfFieldBackward: Backend {
        /// What the forward pass keeps.
        type Saved: Clone + Send + std::fmt::Debug + 'static;

        /// The op, keeping what its backward needs.
        fn sdf_field_saving(
            points: FloatTensor<Self>,
            table: FloatTensor<Self>,
            w1: FloatTensor<Self>,
            b1: FloatTensor<Self>,
            w2: FloatTensor<Self>,
            b2: FloatTensor<Self>,
            config: SdfFieldConfig,
        ) -> (FloatTensor<Self>, Self::Saved);

        /// Gradients for `grad: [n, 1 + G + 3]`.
        fn sdf_field_backward(
            saved: Self::Saved,
            grad: FloatTensor<Self>,
            dense_table: DenseTable,
        ) -> SdfFieldGradients<Self>;
    }

    /// Whether anyone wants the table's dense gradient.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum DenseTable {
        Wanted,
        Unwanted,
    }
}
