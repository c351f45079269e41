//! What all kernels rest on: atomic sums in both ways, running sums, outer products, elementary functions.

use gpu_tensors::cubecl;
use gpu_tensors::{
    AdamRule, AdamSteps, AtomicSum, CompareAndSwap, CubeTensor, NativeSum, Packed, PointMatrix,
    Rates, WeightReads, add, buffer, column_sums, copy, exp_m1, fresh, from_slice, has_native_sum,
    layer_gradients, ln_1p, padded, read, running_sums, sigmoid, softplus, units_for, zeros,
};

use burn::optim::{AdamConfig, Optimizer};
use burn::tensor::{Device, Int, Tensor, TensorData};
use cubecl::prelude::*;

use crate::support::{
    Random, VALUE, WithoutNativeSums, assert_close, gpu, native_sums, numbers, on_gpu, oracle,
    tensor,
};

/// What a sum or a copy gives is row-major too; rows that are apart are refused before a kernel takes them for others.
#[test]
fn kernels_are_given_row_major_memory_alone() {
    let Some(device) = gpu() else {
        return;
    };
    let values = Random(3).list(15);
    let Some(there) = on_gpu(&values, [5, 3]) else {
        return;
    };
    let twice = add(copy(&there), there.clone());
    let _ = buffer(&twice);
    let expected: Vec<f32> = values.iter().map(|value| 2.0 * value).collect();
    assert_eq!(read(&twice), expected);
    let turned = tensor(&values, [5, 3], &device).transpose();
    let burn::backend::DispatchTensorKind::Cube(turned) = turned.into_dispatch().kind else {
        panic!("the device under test is not CubeCL's");
    };
    let turned = turned.float();
    let refused = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| buffer(&turned)));
    assert!(refused.is_err(), "strides {:?}", turned.meta.strides());
}

#[test]
fn a_device_has_rates_and_the_cpu_is_none() {
    let Some(device) = gpu() else {
        return;
    };
    // Small buffers, for speed; what is fast does not matter here.
    let rates = Rates::measure(&device, Some(4 << 20)).unwrap().unwrap();
    assert!(rates.copy_gbs > 0.01 && rates.copy_gbs < 1e6, "{rates:?}");
    assert!(rates.gflops > 0.1 && rates.gflops < 1e7, "{rates:?}");
    assert_eq!(Rates::measure(&Device::flex(), None), Ok(None));
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
    let _switch = native_sums();
    if has_native_sum(&like.client) {
        assert_eq!(add_many::<NativeSum>(&like, adders), expected);
    }
}

