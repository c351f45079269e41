//! Sums of a matrix' rows, in an order that depends on their number alone.

use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::tensor::{buffer, fresh, units_for, workgroups, zeros};

/// Rows that one thread adds up by itself.
const CHUNK: usize = 256;
/// Columns that a workgroup adds up, and threads that share the rows of each.
const COLUMNS: usize = 32;
const PARTS: usize = 8;
/// Rows that a thread asks for before it waits for the first.
const AHEAD: usize = 4;

/// The sums of `count` columns of `[n, width]`, from `first` on: `[count]`; zeros when there are no rows.
///
/// # Panics
/// When the matrix has no such columns, of none are asked for, is none, or is not row-major.
#[must_use]
pub fn column_sums(matrix: &CubeTensor, first: usize, count: usize) -> CubeTensor {
    let (rows, width) = (matrix.meta.shape()[0], matrix.meta.shape()[1]);
    expect_columns(width, first, count);
    if rows == 0 {
        return zeros(matrix, [count]);
    }
    let partial = fresh(matrix, [rows.div_ceil(CHUNK), count]);
    launch(matrix, first, count, CHUNK, &partial);
    let sums = fresh(matrix, [count]);
    launch(&partial, 0, count, partial.meta.shape()[0], &sums);
    sums
}

/// Panics unless `count` columns from `first` on are some of `width`, one at least.
fn expect_columns(width: usize, first: usize, count: usize) {
    assert!(
        first < width && (1..=width - first).contains(&count),
        "column_sums: {count} columns from {first} on, of a matrix of {width}"
    );
}

/// The same of all columns in turn, as two tensors of which the shapes say how many columns each has.
pub(crate) fn add_rows_apart<const D: usize, const E: usize>(
    matrix: &CubeTensor,
    first: [usize; D],
    then: [usize; E],
) -> (CubeTensor, CubeTensor) {
    let (one, other) = (fresh(matrix, first), fresh(matrix, then));
    let count: usize = first.iter().product();
    let (rows, width) = (matrix.meta.shape()[0], matrix.meta.shape()[1]);
    let (cubes, dim) = workgroups(&matrix.client, width.div_ceil(COLUMNS), PARTS * COLUMNS);
    // SAFETY: threads beyond the columns write nothing, and rows end with the matrix.
    unsafe {
        apart_kernel::launch_unchecked(
            &matrix.client,
            cubes,
            dim,
            buffer(matrix),
            buffer(&one),
            buffer(&other),
            rows as u32,
            width as u32,
            count as u32,
        );
    }
    (one, other)
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

/// One workgroup for [`COLUMNS`] columns. A thread takes every eighth row, and asks for several at a time, for they come
/// from far; what the threads of a column have is added in order.
#[cube(launch_unchecked)]
fn apart_kernel(
    matrix: &[f32],
    first: &mut [f32],
    then: &mut [f32],
    rows: u32,
    width: u32,
    count: u32,
) {
    let (rows, width, count) = (rows as usize, width as usize, count as usize);
    let unit = UNIT_POS as usize;
    let (part, within) = (unit / COLUMNS, unit % COLUMNS);
    let column = CUBE_POS * COLUMNS + within;
    let mut shares = Shared::<[f32]>::new_slice(comptime!(PARTS * COLUMNS));
    let mut sum = 0.0f32;
    if column < width {
        let mut row = part;
        while row + comptime!((AHEAD - 1) * PARTS) < rows {
            let mut some = Sequence::<f32>::new();
            #[unroll]
            for i in 0..AHEAD {
                some.push(matrix[(row + comptime!(i * PARTS)) * width + column]);
            }
            #[unroll]
            for i in 0..AHEAD {
                sum += some[i];
            }
            row += comptime!(AHEAD * PARTS);
        }
        while row < rows {
            sum += matrix[row * width + column];
            row += PARTS;
        }
    }
    shares[unit] = sum;
    sync_cube();
    if part == 0 && column < width {
        #[unroll]
        for i in 1..PARTS {
            sum += shares[within + comptime!(i * COLUMNS)];
        }
        if column < count {
            first[column] = sum;
        } else {
            then[column - count] = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_are_not_there_are_refused() {
        let refused =
            |first, count| std::panic::catch_unwind(|| expect_columns(12, first, count)).is_err();
        assert!(!refused(0, 12) && !refused(2, 3) && !refused(11, 1));
        assert!(refused(0, 0) && refused(12, 0));
        assert!(refused(0, 13) && refused(11, 2) && refused(12, 1) && refused(13, 0));
        assert!(refused(1, usize::MAX) && refused(usize::MAX, 2));
    }
}
