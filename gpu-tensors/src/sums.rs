//! Sums of a matrix' rows, in an order that depends on their number alone.

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{buffer, fresh, units_for, zeros};

/// Rows that one thread adds up by itself.
const CHUNK: usize = 256;

/// The sums of `count` columns of `[n, width]`, from `first` on: `[count]`; zeros when there are no rows.
#[must_use]
pub fn column_sums(matrix: &CubeTensor, first: usize, count: usize) -> CubeTensor {
    let rows = matrix.meta.shape()[0];
    if rows == 0 {
        return zeros(matrix, [count]);
    }
    let partial = fresh(matrix, [rows.div_ceil(CHUNK), count]);
    launch(matrix, first, count, CHUNK, &partial);
    add_rows(&partial, 0, [count])
}

/// The same by one thread for each column, for few rows, in a shape that says how many columns.
pub(crate) fn add_rows<const D: usize>(
    matrix: &CubeTensor,
    first: usize,
    shape: [usize; D],
) -> CubeTensor {
    let out = fresh(matrix, shape);
    let rows = matrix.meta.shape()[0];
    launch(matrix, first, shape.iter().product(), rows, &out);
    out
}

fn launch(matrix: &CubeTensor, first: usize, count: usize, chunk: usize, out: &CubeTensor) {
    let (rows, width) = (matrix.meta.shape()[0], matrix.meta.shape()[1]);
    let (cubes, dim) = units_for(&matrix.client, rows.div_ceil(chunk) * count);
    // SAFETY: threads beyond the results return at once, and rows end with the matrix.
    unsafe {
        chunk_sums::launch_unchecked(
            &matrix.client,
            cubes,
            dim,
            buffer(matrix),
            buffer(out),
            rows as u32,
            chunk as u32,
            first,
            width,
            count,
        );
    }
}

/// One thread for each chunk of rows and each column.
#[cube(launch_unchecked)]
fn chunk_sums(
    matrix: &[f32],
    sums: &mut [f32],
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
        sums[ABSOLUTE_POS] = sum;
    }
}