#[test]
fn ops_can_be_kept_from_the_devices_own_sums() {
    let Some(like) = on_gpu(&[0.0], [1, 1]) else {
        return;
    };
    let _without = WithoutNativeSums::new();
    assert!(!has_native_sum(&like.client));
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
fn running_sums_stop_at_their_bound() {
    let Some(device) = gpu() else {
        return;
    };
    for n in [0, 1, 63, 64, 65, 4097, 300_000] {
        let counts: Vec<i32> = (0..n).map(|i| i % 37 * 7919 % 23).collect();
        let tensor = TensorData::new(counts.clone(), [counts.len()]);
        let tensor = Tensor::<1, Int>::from_data(tensor, &device).into_dispatch();
        let burn::backend::DispatchTensorKind::Cube(tensor) = tensor.kind else {
            panic!("the device under test is not CubeCL's");
        };
        let tensor = tensor.int();
        for most in [i32::MAX as u32, 500, 0] {
            let sums = running_sums(&tensor, most);
            let bytes = sums.client.read_one_unchecked(sums.handle.clone());
            let found = &u32::from_bytes(&bytes)[..sums.meta.shape()[0]];
            let mut expected = vec![0];
            for count in &counts {
                expected.push((expected[expected.len() - 1] + *count as u32).min(most));
            }
            assert!(found == expected, "{n} counts, at most {most}");
        }
    }
}

/// A matrix on the device with its values on the host, in double precision; padding is NaN below the
/// rows and zero beside the points.
fn random_points(like: &CubeTensor, rows: usize, n: usize, seed: u32) -> (PointMatrix, Vec<f64>) {
    let points = padded(n);
    let mut values = vec![f32::NAN; padded(rows) * points];
    let numbers = Random(seed).list(rows * n);
    for row in 0..rows {
        let at = row * points;
        values[at..at + n].copy_from_slice(&numbers[row * n..(row + 1) * n]);
        values[at + n..at + points].fill(0.0);
    }
    let data = from_slice(like, &values, [padded(rows), points]);
    let matrix = PointMatrix { data, rows, points };
    (matrix, numbers.into_iter().map(f64::from).collect())
}

/// The rows of a matrix in use, without the points' padding.
fn without_padding(matrix: &PointMatrix, n: usize) -> Vec<f64> {
    read(&matrix.data)
        .chunks_exact(matrix.points.max(1))
        .take(matrix.rows)
        .flat_map(|row| row[..n].iter().map(|value| f64::from(*value)))
        .collect()
}

#[test]
fn a_layer_of_any_size_is_its_matrix_product() {
    let Some(like) = on_gpu(&[0.0], [1, 1]) else {
        return;
    };
    // Points, inputs and outputs; the last ones are more of both than a workgroup's tile has, to and fro.
    let sizes = [
        (1, 3, 1),
        (65, 35, 64),
        (1500, 64, 13),
        (9, 7, 60),
        (65, 80, 72),
        (130, 129, 136),
    ];
    let both = [WeightReads::Cached, WeightReads::Shared];
    for ((n, inputs, outputs), reads) in sizes.iter().flat_map(|s| both.map(|r| (*s, r))) {
        let weights = Random(5).list(outputs * inputs);
        let bias = Random(6).list(outputs);
        let (x, numbers) = random_points(&like, inputs + 1, n, 7);
        let weight = from_slice(&like, &weights, [outputs, inputs]);
        let bias_there = from_slice(&like, &bias, [outputs]);
        let layer = Packed::forward(&weight, &bias_there).reading(reads);
        let mut expected = vec![0.0; outputs * n];
        let mut back = vec![0.0; inputs * n];
        for o in 0..outputs {
            for k in 0..=inputs {
                let w = f64::from(if k < inputs {
                    weights[o * inputs + k]
                } else {
                    bias[o]
                });
                for p in 0..n {
                    expected[o * n + p] += w * numbers[k * n + p];
                }
            }
        }
        assert_close(
            "layer",
            &without_padding(&layer.apply(&x), n),
            &expected,
            1e-5,
        );
        // The rows left out are not zero: only the first outputs of the first input and the bias count.
        let one = layer.apply_first(&x, 1);
        let of_one: Vec<f64> = (0..outputs * n)
            .map(|i| {
                let (o, p) = (i / n, i % n);
                f64::from(weights[o * inputs]) * numbers[p]
                    + f64::from(bias[o]) * numbers[inputs * n + p]
            })
            .collect();
        assert_close("first input", &without_padding(&one, n), &of_one, 1e-5);
        let first = without_padding(&layer.first_outputs(&x, 1), n);
        assert_close("first output", &first[..n], &expected[..n], 1e-5);
        let relu = layer.relu(&x);
        let mut positive: Vec<f64> = expected.iter().map(|value| value.max(0.0)).collect();
        positive.extend(vec![1.0; n]);
        assert_close("relu", &without_padding(&relu, n), &positive, 1e-5);

        let (d, numbers) = random_points(&like, outputs, n, 8);
        let (gate, gates) = random_points(&like, inputs, n, 9);
        for o in 0..outputs {
            for k in 0..inputs {
                for p in 0..n {
                    back[k * n + p] += f64::from(weights[o * inputs + k]) * numbers[o * n + p];
                }
            }
        }
        for (value, gate) in back.iter_mut().zip(&gates) {
            *value *= f64::from(u8::from(*gate > 0.0));
        }
        let gated = Packed::backward(&weight).reading(reads).gated(&d, &gate);
        assert_close("gated", &without_padding(&gated, n), &back, 1e-5);
    }
}

#[test]
fn a_device_is_asked_once_where_weights_are_read_faster() {
    let Some(like) = on_gpu(&[0.0], [1, 1]) else {
        return;
    };
    let first = WeightReads::faster(&like);
    println!("weights are read faster: {first:?}");
    let measured = WeightReads::measurements();
    for _ in 0..100 {
        assert_eq!(WeightReads::faster(&like), first);
    }
    assert!(measured > 0);
    assert_eq!(WeightReads::measurements(), measured);
}

#[test]
fn gradients_of_layers_are_summed_over_any_number_of_points() {
    let Some(like) = on_gpu(&[0.0], [1, 1]) else {
        return;
    };
    // Points, outputs, and inputs with the bias'; the last ones are more of both than a workgroup's tile has.
    for (n, a, b) in [
        (0, 5, 7),
        (1, 5, 7),
        (255, 13, 65),
        (1000, 64, 36),
        (65, 72, 81),
        (130, 136, 130),
    ] {
        let (left, lefts) = random_points(&like, a, n, 1);
        let (right, rights) = random_points(&like, b, n, 2);
        let (weights, bias) = layer_gradients(&left, &right);
        let mut expected = vec![0.0; a * (b - 1)];
        let mut sums = vec![0.0; a];
        for i in 0..a {
            for j in 0..b {
                let product: f64 = (0..n).map(|p| lefts[i * n + p] * rights[j * n + p]).sum();
                if j + 1 < b {
                    expected[i * (b - 1) + j] = product;
                } else {
                    sums[i] = product;
                }
            }
        }
        let found =
            |tensor: &CubeTensor| -> Vec<f64> { read(tensor).into_iter().map(f64::from).collect() };
        assert_close("weights", &found(&weights), &expected, 1e-5);
        assert_close("bias", &found(&bias), &sums, 1e-5);
    }
}

#[test]
fn columns_are_summed_over_any_number_of_rows() {
    for n in [0, 1, 255, 256, 1000] {
        let width = 12;
        let values = Random(n as u32 + 1).list(n * width);
        let Some(matrix) = on_gpu(&values, [n, width]) else {
            return;
        };
        let mut expected = vec![0.0; 3];
        for row in values.chunks_exact(width) {
            for (sum, value) in expected.iter_mut().zip(&row[2..]) {
                *sum += f64::from(*value);
            }
        }
        let sums = read(&column_sums(&matrix, 2, 3));
        let found: Vec<f64> = sums.into_iter().map(f64::from).collect();
        assert_close("columns", &found, &expected, 1e-5);
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

#[test]
fn a_parameters_steps_are_those_of_burns_adam() {
    let Some(device) = gpu() else {
        return;
    };
    let (rate, epsilon) = (0.01, 1e-8f32);
    let betas = [0.9f32, 0.99];
    let reference = AdamConfig::new()
        .with_beta_1(betas[0])
        .with_beta_2(betas[1])
        .with_epsilon(epsilon)
        .build();
    // Four of them in one launch, and others by themselves.
    let shapes = [[7, 15], [1, 1], [64, 35], [3, 2], [5, 9], [2, 31]];
    let start = |n: usize| Random(n as u32).list(shapes[n].iter().product());
    let mut expected: Vec<_> = (0..shapes.len())
        .map(|n| tensor(&start(n), shapes[n], &oracle()))
        .collect();
    let mut found: Vec<_> = (0..shapes.len())
        .map(|n| tensor(&start(n), shapes[n], &device))
        .collect();
    let mut states = vec![None; shapes.len()];
    let mut moments = vec![None::<[Tensor<2>; 2]>; shapes.len()];
    let asked = AdamSteps::default();
    for step in 1..=5 {
        let [first, second] = betas.map(|beta| 1.0 - f64::from(beta).powi(step));
        let rule = AdamRule {
            decay: betas,
            rate: (rate * second.sqrt() / first) as f32,
            epsilon: (f64::from(epsilon) * second.sqrt()) as f32,
        };
        // Somebody else may hold what is stepped; moments are changed in place where nobody does.
        let held = (step % 2 == 0).then(|| (found.clone(), moments.clone()));
        let values = || {
            let (parameters, moments) = held.clone()?;
            let all = moments.into_iter().flatten().flatten().chain(parameters);
            Some(all.flat_map(numbers).collect::<Vec<_>>())
        };
        let before = values();
        for n in 0..shapes.len() {
            let gradient = Random(100 * step as u32 + n as u32).list(start(n).len());
            let there = tensor(&gradient, shapes[n], &device);
            let here = tensor(&gradient, shapes[n], &oracle());
            (expected[n], states[n]) =
                reference.step(rate, expected[n].clone(), here, states[n].take());
            let [stepped, first, second] = asked
                .ask(&found[n], &there, moments[n].take(), rule)
                .unwrap();
            (found[n], moments[n]) = (stepped, Some([first, second]));
        }
        asked.launch();
        assert_eq!(values(), before);
        for n in 0..shapes.len() {
            assert_close(
                &format!("step {step} of parameter {n}"),
                &numbers(found[n].clone()),
                &numbers(expected[n].clone()),
                VALUE,
            );
        }
    }
    let nothing = tensor(&[0.0], [1], &Device::flex());
    let rule = AdamRule {
        decay: betas,
        rate: 0.1,
        epsilon: 1e-8,
    };
    assert!(asked.ask(&nothing, &nothing, None, rule).is_err());
}
