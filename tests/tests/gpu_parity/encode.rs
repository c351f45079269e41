//! `encode` and `encode_with_jacobian`.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::Device;
use hashgrid::{
    GridConfig, GridLayout, Hash, Interpolation, TableReads, encode, encode_with_jacobian,
    reference,
};

use crate::support::{
    GRADIENT, Random, VALUE, WithoutNativeSums, assert_close, assert_columns_close, gpu, halved,
    numbers, oracle, tensor,
};

fn layout(interpolation: Interpolation) -> Arc<GridLayout> {
    layout_of(interpolation, Hash::Nodes, TableReads::Single)
}

fn layout_of(
    interpolation: Interpolation,
    hash: Hash,
    device_reads: TableReads,
) -> Arc<GridLayout> {
    Arc::new(GridLayout::new(&GridConfig {
        levels: 6,
        base_resolution: 4,
        finest_resolution: 61,
        log2_table_size: 12,
        interpolation,
        hash,
        device_reads,
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

/// Everything that the ops return and what comes back through them, in order, with its columns and tolerance.
fn run(
    device: &Device,
    layout: &Arc<GridLayout>,
    n: usize,
    active: usize,
    kernel: bool,
) -> Vec<(&'static str, Vec<f64>, usize, f64)> {
    let device = &device.clone().autodiff();
    let features = layout.features();
    let mut random = Random(99);
    let mut table = random.list(2 * layout.entries());
    if !kernel && layout.device_reads == TableReads::Half {
        // What kernels round to.
        table.iter_mut().for_each(|value| *value = halved(*value));
    }
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
    let mut out = vec![("value", numbers(h.clone()), features, VALUE)];
    let grads = (h * dh.clone()).sum().backward();
    let table = numbers(t.grad(&grads).unwrap());
    out.push(("table by value", table, 2, GRADIENT));
    out.push(("points", numbers(p.grad(&grads).unwrap()), 3, GRADIENT));

    let (p, t) = leaves();
    let op: fn(Tensor<2>, Tensor<2>, &Arc<GridLayout>, usize) -> (Tensor<2>, Tensor<3>) = if kernel
    {
        encode_with_jacobian
    } else {
        reference::encode_with_jacobian
    };
    let (h, j) = op(p, t.clone(), layout, active);
    out.push(("value with Jacobian", numbers(h.clone()), features, VALUE));
    out.push(("Jacobian", numbers(j.clone()), 3 * features, VALUE));
    let grads = ((h * dh).sum() + (j * dj).sum()).backward();
    let table = numbers(t.grad(&grads).unwrap());
    out.push(("table by both", table, 2, GRADIENT));
    out
}

#[test]
fn values_and_gradients_are_the_references() {
    let Some(gpu) = gpu() else {
        return;
    };
    for (interpolation, hash, reads) in [
        (Interpolation::Linear, Hash::Nodes, TableReads::Single),
        (Interpolation::Linear, Hash::Blocks, TableReads::Single),
        (Interpolation::Smoothstep, Hash::Nodes, TableReads::Single),
        (Interpolation::Linear, Hash::Nodes, TableReads::Half),
        (Interpolation::Smoothstep, Hash::Blocks, TableReads::Half),
    ] {
        let layout = layout_of(interpolation, hash, reads);
        for (n, active) in [(1, 6), (65, 4), (1000, 6)] {
            let found = run(&gpu, &layout, n, active, true);
            let expected = run(&oracle(), &layout, n, active, false);
            for ((what, found, columns, tolerance), (_, expected, ..)) in
                found.iter().zip(&expected)
            {
                let what = format!(
                    "{what}, {n} points, {active} levels, {interpolation:?}, {hash:?}, {reads:?}"
                );
                assert_columns_close(&what, found, expected, *columns, *tolerance);
            }
        }
    }
}

/// Where a device has no instruction to add to an `f32` that others add to as well.
#[test]
fn gradients_are_the_same_by_compare_and_swap() {
    let Some(gpu) = gpu() else {
        return;
    };
    let _without = WithoutNativeSums::new();
    let layout = layout(Interpolation::Linear);
    let found = run(&gpu, &layout, 300, 6, true);
    let expected = run(&oracle(), &layout, 300, 6, false);
    for ((what, found, columns, tolerance), (_, expected, ..)) in found.iter().zip(&expected) {
        assert_columns_close(what, found, expected, *columns, *tolerance);
    }
}

/// At a node a value is its entry's.
#[test]
fn entries_in_half_precision_are_rounded_to_the_nearest() {
    let Some(gpu) = gpu() else {
        return;
    };
    let config = GridConfig {
        levels: 1,
        base_resolution: 16,
        finest_resolution: 16,
        device_reads: TableReads::Half,
        ..GridConfig::default()
    };
    let layout = Arc::new(GridLayout::new(&config));
    // Of all sizes that half precision has, down to nothing; ties of both kinds; the largest that fit.
    let mut values: Vec<f32> = Random(8).list(2 * 17 * 17 * 17);
    for (i, value) in values.iter_mut().enumerate() {
        *value *= (16.0 - (i % 45) as f32).exp2();
    }
    let ties = [1.0 + 1.0 / 2048.0, 1.0 + 3.0 / 2048.0, 65_519.9, -65_504.0];
    let small = [6.1e-5, 3.0 / 33_554_432.0, -1.0 / 33_554_432.0, 1e-30, -0.0];
    for (value, special) in values.iter_mut().zip(ties.into_iter().chain(small)) {
        *value = special;
    }
    let mut table = values.clone();
    table.resize(2 * layout.entries(), 0.0);
    // A node on an upper face is blended from its neighbour's entry, which may be much larger.
    let inner = |node: &usize| {
        [node % 17, node / 17 % 17, node / 289]
            .iter()
            .all(|at| *at < 16)
    };
    let nodes: Vec<usize> = (0..17 * 17 * 17).filter(inner).collect();
    let points: Vec<f32> = nodes
        .iter()
        .flat_map(|node| [node % 17, node / 17 % 17, node / 289])
        .map(|coordinate| coordinate as f32 / 16.0)
        .collect();
    let table = tensor(&table, [layout.entries(), 2], &gpu);
    let points = tensor(&points, [points.len() / 3, 3], &gpu);
    let found = numbers(encode(points, table, &layout, 1));
    let mut apart = 0;
    for (found, node) in found.chunks_exact(2).zip(nodes) {
        for (found, value) in found.iter().zip(&values[2 * node..]) {
            assert_eq!(*found, f64::from(halved(*value)), "{value:e} at {node}");
            apart += usize::from(*found != f64::from(*value));
        }
    }
    assert!(apart > 1000, "rounding changes most of them");
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

/// The same on the way back: every point counts, none twice.
#[test]
fn gradients_of_a_batch_may_need_more_workgroups_than_an_axis_holds() {
    let Some(gpu) = gpu() else {
        return;
    };
    let layout = layout(Interpolation::Linear);
    let times = 7000;
    let few = points(100);
    assert!(times * 100 * layout.levels.len() > 65_535 * 64);
    let device = gpu.autodiff();
    let features = layout.features();
    let upstream = Random(6).list(100 * features);
    let gradient = |times: usize| {
        let many = |values: &[f32]| values.repeat(times);
        let table = vec![1.0; 2 * layout.entries()];
        let table = tensor(&table, [layout.entries(), 2], &device).require_grad();
        let points = tensor(&many(&few), [100 * times, 3], &device);
        let upstream = tensor(&many(&upstream), [100 * times, features], &device);
        let h = encode(points, table.clone(), &layout, layout.levels.len());
        numbers(table.grad(&(h * upstream).sum().backward()).unwrap())
    };
    let expected: Vec<f64> = gradient(1).iter().map(|g| g * times as f64).collect();
    assert_close("table", &gradient(times), &expected, GRADIENT);
}
