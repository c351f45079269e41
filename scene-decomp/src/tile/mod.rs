//! Dense layers over a tile of points, for the fused kernels.
//!
//! A tile is [`POINTS`] points, feature-major: `x[feature * POINTS + point]`, so that a vector
//! register holds the same feature of neighbouring points and every operation is vertical. A
//! layer's weights, `[out, in]` row-major, stay in the first-level cache while points stream by.
//!
//! Everything here is generic over [`pulp::Simd`] and inlined into one run-time dispatch per tile.

pub(crate) mod activation;
pub(crate) mod layer;
pub(crate) mod partials;
pub(crate) mod transpose;

/// Points in a tile: a multiple of every register block of [`layer`].
pub(crate) const POINTS: usize = 128;
/// What the points of a smaller tile are a multiple of: a vector of the widest kind, or two of another.
pub(crate) const GRAIN: usize = 16;
