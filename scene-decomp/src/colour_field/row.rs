//! What the op returns of a point: colours, or a whole row for compositing.

use burn::Tensor;

/// What compositing reads a field's first output as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reading {
    /// A signed distance.
    Distance,
    /// The logarithm of a density, negated: see [`density_of`].
    Density,
}

/// How [`sample_rows`](super::sample_rows) reads a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowConfig {
    /// What the first output is.
    pub reading: Reading,
    /// Factor on the directions that the network sees; the slope along the ray is of the whole ones.
    pub view_share: f32,
}

/// Columns of [`sample_rows`](super::sample_rows); with `C` outputs of the network there are `3 + C`.
pub mod row_column {
    /// The signed distance, or the density times the stretch.
    pub const FIRST: usize = 0;
    /// `normal . direction`.
    pub const SLOPE: usize = 1;
    /// The network's outputs from here: red, green, blue, and the matte value where there is one.
    pub const COLOUR: usize = 2;
    /// How many columns there are besides the network's outputs. The last column of all is the
    /// normal's length, `sqrt(n . n + 1e-12)`.
    pub const OTHERS: usize = 3;
}

/// What the kernels return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// The network's outputs, `[n, C]`.
    Colour,
    /// Rows, `[n, 3 + C]`.
    Row(RowConfig),
}

impl Output {
    /// Columns of the result for a network of so many outputs.
    pub(crate) fn columns(self, outputs: usize) -> usize {
        match self {
            Self::Colour => outputs,
            Self::Row(_) => outputs + row_column::OTHERS,
        }
    }
}

/// Bounds of the logarithm of a density: of air, and of a wall in any step.
pub(crate) const LEAST_LOG_DENSITY: f32 = -15.0;
/// See [`LEAST_LOG_DENSITY`].
pub(crate) const MOST_LOG_DENSITY: f32 = 12.0;

/// Added to the squared length of a normal under the root.
pub(crate) const LENGTH_OFFSET: f32 = 1e-12;

/// The density that a field's first output stands for when it is read as one.
#[must_use]
pub fn density_of(raw: f32) -> f32 {
    (-raw).clamp(LEAST_LOG_DENSITY, MOST_LOG_DENSITY).exp()
}

/// [`density_of`] for a tensor.
pub(crate) fn densities_of(raw: Tensor<2>) -> Tensor<2> {
    raw.neg().clamp(LEAST_LOG_DENSITY, MOST_LOG_DENSITY).exp()
}
