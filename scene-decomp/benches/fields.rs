//! The fused field ops through Burn, forward and with their backward: growth with points and with the
//! hash table's size.

// `criterion_group!` writes a public function.
#![allow(missing_docs)]

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use burn::tensor::{Device, Tensor, TensorData};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use hashgrid::{GridConfig, GridLayout, SparseGrad};
use neus_render::random::unit_float;
use scene_decomp::colour_field::{ColourFieldInputs, colour_field};
use scene_decomp::{InitialShape, Surface, SurfaceConfig};

/// Points and the logarithm of the table's entries.
const CASES: [(usize, u32); 5] = [
    (1 << 12, 19),
    (1 << 14, 19),
    (1 << 16, 19),
    (1 << 14, 15),
    (1 << 14, 17),
];

struct Case {
    surface: Surface,
    layout: Arc<GridLayout>,
    gradient: SparseGrad,
    points: Tensor<2>,
    directions: Tensor<2>,
}

impl Case {
    fn new(points: usize, log2_table_size: u32, device: &Device) -> Self {
        let grid = GridConfig {
            log2_table_size,
            ..GridConfig::default()
        };
        let layout = Arc::new(GridLayout::new(&grid));
        let config = SurfaceConfig {
            grid,
            hidden: 64,
            features: 12,
            extra: 0,
            direction_degree: 1,
            outputs: 4,
            half_side: 1.0,
            beta: 100.0,
            initial: InitialShape::Ball(0.5),
        };
        let mut surface = Surface::new(&config, 1, device);
        surface.grid.table = surface.grid.table.set_require_grad(false);
        let rows = |seed: u64| {
            let values: Vec<f32> = (0..3 * points as u64)
                .map(|i| 2.0 * unit_float(seed, i) - 1.0)
                .collect();
            Tensor::from_data(TensorData::new(values, [points, 3]), device)
        };
        Self {
            gradient: SparseGrad::new(&layout),
            points: rows(1),
            directions: rows(2),
            surface,
            layout,
        }
    }

    fn geometry(&self) -> Tensor<2> {
        let levels = self.layout.levels.len();
        let config = self
            .surface
            .sdf_config(&self.layout, levels, Some(self.gradient.clone()));
        self.surface.geometry(self.points.clone(), config)
    }

    fn colour(&self, geometry: Tensor<2>) -> Tensor<2> {
        let [n, _] = geometry.dims();
        let device = geometry.device();
        colour_field(
            ColourFieldInputs {
                geometry,
                points: self.points.clone(),
                directions: self.directions.clone(),
                extra: Tensor::zeros([n, 0], &device),
            },
            self.surface.colour_weights(),
        )
    }
}

fn growth(c: &mut Criterion) {
    for (points, log2) in CASES {
        let id = format!("{points}_points_T2e{log2}");
        let plain = Case::new(points, log2, &Device::flex());
        let tracked = Case::new(points, log2, &Device::flex().autodiff());
        let geometry = plain.geometry();
        let tracked_geometry = tracked.geometry().detach().require_grad();
        let mut group = c.benchmark_group("sdf_field");
        group.throughput(Throughput::Elements(points as u64));
        group.bench_function(BenchmarkId::new("forward", &id), |b| {
            b.iter(|| black_box(plain.geometry()));
        });
        group.bench_function(BenchmarkId::new("forward+backward", &id), |b| {
            b.iter(|| black_box(tracked.geometry().sum().backward()));
        });
        group.finish();
        tracked.gradient.drain(|_, _| {});
        // The colour field has no table.
        if log2 != 19 {
            continue;
        }
        let mut group = c.benchmark_group("colour_field");
        group.throughput(Throughput::Elements(points as u64));
        group.bench_function(BenchmarkId::new("forward", points), |b| {
            b.iter(|| black_box(plain.colour(geometry.clone())));
        });
        group.bench_function(BenchmarkId::new("forward+backward", points), |b| {
            b.iter(|| black_box(tracked.colour(tracked_geometry.clone()).sum().backward()));
        });
    }
}

fn short() -> Criterion {
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
}

criterion_group! { name = benches; config = short(); targets = growth }
criterion_main!(benches);
