//! `encode` and `encode_with_jacobian`.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout, Interpolation, encode, encode_with_jacobian, reference};

use crate::support::{GRADIENT, Random, VALUE, assert_close, gpu, numbers, oracle, tensor};

fn layout(interpolation: Interpolation) -> Arc<GridLayout> {
    Arc::new(GridLayout::new(&GridConfig {
        levels: 6,
        base_resolution: 4,
        finest_resolution: 61,
        log2_table_size: 12,
        interpolation,
        ..GridConfig::default()
    }))
}

/// Positions in the unit cube, some of them on its faces and outside.
fn points(n: usize) -> Vec<f32> {
    let mut values: Vec<f32> = Random(n as u32 + 3)
        .coordinates(3 * n, 0.5)
        .iter()
        .map(|v| v + 0.5)
        .collect();
    for (i, special) in [0.0, 1.0, -0.25, 1.5].into_iter().enumerate() {
        if let Some(value) = values.get_mut(17 * i + 3) {
            *value = special;
        }
    }
    values
}

/// Everything that the ops return and what comes back through them, in order.
fn run(
    device: &Device,
    layout: &Arc<GridLayout>,
    n: usize,
    active: usize,
    kernel: bool,
) -> Vec<(&'static str, Vec<f64>, f64)> {
    let device = &device.clone().autodiff();
    let features = layout.features();
    let mut random = Random(99);
    let table = random.list(2 * layout.entries());
    let upstream = random.list(n * features * 4);
    let points = points(n);
    let dh = tensor(&upstream[..n * features], [n, features], device);
    let dj = tensor(&upstream[n * features..], [n, features, 3], device);
    let leaves = || {
        (
            tensor(&points, [n, 3], device),
            tensor(&table, [layout.entries(), 2], device).require_grad(),
        )
    };

    let (p, t) = leaves();
    let p = p.require_grad();
    let op = if kernel { encode } else { reference::encode };
    let h = op(p.clone(), t.clone(), layout, active);
    let mut out = vec![("value", numbers(h.clone()), VALUE)];
    let grads = (h * dh.clone()).sum().backward();
    out.push(("table by value", numbers(t.grad(&grads).unwrap()), GRADIENT));
    out.push(("points", numbers(p.grad(&grads).unwrap()), GRADIENT));

    let (p, t) = leaves();
    let op: fn(Tensor<2>, Tensor<2>, &Arc<GridLayout>, usize) -> (Tensor<2>, Tensor<3>) = if kernel
    {
        encode_with_jacobian
    } else {
        reference::encode_with_jacobian
    };
    let (h, j) = op(p, t.clone(), layout, active);
    out.push(("value with Jacobian", numbers(h.clone()), VALUE));
    out.push(("Jacobian", numbers(j.clone()), VALUE));
    let grads = ((h * dh).sum() + (j * dj).sum()).backward();
    out.push(("table by both", numbers(t.grad(&grads).unwrap()), GRADIENT));
    out
}

#[test]
fn values_and_gradients_are_the_references() {
    let Some(gpu) = gpu() else {
        return;
    };
    for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
        let layout = layout(interpolation);
        for (n, active) in [(1, 6), (65, 4), (1000, 6)] {
            let found = run(&gpu, &layout, n, active, true);
            let expected = run(&oracle(), &layout, n, active, false);
            for ((what, found, tolerance), (_, expected, _)) in found.iter().zip(&expected) {
                let what = format!("{what}, {n} points, {active} levels, {interpolation:?}");
                assert_close(&what, found, expected, *tolerance);
            }
        }
    }
}

#[test]
fn no_points_and_no_levels_give_zeros() {
    let Some(gpu) = gpu() else {
        return;
    };
    let layout = layout(Interpolation::Linear);
    let device = gpu.autodiff();
    let table = tensor(
        &vec![1.0; 2 * layout.entries()],
        [layout.entries(), 2],
        &device,
    )
    .require_grad();
    let points = Tensor::<2>::zeros([0, 3], &device);
    let (h, j) = encode_with_jacobian(points, table.clone(), &layout, 6);
    assert_eq!((h.dims(), j.dims()), ([0, 12], [0, 12, 3]));
    let points = Tensor::<2>::zeros([3, 3], &device);
    let h = encode(points, table.clone(), &layout, 0);
    let grads = h.clone().sum().backward();
    assert!(numbers(h).iter().all(|v| *v == 0.0));
    assert!(
        numbers(table.grad(&grads).unwrap())
            .iter()
            .all(|v| *v == 0.0)
    );
}

/// NaN counts as 0: it must neither spread nor lead outside the table.
#[test]
fn a_position_that_is_no_number_counts_as_zero() {
    let Some(gpu) = gpu() else {
        return;
    };
    let layout = layout(Interpolation::Linear);
    let table = tensor(
        &Random(5).list(2 * layout.entries()),
        [layout.entries(), 2],
        &gpu,
    );
    let at = |x: f32| {
        let points = tensor(&[x, 0.25, 0.75], [1, 3], &gpu);
        numbers(encode(points, table.clone(), &layout, 6))
    };
    assert_eq!(at(f32::NAN), at(0.0));
    assert_eq!(at(f32::NEG_INFINITY), at(0.0));
    assert_eq!(at(f32::INFINITY), at(1.0));
}

/// Points times levels need more than 65535 workgroups of 64.
#[test]
fn a_batch_may_need_more_workgroups_than_an_axis_holds() {
    let Some(gpu) = gpu() else {
        return;
    };
    let layout = layout(Interpolation::Linear);
    let n = 65_536 * 64 / 6 + 1000;
    let table = Random(5).list(2 * layout.entries());
    let few = points(100);
    let many: Vec<f32> = few.iter().cycle().take(3 * n).copied().collect();
    let encoded = |values: &[f32]| {
        let table = tensor(&table, [layout.entries(), 2], &gpu);
        let points = tensor(values, [values.len() / 3, 3], &gpu);
        numbers(encode(points, table, &layout, 6))
    };
    let (few, many) = (encoded(&few), encoded(&many));
    assert_eq!(many.len(), n * 12);
    for (i, chunk) in many.chunks(1200).enumerate() {
        assert!(chunk == &few[..chunk.len()], "rows from {}", 100 * i);
    }
}
