//! `y = W x + b` over a tile, and the product that gives `dL/dW`.

use std::ops::Range;

use pulp::Simd;

use super::{GRAIN, POINTS};

/// Outputs whose accumulators are held in registers at once.
const OUT_BLOCK: usize = 6;

/// Loads a full vector.
///
/// # Safety
/// `ptr` must be valid for `S::F32_LANES` reads; alignment is not needed.
#[inline(always)]
pub(crate) unsafe fn load<S: Simd>(ptr: *const f32) -> S::f32s {
    // SAFETY: the caller promises the reads are valid; `S::f32s` is plain old data.
    unsafe { ptr.cast::<S::f32s>().read_unaligned() }
}

/// Stores a full vector.
///
/// # Safety
/// `ptr` must be valid for `S::F32_LANES` writes; alignment is not needed.
#[inline(always)]
pub(crate) unsafe fn store<S: Simd>(ptr: *mut f32, value: S::f32s) {
    // SAFETY: the caller promises the writes are valid; `S::f32s` is plain old data.
    unsafe { ptr.cast::<S::f32s>().write_unaligned(value) }
}

/// `y[j] = bias[j] + sum_i weight[j, i] x[i]` for every point of the tile.
///
/// `weight: [n_out, n_in]`, `bias: [n_out]` or none, `x: [n_in, POINTS]`, `y: [n_out, POINTS]`.
#[inline(always)]
pub(crate) fn forward<S: Simd>(
    simd: S,
    weight: &[f32],
    bias: Option<&[f32]>,
    x: &[f32],
    y: &mut [f32],
) {
    forward_of(simd, POINTS, weight, bias, x, y);
}

/// [`forward`] over a tile of `points`, a multiple of [`GRAIN`]: `x: [n_in, points]`, `y: [n_out, points]`.
#[inline(always)]
pub(crate) fn forward_of<S: Simd>(
    simd: S,
    points: usize,
    weight: &[f32],
    bias: Option<&[f32]>,
    x: &[f32],
    y: &mut [f32],
) {
    let n_in = x.len() / points;
    let n_out = y.len() / points;
    // What the unchecked accesses below rest on.
    assert!(
        points.is_multiple_of(GRAIN)
            && x.len() == n_in * points
            && y.len() == n_out * points
            && weight.len() == n_in * n_out
            && bias.is_none_or(|b| b.len() == n_out)
    );
    let product = Product {
        simd,
        points,
        n_in,
        weight,
        bias,
        x,
    };
    let mut first = 0;
    while first + OUT_BLOCK <= n_out {
        product.rows::<OUT_BLOCK>(y, first);
        first += OUT_BLOCK;
    }
    while first + 4 <= n_out {
        product.rows::<4>(y, first);
        first += 4;
    }
    while first < n_out {
        product.rows::<1>(y, first);
        first += 1;
    }
}

/// [`forward_of`]'s arguments.
#[derive(Clone, Copy)]
struct Product<'a, S> {
    simd: S,
    points: usize,
    n_in: usize,
    weight: &'a [f32],
    bias: Option<&'a [f32]>,
    x: &'a [f32],
}

impl<S: Simd> Product<'_, S> {
    /// Outputs `first..first + ROWS`.
    #[inline(always)]
    fn rows<const ROWS: usize>(self, y: &mut [f32], first: usize) {
        // 16 lanes come with 32 registers, so that 6 x 4 accumulators fit; 8 lanes with 16.
        if S::F32_LANES == 16 {
            let whole = self.points / (4 * S::F32_LANES) * (4 * S::F32_LANES);
            self.block::<ROWS, 4>(y, first, 0..whole);
            self.block::<ROWS, 1>(y, first, whole..self.points);
        } else {
            self.block::<ROWS, 2>(y, first, 0..self.points);
        }
    }

    /// The same of a range of points, a multiple of `COLUMNS` vectors.
    #[inline(always)]
    fn block<const ROWS: usize, const COLUMNS: usize>(
        self,
        y: &mut [f32],
        first: usize,
        range: Range<usize>,
    ) {
        let Self {
            simd,
            points,
            n_in,
            weight,
            bias,
            x,
        } = self;
        let lanes = S::F32_LANES;
        let width = COLUMNS * lanes;
        debug_assert_eq!(range.len() % width, 0);
        for start in range.step_by(width) {
            let mut acc = [[simd.splat_f32s(0.0); COLUMNS]; ROWS];
            if let Some(bias) = bias {
                for (r, row) in acc.iter_mut().enumerate() {
                    *row = [simd.splat_f32s(bias[first + r]); COLUMNS];
                }
            }
            for i in 0..n_in {
                let mut column = [simd.splat_f32s(0.0); COLUMNS];
                for (c, value) in column.iter_mut().enumerate() {
                    // SAFETY: i < n_in and start + width <= points, and x holds n_in * points values.
                    *value = unsafe { load::<S>(x.as_ptr().add(i * points + start + c * lanes)) };
                }
                for (r, row) in acc.iter_mut().enumerate() {
                    // SAFETY: first + r < n_out and i < n_in, and weight holds n_out * n_in values.
                    let w =
                        simd.splat_f32s(unsafe { *weight.get_unchecked((first + r) * n_in + i) });
                    for (value, &column) in row.iter_mut().zip(&column) {
                        *value = simd.mul_add_e_f32s(w, column, *value);
                    }
                }
            }
            for (r, row) in acc.iter().enumerate() {
                for (c, &value) in row.iter().enumerate() {
                    // SAFETY: first + r < n_out, and y holds n_out * points values.
                    unsafe {
                        store::<S>(
                            y.as_mut_ptr().add((first + r) * points + start + c * lanes),
                            value,
                        );
                    }
                }
            }
        }
    }
}

