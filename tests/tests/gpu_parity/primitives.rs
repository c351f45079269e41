//! What all kernels rest on: atomic sums in both ways, outer products, elementary functions.

use gpu_tensors::cubecl;
use gpu_tensors::{
    AtomicSum, CompareAndSwap, CubeTensor, NativeSum, OuterSum, buffer, column_sums, exp_m1, fresh,
    from_slice, has_native_sum, ln_1p, read, sigmoid, softplus, units_for, zeros,
};

use cubecl::prelude::*;

use crate::support::{Random, assert_close, gpu, tensor};

/// A tensor of the device under test, as kernels see it.
fn on_gpu(values: &[f32], shape: [usize; 2]) -> Option<CubeTensor> {
    let device = gpu()?;
    // By way of Burn for the client; then a tensor of its own.
    let like = tensor(&[0.0], [1], &device);
    let burn::backend::DispatchTensorKind::Cube(like) = like.into_dispatch().kind else {
        panic!("the device under test is not CubeCL's");
    };
    Some(from_slice(&like.float(), values, shape))
}

#[cube(launch_unchecked)]
fn add_kernel<A: AtomicSum>(sums: &[Atomic<A::Word>], adders: u32) {
    if ABSOLUTE_POS < adders as usize {
        A::add(&sums[ABSOLUTE_POS % 3], 0.5f32);
    }
}

fn add_many<A: AtomicSum>(like: &CubeTensor, adders: usize) -> Vec<f32> {
    let sums = zeros(like, [3]);
    let (count, dim) = units_for(&sums.client, adders);
    // SAFETY: there are three sums, and threads beyond the adders return at once.
    unsafe {
        add_kernel::launch_unchecked::<A>(&sums.client, count, dim, buffer(&sums), adders as u32);
    }
    read(&sums)
}

#[test]
fn many_threads_add_to_one_number() {
    let Some(like) = on_gpu(&[0.0], [1, 1]) else {
        return;
    };
    let adders = 30_000;
    let expected = vec![0.5 * adders as f32 / 3.0; 3];
    assert_eq!(add_many::<CompareAndSwap>(&like, adders), expected);
    if has_native_sum(&like.client) {
        assert_eq!(add_many::<NativeSum>(&like, adders), expected);
    }
}

/// More than 65535 workgroups: the grid's first axis is too short for them.
#[test]
fn a_launch_may_have_more_workgroups_than_an_axis_holds() {
    let Some(like) = on_gpu(&[0.0], [1, 1]) else {
        return;
    };
    let adders = 64 * 65_535 + 6 * 64 + 3;
    // Sums of up to 2^24 halves are exact.
    let found = add_many::<CompareAndSwap>(&like, adders);
    assert_eq!(found.iter().sum::<f32>(), 0.5 * adders as f32);
}

#[test]
fn outer_products_are_summed_over_any_number_of_rows() {
    for n in [0, 1, 255, 256, 1000] {
        let (a, b) = (5, 7);
        let values = Random(n as u32 + 1).list(n * (a + b));
        let Some(matrix) = on_gpu(&values, [n, a + b]) else {
            return;
        };
        let sum = OuterSum::new(&matrix, &matrix)
            .left_columns(1, 4)
            .right_columns(5, 6)
            .compute([4, 6]);
        let mut expected = vec![0.0; 24];
        let mut columns = vec![0.0; 3];
        for row in values.chunks_exact(a + b) {
            for i in 0..4 {
                for j in 0..6 {
                    expected[6 * i + j] += f64::from(row[1 + i]) * f64::from(row[5 + j]);
                }
            }
            for (sum, value) in columns.iter_mut().zip(&row[2..]) {
                *sum += f64::from(*value);
            }
        }
        let found =
            |tensor: &CubeTensor| -> Vec<f64> { read(tensor).into_iter().map(f64::from).collect() };
        assert_close("outer", &found(&sum), &expected, 1e-5);
        let sums = column_sums(&matrix, 2, 3);
        assert_close("columns", &found(&sums), &columns, 1e-5);
    }
}

#[cube(launch_unchecked)]
fn functions_kernel(x: &[f32], out: &mut [f32], n: u32) {
    let i = ABSOLUTE_POS;
    if i < n as usize {
        let x = x[i];
        out[4 * i] = exp_m1(x);
        out[4 * i + 1] = ln_1p(x);
        out[4 * i + 2] = softplus(x);
        out[4 * i + 3] = sigmoid(x);
    }
}

#[test]
fn elementary_functions_keep_their_digits() {
    let small = (0..60).flat_map(|i| [1.0, -1.0].map(|sign| sign * 0.75f32.powi(i)));
    let x: Vec<f32> = small
        .filter(|x| *x > -1.0)
        .chain([0.0, 5.0, 80.0])
        .collect();
    let n = x.len();
    let Some(input) = on_gpu(&x, [n, 1]) else {
        return;
    };
    let out = fresh(&input, [n, 4]);
    let (count, dim) = units_for(&input.client, n);
    // SAFETY: threads beyond the numbers return at once.
    unsafe {
        functions_kernel::launch_unchecked(
            &input.client,
            count,
            dim,
            buffer(&input),
            buffer(&out),
            n as u32,
        );
    }
    for (x, found) in x.iter().zip(read(&out).chunks_exact(4)) {
        let x = f64::from(*x);
        let expected = [
            x.exp_m1(),
            x.ln_1p(),
            x.max(0.0) + (-x.abs()).exp().ln_1p(),
            1.0 / (1.0 + (-x).exp()),
        ];
        for (f, (found, expected)) in found.iter().zip(expected).enumerate() {
            let expected = expected as f32;
            let error = (found - expected).abs();
            assert!(
                error <= 2e-6 * expected.abs() || *found == expected,
                "function {f} of {x}: {found} instead of {expected}"
            );
        }
    }
}
