//! The encoding as differentiable ops: [`encode()`] and [`encode_with_jacobian`].
//!
//! For a point `p` in `[0, 1]³`, level `l` with `r` cells per axis, and `t = r p − floor(r p)`,
//!
//! ```text
//! h_l(p) = Σ_c w_c(t) · table[index_l(floor(r p) + c)],     c in {0, 1}³
//! w_c    = Π_axis (c_axis ? s(t_axis) : 1 − s(t_axis)),     s(t) = t  or  t² (3 − 2 t)
//! ```
//!
//! (Müller et al. 2022, section 3). `h` and its Jacobian `dh/dp` are both linear in the table, so
//! an op that returns both needs only a first-order backward for losses on either.
//!
//! Shapes: `points` is `[n, 3]`, `table` `[entries, 2]`, `h` `[n, 2 L]` with feature `f` of level
//! `l` in column `2 l + f`, the Jacobian `[n, 2 L, 3]`.

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

use crate::layout::{FEATURES, GridLayout};

/// What the ops need besides their tensors.
#[derive(Clone, Debug)]
pub struct EncodeConfig {
    /// The grid's levels.
    pub layout: Arc<GridLayout>,
    /// Levels in use; features of later ones are 0.
    pub active_levels: usize,
}

#[cfg(any(feature = "cube", test))]
impl EncodeConfig {
    /// Panics unless kernels on GPUs, which check nothing, find `n` points and `width` numbers for each of their features
    /// where 32-bit indices reach, and all levels that are in use.
    fn check_for_kernels(&self, op: &str, n: usize, width: usize) {
        let levels = self.layout.levels.len();
        assert!(
            self.active_levels <= levels,
            "{op}: {} active levels of {levels}",
            self.active_levels
        );
        // A point itself is three numbers.
        let numbers = n as u64 * (self.layout.features() * width).max(3) as u64;
        assert!(
            numbers <= u64::from(u32::MAX),
            "{op}: {n} points are {numbers} numbers, more than 32-bit indices reach; encode in smaller batches"
        );
    }
}

/// The ops, as backends supply them. Users call [`encode()`] and [`encode_with_jacobian`].
#[backend_extension(NdArray, Flex, Cube: cfg(feature = "cube"), Autodiff)]
pub trait EncodeOps: Backend {
    /// See [`encode()`]: `[n, 2 L]`.
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        config: EncodeConfig,
    ) -> FloatTensor<Self>;

    /// See [`encode_with_jacobian`]: `[n, 2 L, 4]`, where the last axis is the value and its
    /// derivatives along x, y and z.
    fn hash_encode_with_jacobian(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        config: EncodeConfig,
    ) -> FloatTensor<Self>;
}

/// Encodes `points` `[n, 3]` with `table` `[entries, 2]`: `[n, 2 L]`.
///
/// Gradients flow to the table and to the points. A coordinate outside `[0, 1]` is clamped and
/// receives no gradient; NaN counts as 0. Features of levels from `active_levels` on are 0.
///
/// # Panics
/// When a shape does not fit the layout, or there are fewer levels than `active_levels`. On a GPU also when points or
/// results are more than `2^32 − 1` numbers: encode in smaller batches.
#[must_use]
pub fn encode(
    points: Tensor<2>,
    table: Tensor<2>,
    layout: &Arc<GridLayout>,
    active_levels: usize,
) -> Tensor<2> {
    let config = checked("encode", &points, &table, layout, active_levels);
    Tensor::from_dispatch(Dispatch::hash_encode(
        points.into_dispatch(),
        table.into_dispatch(),
        config,
    ))
}

/// [`encode()`], and its derivative with respect to the points: `([n, 2 L], [n, 2 L, 3])`.
///
/// Gradients flow to the table, through both results. The points are constants: through a
/// trilinear Jacobian almost all of their gradient would be zero anyway.
///
/// # Panics
/// As [`encode()`], where results are four numbers for each feature, and when `points` is tracked by autodiff: detach it.
#[must_use]
pub fn encode_with_jacobian(
    points: Tensor<2>,
    table: Tensor<2>,
    layout: &Arc<GridLayout>,
    active_levels: usize,
) -> (Tensor<2>, Tensor<3>) {
    let config = checked(
        "encode_with_jacobian",
        &points,
        &table,
        layout,
        active_levels,
    );
    assert!(
        !points.is_tracked(),
        "encode_with_jacobian: points are tracked, but receive no gradient; detach them"
    );
    let [n, _] = points.dims();
    let features = layout.features();
    let packed = Tensor::<3>::from_dispatch(Dispatch::hash_encode_with_jacobian(
        points.into_dispatch(),
        table.into_dispatch(),
        config,
    ));
    let values = packed
        .clone()
        .slice([0..n, 0..features, 0..1])
        .reshape([n, features]);
    (values, packed.slice([0..n, 0..features, 1..4]))
}

fn checked(
    op: &str,
    points: &Tensor<2>,
    table: &Tensor<2>,
    layout: &Arc<GridLayout>,
    active_levels: usize,
) -> EncodeConfig {
    let [n, axes] = points.dims();
    assert_eq!(axes, 3, "{op}: points are [{n}, {axes}], not [n, 3]");
    let expected = [layout.entries(), FEATURES];
    assert_eq!(
        table.dims(),
        expected,
        "{op}: table is {:?}, but the layout asks for {expected:?}",
        table.dims()
    );
    let levels = layout.levels.len();
    assert!(
        active_levels <= levels,
        "{op}: {active_levels} active levels of {levels}"
    );
    EncodeConfig {
        layout: layout.clone(),
        active_levels,
    }
}

/// What autodiff needs of a backend besides the ops.
mod backward {
    use burn::backend::{Backend, tensor::FloatTensor};

    use super::EncodeConfig;

    /// The gradient kernels.
    pub trait EncodeBackward: Backend {
        /// The table's gradient `[entries, 2]` for `grad` `[n, 2 L]` or `[n, 2 L, 4]`.
        fn hash_encode_table_gradient(
            points: FloatTensor<Self>,
            grad: FloatTensor<Self>,
            config: &EncodeConfig,
        ) -> FloatTensor<Self>;

        /// The points' gradient `[n, 3]` for `grad` `[n, 2 L]`.
        fn hash_encode_points_gradient(
            points: FloatTensor<Self>,
            table: FloatTensor<Self>,
            grad: FloatTensor<Self>,
            config: &EncodeConfig,
        ) -> FloatTensor<Self>;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::GridConfig;

    fn refused(n: usize, width: usize, levels: usize, active_levels: usize) -> bool {
        let config = GridConfig {
            levels,
            ..GridConfig::default()
        };
        let config = EncodeConfig {
            layout: Arc::new(GridLayout::new(&config)),
            active_levels,
        };
        let check = || config.check_for_kernels("encode", n, width);
        std::panic::catch_unwind(check).is_err()
    }

    #[test]
    fn batches_beyond_32_bit_indices_are_refused() {
        // 16 levels: 32 numbers a point, 128 with the Jacobian.
        assert!(!refused((1 << 27) - 1, 1, 16, 16));
        assert!(refused(1 << 27, 1, 16, 16));
        assert!(!refused((1 << 25) - 1, 4, 16, 16));
        assert!(refused(1 << 25, 4, 16, 16));
        // One level has fewer numbers than a point has coordinates.
        assert!(!refused((1 << 32) / 3, 1, 1, 1));
        assert!(refused((1 << 32) / 3 + 1, 1, 1, 1));
        assert!(!refused(0, 4, 2, 2));
        assert!(refused(0, 4, 2, 3));
    }
}
