//! A kernel over slices that runs on both of Burn's CPU backends, with its time:
//! `cargo run --release -p tensor-slices --example one_kernel_two_backends`.

// Upstream marks burn-ndarray deprecated in favour of Flex; this crate serves both.
#![allow(deprecated)]

use burn::backend::{Flex, NdArray, tensor::FloatTensor};
use tensor_slices::{F32Slices, Scratch, Stopwatch, elementary};

const ROWS: usize = 2000;
const COLUMNS: usize = 500;

static KERNEL: Stopwatch = Stopwatch::new();

/// `ln(sum(exp(x)))` of every row of `x: [rows, columns]`, as one pass over the memory it lies in.
fn log_sum_exp<B: F32Slices>(x: &FloatTensor<B>, [rows, columns]: [usize; 2]) -> FloatTensor<B> {
    let _lap = KERNEL.lap();
    let values = B::as_f32(x);
    // From a pool: the second call finds this buffer again.
    let mut scratch = Scratch::new(columns);
    let sums = values.chunks_exact(columns).map(|row| {
        let largest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        for (out, x) in scratch.iter_mut().zip(row) {
            *out = elementary::exp_non_positive::<false>(x - largest);
        }
        largest + scratch.iter().sum::<f32>().ln()
    });
    B::from_f32(sums.collect(), [rows])
}

fn run<B: F32Slices>(name: &str) {
    let values: Vec<f32> = (0..ROWS * COLUMNS)
        .map(|i| (i % 97) as f32 / 10.0)
        .collect();
    let exact: f64 = values[..COLUMNS].iter().map(|v| f64::from(*v).exp()).sum();
    let x = B::from_f32(values, [ROWS, COLUMNS]);
    let before = KERNEL.total();
    let sums = log_sum_exp::<B>(&x, [ROWS, COLUMNS]);
    println!(
        "{name}: first row {:.5} (exact {:.5}), {:.2?} for {ROWS} rows",
        B::as_f32(&sums)[0],
        exact.ln(),
        KERNEL.total() - before
    );
}

fn main() {
    run::<NdArray>("NdArray");
    run::<Flex>("Flex");
}
