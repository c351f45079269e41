//! What a point costs to project, and a pixel to look through: without distortion, with that of a phone, and with a lens
//! whose map has to be looked at for a fold.

// `criterion_group!` writes a public function.
#![allow(missing_docs)]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec2, DVec3};
use io_colmap::{Camera, CameraModel};

const SIDE: u32 = 64;

fn lenses() -> [(&'static str, Camera); 3] {
    let camera = |model, distortion: &[f64]| Camera {
        id: 1,
        model,
        width: 1000,
        height: 1000,
        params: [&[900.0, 500.0, 500.0], distortion].concat(),
    };
    [
        ("pinhole", camera(CameraModel::SimplePinhole, &[])),
        ("gentle", camera(CameraModel::SimpleRadial, &[0.05])),
        ("looked_at", camera(CameraModel::SimpleRadial, &[40.0])),
    ]
}

/// Pixels all over the photo, the outermost left out.
fn pixels() -> impl Iterator<Item = DVec2> {
    let at = |i: u32| 20.0 + 15.0 * f64::from(i);
    (0..SIDE * SIDE).map(move |i| DVec2::new(at(i % SIDE), at(i / SIDE)))
}

fn projection(c: &mut Criterion) {
    let mut group = c.benchmark_group("lens");
    group.throughput(Throughput::Elements(u64::from(SIDE * SIDE)));
    for (name, camera) in lenses() {
        let points: Vec<DVec3> = pixels()
            .map(|pixel| ((pixel - 500.0) / 900.0).extend(1.0))
            .collect();
        group.bench_function(BenchmarkId::new("project", name), |b| {
            b.iter(|| {
                for point in &points {
                    black_box(camera.project(black_box(*point)));
                }
            });
        });
        group.bench_function(BenchmarkId::new("unproject", name), |b| {
            b.iter(|| {
                for pixel in pixels() {
                    black_box(camera.unproject(black_box(pixel)));
                }
            });
        });
    }
}

criterion_group!(benches, projection);
criterion_main!(benches);
