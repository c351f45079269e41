//! The compositing kernel through Burn: growth with rays and with samples, forward and backward.

// `criterion_group!` writes a public function.
#![allow(missing_docs)]

use std::{hint::black_box, sync::Arc};

use burn::tensor::{Device, Tensor, TensorData};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use neus_render::{
    composite::{CompositeConfig, Packing, composite, composite_reference},
    random::unit_float,
};

/// `rays` rays with `samples` intervals each, both fields in all of them.
fn batch(rays: usize, samples: usize, device: &Device) -> (Tensor<2>, Tensor<2>, Arc<Packing>) {
    let n = rays * samples;
    let index: Vec<u32> = (0..n as u32).collect();
    let packing = Packing::new(
        (0..=rays).map(|i| (i * samples) as u32).collect(),
        (0..n).map(|i| 1.0 + (i % samples) as f32 * 0.01).collect(),
        vec![0.01; n],
        index.clone(),
        index,
    );
    let rows = |columns: usize, seed: u64| {
        let values = (0..n).flat_map(|i| {
            let sdf = 0.5 - (i % samples) as f32 / samples as f32;
            let rest = (2..columns).map(move |c| unit_float(seed, (i * 8 + c) as u64));
            [sdf, -0.9].into_iter().chain(rest)
        });
        let values: Vec<f32> = values.collect();
        Tensor::<2>::from_data(TensorData::new(values, [n, columns]), device)
    };
    (rows(6, 1), rows(5, 2), Arc::new(packing))
}

fn both_ways(c: &mut Criterion) {
    let device = Device::flex();
    let mut group = c.benchmark_group("composite");
    group.sample_size(20);
    for (rays, samples) in [(256, 64), (1024, 64), (4096, 64), (1024, 16), (1024, 256)] {
        let id = format!("{rays}x{samples}");
        group.throughput(Throughput::Elements((rays * samples) as u64));
        let (f, b, packing) = batch(rays, samples, &device);
        let s = Tensor::<1>::from_floats([50.0, 50.0], &device);
        group.bench_function(BenchmarkId::new("forward", &id), |bench| {
            bench.iter(|| {
                black_box(composite(
                    f.clone(),
                    b.clone(),
                    s.clone(),
                    packing.clone(),
                    CompositeConfig::default(),
                ))
            });
        });
        let device = device.clone().autodiff();
        let (f, b, packing) = batch(rays, samples, &device);
        let (f, b) = (f.require_grad(), b.require_grad());
        let s = Tensor::<1>::from_floats([50.0, 50.0], &device).require_grad();
        group.bench_function(BenchmarkId::new("forward+backward", &id), |bench| {
            bench.iter(|| {
                let out = composite(
                    f.clone(),
                    b.clone(),
                    s.clone(),
                    packing.clone(),
                    CompositeConfig::default(),
                );
                black_box(out.sum().backward())
            });
        });
        if rays == 256 {
            group.bench_function(BenchmarkId::new("reference", &id), |bench| {
                bench.iter(|| {
                    let out = composite_reference(
                        f.clone(),
                        b.clone(),
                        s.clone(),
                        &packing,
                        CompositeConfig::default(),
                    );
                    black_box(out.sum().backward())
                });
            });
        }
    }
}

criterion_group!(benches, both_ways);
criterion_main!(benches);
