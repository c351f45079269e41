//! Matrices of values at many points, the way layers of a network want them.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{fresh, zeros};

/// Rows and points that one thread works on at once: both sides of [`PointMatrix`] are padded to
/// multiples of it.
pub const BLOCK: usize = 8;

/// Four neighbouring numbers, read and written at once.
pub type Quad = Vector<f32, Const<4>>;

/// Numbers in a [`Quad`].
pub const LANES: usize = 4;

/// [`Quad`]s in a block.
pub(crate) const QUADS: usize = BLOCK / LANES;

/// Quads in a thread's registers, as variables one by one: whether an array's values are kept there is up to the driver.
pub(crate) type Quads = Sequence<RuntimeCell<Quad>>;

/// So many of zeros.
#[cube]
pub(crate) fn zero_quads(#[comptime] count: usize) -> Quads {
    let mut some = Quads::new();
    #[unroll]
    for _ in 0..count {
        some.push(RuntimeCell::new(Quad::new(0.0f32)));
    }
    some
}

/// A row for each value and a column for each point: neighbouring threads, which take neighbouring
/// points, read neighbouring memory.
///
/// Rows and points are padded to whole blocks, so that kernels need no bounds. What is in the padding
/// is up to who fills the matrix, as long as it is finite where products are summed over points.
#[derive(Clone, Debug)]
pub struct PointMatrix {
    /// `[padded(rows), points]`, row-major.
    pub data: CubeTensor,
    /// Rows in use.
    pub rows: usize,
    /// Points, padding included.
    pub points: usize,
}

impl PointMatrix {
    /// A matrix of arbitrary content where `like` is; `points` must be padded already.
    ///
    /// # Panics
    /// When they are not.
    #[must_use]
    pub fn fresh(like: &CubeTensor, rows: usize, points: usize) -> Self {
        expect_padded(points);
        Self {
            data: fresh(like, [padded(rows), points]),
            rows,
            points,
        }
    }

    /// A matrix of zeros.
    ///
    /// # Panics
    /// As [`PointMatrix::fresh`].
    #[must_use]
    pub fn zeros(like: &CubeTensor, rows: usize, points: usize) -> Self {
        expect_padded(points);
        Self {
            data: zeros(like, [padded(rows), points]),
            rows,
            points,
        }
    }

    /// Panics unless the data has what rows and points promise, as the fields are public: kernels look at nothing else.
    pub(crate) fn expect_whole(&self, op: &str) {
        expect_padded(self.points);
        let (shape, expected) = (self.data.meta.shape(), [padded(self.rows), self.points]);
        assert!(
            shape[..] == expected,
            "{op}: a matrix of {} rows and {} points is {shape:?}, not {expected:?}",
            self.rows,
            self.points
        );
    }
}

fn expect_padded(points: usize) {
    assert!(
        points.is_multiple_of(BLOCK),
        "PointMatrix: {points} points are not padded to whole blocks of {BLOCK}"
    );
}

/// `count` rounded up to whole blocks.
#[must_use]
pub const fn padded(count: usize) -> usize {
    count.next_multiple_of(BLOCK)
}
