//! Marching: growth with rays, and full against mostly empty grids.

// `criterion_group!` writes a public function.
#![allow(missing_docs)]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use neus_render::{
    contraction::uncontract,
    march::{Grids, Intervals, Jitter, MarchConfig, Marcher},
    occupancy::OccupancyGrid,
    random::unit_float,
    rays::Ray,
};

/// Cells of which `surface` says that they are near.
fn shell(resolution: u32, half: f32, surface: impl Fn(Vec3) -> bool) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(resolution, half);
    let cells: Vec<u32> = (0..grid.cell_count() as u32)
        .filter(|&cell| surface(grid.centre_of(cell)))
        .collect();
    grid.update(&cells, &vec![1.0; cells.len()]);
    grid.rebuild_bits(0.5);
    grid
}

fn growth(c: &mut Criterion) {
    // A sphere on a floor, and a far wall all around.
    let object = shell(128, 1.0, |p| (p.length() - 0.5).abs() < 0.03);
    let background = shell(128, 2.0, |p| {
        let far = uncontract(p).length();
        (p.y - 0.5).abs() < 0.04 || (far > 4.0 && far < 8.0)
    });
    let mut full_object = OccupancyGrid::new(128, 1.0);
    let mut full_background = OccupancyGrid::new(128, 2.0);
    full_object.set_all(1.0);
    full_background.set_all(1.0);
    let config = MarchConfig {
        jitter: Jitter::Seeded(1),
        ..MarchConfig::default()
    };
    let mut group = c.benchmark_group("march");
    group.sample_size(20);
    for count in [512, 2048, 8192] {
        let rays: Vec<Ray> = (0..count)
            .filter_map(|i| {
                let at = |k| unit_float(3, 4 * i + k) - 0.5;
                let origin = Vec3::new(at(0), at(1), -3.0);
                Ray::new(origin, Vec3::new(at(2) - origin.x, at(3) - origin.y, 3.0))
            })
            .collect();
        group.throughput(Throughput::Elements(count));
        for (name, grids) in [
            (
                "sparse",
                Grids {
                    object: Some(&object),
                    background: Some(&background),
                },
            ),
            (
                "full",
                Grids {
                    object: Some(&full_object),
                    background: Some(&full_background),
                },
            ),
        ] {
            let (mut marcher, mut out) = (Marcher::new(), Intervals::default());
            marcher.march(&rays, grids, &config, &mut out);
            println!("{name}: {} intervals per ray", out.len() / rays.len());
            group.bench_function(BenchmarkId::new(name, count), |bench| {
                bench.iter(|| {
                    marcher.march(&rays, grids, &config, &mut out);
                    black_box(out.len())
                });
            });
        }
    }
}

criterion_group!(benches, growth);
criterion_main!(benches);
