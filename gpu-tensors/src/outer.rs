//! Weight gradients of layers: sums of outer products over all points.

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{buffer, fresh, units_for};

/// Points that one thread adds up by itself: the order of the sum, and so its bits, depend on the
/// number of points alone.
const CHUNK: usize = 256;

/// Columns of a row-major matrix `[n, width]`: those from `first` on, `count` of them.
#[derive(Clone, Copy, Debug)]
struct Columns {
    first: usize,
    count: usize,
    width: usize,
}

/// `A^T B` of two row-major matrices with as many rows as there are points.
///
/// Library matrix products are made for large results; these are a few dozen wide and hundreds of
/// thousands long. One thread adds up [`CHUNK`] rows of one entry, another kernel adds the chunks.
#[derive(Clone, Debug)]
pub struct OuterSum {
    rows: usize,
    left: CubeTensor,
    left_columns: Columns,
    right: CubeTensor,
    right_columns: Columns,
}

impl OuterSum {
    /// Of `left` `[n, a]` and `right` `[n, b]`, both row-major.
    #[must_use]
    pub fn new(left: &CubeTensor, right: &CubeTensor) -> Self {
        let (rows, a) = dims(left);
        let (right_rows, b) = dims(right);
        assert_eq!(rows, right_rows, "OuterSum: rows of both matrices");
        let whole = |width| Columns {
            first: 0,
            count: width,
            width,
        };
        Self {
            rows,
            left: left.clone(),
            left_columns: whole(a),
            right: right.clone(),
            right_columns: whole(b),
        }
    }

    /// With `count` columns of the left matrix from `first` on.
    #[must_use]
    pub fn left_columns(mut self, first: usize, count: usize) -> Self {
        self.left_columns.first = first;
        self.left_columns.count = count;
        self
    }

    /// With `count` columns of the right matrix from `first` on.
    #[must_use]
    pub fn right_columns(mut self, first: usize, count: usize) -> Self {
        self.right_columns.first = first;
        self.right_columns.count = count;
        self
    }

    /// The product's entries, row-major, in a shape with as many; zeros when there are no rows.
    #[must_use]
    pub fn compute<const D: usize>(&self, shape: [usize; D]) -> CubeTensor {
        let (a, b) = (self.left_columns.count, self.right_columns.count);
        if self.rows == 0 {
            return crate::zeros(&self.left, shape);
        }
        let chunks = self.rows.div_ceil(CHUNK);
        let partial = fresh(&self.left, [chunks, a * b]);
        let client = &self.left.client;
        let (count, dim) = units_for(client, chunks * a * b);
        // SAFETY: threads beyond the results return at once, and rows end with the matrices.
        unsafe {
            chunk_products::launch_unchecked(
                client,
                count,
                dim,
                buffer(&self.left),
                buffer(&self.right),
                buffer(&partial),
                self.rows as u32,
                self.left_columns.first,
                self.left_columns.width,
                self.right_columns.first,
                self.right_columns.width,
                a,
                b,
                CHUNK,
            );
        }
        add_rows(&partial, shape)
    }
}

fn dims(matrix: &CubeTensor) -> (usize, usize) {
    let shape = matrix.meta.shape();
    (shape[0], shape[1])
}

/// The sum of the rows of `[n, b]`, `[b]`; zeros when there are none.
#[must_use]
pub fn column_sums(matrix: &CubeTensor, first: usize, count: usize) -> CubeTensor {
    let (rows, width) = dims(matrix);
    if rows == 0 {
        return crate::zeros(matrix, [count]);
    }
    let chunks = rows.div_ceil(CHUNK);
    let partial = fresh(matrix, [chunks, count]);
    let client = &matrix.client;
    let (cubes, dim) = units_for(client, chunks * count);
    // SAFETY: threads beyond the results return at once, and rows end with the matrix.
    unsafe {
        chunk_sums::launch_unchecked(
            client,
            cubes,
            dim,
            buffer(matrix),
            buffer(&partial),
            rows as u32,
            CHUNK as u32,
            first,
            width,
            count,
        );
    }
    add_rows(&partial, [count])
}

/// The sum of the rows of a whole row-major matrix, in a shape with as many entries.
fn add_rows<const D: usize>(matrix: &CubeTensor, shape: [usize; D]) -> CubeTensor {
    let (rows, width) = dims(matrix);
    let out = fresh(matrix, shape);
    let client = &matrix.client;
    let (cubes, dim) = units_for(client, width);
    // SAFETY: threads beyond the width return at once.
    unsafe {
        chunk_sums::launch_unchecked(
            client,
            cubes,
            dim,
            buffer(matrix),
            buffer(&out),
            rows as u32,
            rows as u32,
            0,
            width,
            width,
        );
    }
    out
}

/// One thread for each chunk of rows and each entry of the product.
#[cube(launch_unchecked)]
fn chunk_products(
    left: &[f32],
    right: &[f32],
    partial: &mut [f32],
    rows: u32,
    #[comptime] left_first: usize,
    #[comptime] left_width: usize,
    #[comptime] right_first: usize,
    #[comptime] right_width: usize,
    #[comptime] a: usize,
    #[comptime] b: usize,
    #[comptime] chunk: usize,
) {
    let rows = rows as usize;
    let entry = ABSOLUTE_POS % (a * b);
    let first = ABSOLUTE_POS / (a * b) * chunk;
    if first < rows {
        let end = min(first + chunk, rows);
        let (i, j) = (entry / b, entry % b);
        let mut sum = 0.0f32;
        for row in first..end {
            sum += left[row * left_width + left_first + i]
                * right[row * right_width + right_first + j];
        }
        partial[ABSOLUTE_POS] = sum;
    }
}

/// One thread for each chunk of rows and each column.
#[cube(launch_unchecked)]
fn chunk_sums(
    matrix: &[f32],
    partial: &mut [f32],
    rows: u32,
    chunk: u32,
    #[comptime] first_column: usize,
    #[comptime] width: usize,
    #[comptime] columns: usize,
) {
    let rows = rows as usize;
    let chunk = chunk as usize;
    let column = ABSOLUTE_POS % columns;
    let first = ABSOLUTE_POS / columns * chunk;
    if first < rows {
        let end = min(first + chunk, rows);
        let mut sum = 0.0f32;
        for row in first..end {
            sum += matrix[row * width + first_column + column];
        }
        partial[ABSOLUTE_POS] = sum;
    }
}