/// `acc[j, i] += sum over the tile of a[j] b[i]`, kept as one partial sum per vector lane.
///
/// `a: [n_a, POINTS]`, `b: [n_b, POINTS]`, `acc: [n_a, n_b, S::F32_LANES]`: the lanes are summed
/// once, by [`super::partials`], when a thread has done all its tiles.
#[inline(always)]
pub(crate) fn outer<S: Simd>(simd: S, a: &[f32], b: &[f32], acc: &mut [f32]) {
    let n_a = a.len() / POINTS;
    let n_b = b.len() / POINTS;
    assert!(acc.len() >= n_a * n_b * S::F32_LANES);
    let mut row = 0;
    while row + 4 <= n_a {
        outer_rows::<S, 4>(simd, a, b, acc, row, n_b);
        row += 4;
    }
    while row < n_a {
        outer_rows::<S, 1>(simd, a, b, acc, row, n_b);
        row += 1;
    }
}

#[inline(always)]
fn outer_rows<S: Simd, const ROWS: usize>(
    simd: S,
    a: &[f32],
    b: &[f32],
    acc: &mut [f32],
    row: usize,
    n_b: usize,
) {
    let wide = if S::F32_LANES == 16 { 6 } else { 2 };
    let mut column = 0;
    while column + wide <= n_b {
        if S::F32_LANES == 16 {
            outer_block::<S, ROWS, 6>(simd, a, b, acc, row, column, n_b);
        } else {
            outer_block::<S, ROWS, 2>(simd, a, b, acc, row, column, n_b);
        }
        column += wide;
    }
    while column < n_b {
        outer_block::<S, ROWS, 1>(simd, a, b, acc, row, column, n_b);
        column += 1;
    }
}

