//! The kernels on one core, against the plain tensor reference, over points and table sizes.
#![allow(missing_docs, clippy::unwrap_used, clippy::needless_range_loop)]

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use burn::Tensor;
use burn::tensor::{Device, TensorData};
use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use hashgrid::{
    FEATURES, GridConfig, GridLayout, LazyAdam, SparseGrad, cpu, encode_with_jacobian, reference,
};

const TILE: usize = 256;

/// A small generator, so that each run sees the same points.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }
}

/// `n` points, as three arrays: scattered, or 64 to a ray through the box as in rendering.
fn points(n: usize, rays: bool) -> [Vec<f32>; 3] {
    let mut random = Random(1);
    let mut out = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    let (mut from, mut to) = ([0.0; 3], [0.0; 3]);
    for i in 0..n {
        if i % 64 == 0 {
            from = [random.unit(), random.unit(), 0.0];
            to = [random.unit(), random.unit(), 1.0];
        }
        let t = (i % 64) as f32 / 64.0;
        for axis in 0..3 {
            out[axis][i] = if rays {
                from[axis] + t * (to[axis] - from[axis])
            } else {
                random.unit()
            };
        }
    }
    out
}

struct Case {
    layout: GridLayout,
    table: Vec<f32>,
    points: [Vec<f32>; 3],
}

impl Case {
    fn new(n: usize, log2_table_size: u32, rays: bool) -> Self {
        let layout = GridLayout::new(&GridConfig {
            log2_table_size,
            ..Default::default()
        });
        let mut random = Random(2);
        let table = (0..2 * layout.entries())
            .map(|_| random.unit() - 0.5)
            .collect();
        Self {
            layout,
            table,
            points: points(n, rays),
        }
    }

    fn forward(&self, values: &mut [f32], mut jacobian: Option<&mut [f32]>) {
        let [x, y, z] = &self.points;
        let active = self.layout.levels.len();
        for start in (0..x.len()).step_by(TILE) {
            let t = start..start + TILE;
            let jacobian = jacobian.as_deref_mut();
            cpu::encode_tile(
                &self.layout,
                active,
                &self.table,
                &x[t.clone()],
                &y[t.clone()],
                &z[t],
                values,
                jacobian,
            );
        }
    }

    fn backward(&self, d: &[f32], normal: bool, grad: &mut [f32]) {
        let rows = self.rows(d, normal);
        for (l, level) in self.layout.levels.iter().enumerate() {
            let grad = &mut grad[2 * level.offset..2 * (level.offset + level.entries)];
            cpu::scatter_level(&self.layout, l, &rows, grad, None);
        }
    }

    /// `d` as all that comes back.
    fn rows<'a>(&'a self, d: &'a [f32], normal: bool) -> cpu::ScatterRows<'a> {
        let [x, y, z] = &self.points;
        cpu::ScatterRows {
            position: [x, y, z],
            d_value: [d; 2],
            normal_part: normal.then_some(([d; 2], [d; 3])),
            prefetch_offset: 0,
        }
    }
}

fn kernels(c: &mut Criterion) {
    for rays in [false, true] {
        let name = if rays { "rays" } else { "scattered" };
        let mut group = c.benchmark_group(format!("one_core_16384_{name}"));
        let case = Case::new(16384, 19, rays);
        let mut values = vec![0.0; 32 * TILE];
        let mut jacobian = vec![0.0; 96 * TILE];
        let mut grad = vec![0.0; case.table.len()];
        let d = vec![0.5; 16384];
        group.bench_function("value", |b| {
            b.iter(|| case.forward(black_box(&mut values), None))
        });
        group.bench_function("value_and_jacobian", |b| {
            b.iter(|| case.forward(black_box(&mut values), Some(&mut jacobian)))
        });
        group.bench_function("value_backward", |b| {
            b.iter(|| case.backward(&d, false, black_box(&mut grad)))
        });
        group.bench_function("value_and_jacobian_backward", |b| {
            b.iter(|| case.backward(&d, true, black_box(&mut grad)))
        });
    }
}

fn growth(c: &mut Criterion) {
    let mut group = c.benchmark_group("one_core_growth");
    for (n, log2) in [
        (4096, 19),
        (16384, 19),
        (65536, 19),
        (16384, 15),
        (16384, 17),
        (16384, 21),
    ] {
        let case = Case::new(n, log2, false);
        let mut values = vec![0.0; 32 * TILE];
        let mut jacobian = vec![0.0; 96 * TILE];
        group.bench_function(
            BenchmarkId::new("value_and_jacobian", format!("{n}_points_T2e{log2}")),
            |b| b.iter(|| case.forward(black_box(&mut values), Some(&mut jacobian))),
        );
    }
}

/// Backward into a sparse gradient, and the lazy Adam that uses it up; all cores.
fn optimiser(c: &mut Criterion) {
    let mut group = c.benchmark_group("lazy_adam_16384_rays");
    let case = Case::new(16384, 19, true);
    let d = vec![0.5; 16384];
    let rows = case.rows(&d, true);
    let gradient = SparseGrad::new(&case.layout);
    let fill = || {
        gradient.accumulate_levels_marked(&case.layout, 16, |l, grad, touched| {
            cpu::scatter_level(&case.layout, l, &rows, grad, Some(touched));
        });
    };
    group.bench_function("backward_marked", |b| b.iter(fill));
    let mut adam = LazyAdam::new(&case.layout);
    let mut table = case.table.clone();
    group.bench_function("step", |b| {
        b.iter_batched(
            fill,
            |()| adam.step(&mut table, &gradient, 0.01),
            BatchSize::PerIteration,
        );
    });
    fill();
    let blocks = gradient.touched_blocks();
    eprintln!("touched blocks: {blocks} of {}", case.layout.entries() / 8);
    gradient.drain(|_, _| {});
    group.bench_function("backward_found_by_search", |b| {
        b.iter(|| {
            gradient.accumulate_levels(&case.layout, 16, |l, grad| {
                cpu::scatter_level(&case.layout, l, &rows, grad, None);
            });
        });
    });
}

/// The whole op with its backward through Burn's autodiff, and the same in plain tensor ops.
fn ops(c: &mut Criterion) {
    let mut group = c.benchmark_group("op_forward_and_backward");
    group.sample_size(10);
    for n in [256, 2048] {
        // A small table: autodiff of the plain ops makes a gradient of a level's size for each corner.
        let case = Case::new(n, 14, false);
        let layout = Arc::new(case.layout.clone());
        let device = Device::flex().autodiff();
        let [x, y, z] = &case.points;
        let points = (0..n).flat_map(|i| [x[i], y[i], z[i]]).collect();
        let points = Tensor::<2>::from_data(TensorData::new(points, [n, 3]), &device);
        let table = TensorData::new(case.table.clone(), [layout.entries(), FEATURES]);
        let table = Tensor::<2>::from_data(table, &device).require_grad();
        let run = |kernel: bool| {
            let op = if kernel {
                encode_with_jacobian
            } else {
                reference::encode_with_jacobian
            };
            let (h, j) = op(points.clone(), table.clone(), &layout, 16);
            let gradients = (h.sum() + j.sum()).backward();
            table.grad(&gradients)
        };
        group.bench_function(BenchmarkId::new("kernel", n), |b| b.iter(|| run(true)));
        group.bench_function(BenchmarkId::new("reference", n), |b| b.iter(|| run(false)));
    }
}

fn short() -> Criterion {
    Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
}

criterion_group! { name = benches; config = short(); targets = kernels, growth, optimiser, ops }
criterion_main!(benches);