#[inline(always)]
fn outer_block<S: Simd, const ROWS: usize, const COLUMNS: usize>(
    simd: S,
    a: &[f32],
    b: &[f32],
    acc: &mut [f32],
    row: usize,
    column: usize,
    n_b: usize,
) {
    let lanes = S::F32_LANES;
    let at = |r: usize, c: usize| ((row + r) * n_b + column + c) * lanes;
    let mut sums = [[simd.splat_f32s(0.0); COLUMNS]; ROWS];
    for (r, sums) in sums.iter_mut().enumerate() {
        for (c, sum) in sums.iter_mut().enumerate() {
            // SAFETY: acc holds n_a * n_b * lanes values (asserted by the caller).
            *sum = unsafe { load::<S>(acc.as_ptr().add(at(r, c))) };
        }
    }
    for start in (0..POINTS).step_by(lanes) {
        let mut right = [simd.splat_f32s(0.0); COLUMNS];
        for (c, value) in right.iter_mut().enumerate() {
            // SAFETY: column + c < n_b and start + lanes <= POINTS.
            *value = unsafe { load::<S>(b.as_ptr().add((column + c) * POINTS + start)) };
        }
        for (r, sums) in sums.iter_mut().enumerate() {
            // SAFETY: row + r < n_a and start + lanes <= POINTS.
            let left = unsafe { load::<S>(a.as_ptr().add((row + r) * POINTS + start)) };
            for (sum, &right) in sums.iter_mut().zip(&right) {
                *sum = simd.mul_add_e_f32s(left, right, *sum);
            }
        }
    }
    for (r, sums) in sums.iter().enumerate() {
        for (c, &sum) in sums.iter().enumerate() {
            // SAFETY: as for the loads above.
            unsafe { store::<S>(acc.as_mut_ptr().add(at(r, c)), sum) };
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use pulp::{Arch, Scalar, WithSimd};

    fn numbers(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        (0..count)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 23) as f32 - 1.0
            })
            .collect()
    }

    /// The vector instructions that kernels may be compiled for: each has its own blocks of registers.
    #[derive(Clone, Copy, Debug)]
    enum Tier {
        /// None.
        Scalar,
        /// Eight lanes, on machines that have them.
        V3,
        /// The machine's widest.
        Widest,
    }

    impl Tier {
        /// What `op` returns; `None` where the machine has no such instructions.
        fn run<T: WithSimd>(self, op: T) -> Option<T::Output> {
            match self {
                Self::Scalar => Some(op.with_simd(Scalar::new())),
                #[cfg(target_arch = "x86_64")]
                Self::V3 => pulp::x86::V3::try_new().map(|simd| Simd::vectorize(simd, op)),
                #[cfg(not(target_arch = "x86_64"))]
                Self::V3 => None,
                Self::Widest => Some(Arch::new().dispatch(op)),
            }
        }
    }

    struct All<'a> {
        w: &'a [f32],
        bias: &'a [f32],
        x: &'a [f32],
        y: &'a mut [f32],
        acc: &'a mut [f32],
        /// Of a tile of [`GRAIN`] points.
        few: [&'a mut [f32]; 2],
    }

    impl WithSimd for All<'_> {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> usize {
            forward(simd, self.w, Some(self.bias), self.x, self.y);
            outer(simd, self.y, self.x, self.acc);
            let [x, y] = self.few;
            forward_of(simd, GRAIN, self.w, None, x, y);
            S::F32_LANES
        }
    }

    /// Every remainder of the register blocks, against the sums written out in f64.
    fn products_equal_the_plain_loops(tier: Tier) {
        for (n_in, n_out) in [(35, 64), (64, 13), (1, 1), (7, 5), (22, 11)] {
            let (w, bias) = (numbers(n_in * n_out, 1), numbers(n_out, 2));
            let x = numbers(n_in * POINTS, 3);
            let mut y = vec![0.0; n_out * POINTS];
            let mut acc = vec![0.0; n_in * n_out * 16];
            let (mut few_x, mut few_y) = (numbers(n_in * GRAIN, 4), vec![0.0; n_out * GRAIN]);
            let lanes = tier.run(All {
                w: &w,
                bias: &bias,
                x: &x,
                y: &mut y,
                acc: &mut acc,
                few: [&mut few_x, &mut few_y],
            });
            let Some(lanes) = lanes else {
                return;
            };
            let product = |j: usize, x: &[f32], points: usize, p: usize| -> f64 {
                (0..n_in)
                    .map(|i| f64::from(w[j * n_in + i]) * f64::from(x[i * points + p]))
                    .sum()
            };
            for j in 0..n_out {
                for p in 0..POINTS {
                    let expected = f64::from(bias[j]) + product(j, &x, POINTS, p);
                    assert!((f64::from(y[j * POINTS + p]) - expected).abs() < 1e-5);
                }
                for p in 0..GRAIN {
                    let expected = product(j, &few_x, GRAIN, p);
                    assert!((f64::from(few_y[j * GRAIN + p]) - expected).abs() < 1e-5);
                }
                for i in 0..n_in {
                    let expected: f64 = (0..POINTS)
                        .map(|p| f64::from(y[j * POINTS + p]) * f64::from(x[i * POINTS + p]))
                        .sum();
                    let at = (j * n_in + i) * lanes;
                    let sum: f32 = acc[at..at + lanes].iter().sum();
                    assert!(
                        (f64::from(sum) - expected).abs() < 1e-3,
                        "{tier:?}: {sum} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn products_without_vectors() {
        products_equal_the_plain_loops(Tier::Scalar);
    }

    #[test]
    fn products_of_eight_lanes() {
        products_equal_the_plain_loops(Tier::V3);
    }

    #[test]
    fn products_of_the_widest_vectors() {
        products_equal_the_plain_loops(Tier::Widest);
    }
}
