//! What surfaces begin as.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout};
use scene_decomp::{FrozenSurface, InitialShape, Surface, SurfaceConfig};

/// Levels of the grid, which hardly matters at the start.
const LEVELS: usize = 2;
/// Points along each side of a raster of the box.
const SIDE: usize = 7;

/// Points of [-1, 1]^3, and the distances that a surface of this shape begins with there.
fn distances(initial: InitialShape, seed: u64) -> impl Iterator<Item = ([f32; 3], f32)> {
    let config = SurfaceConfig {
        grid: GridConfig {
            levels: LEVELS,
            ..GridConfig::default()
        },
        hidden: 64,
        features: 7,
        extra: 1,
        direction_degree: 1,
        outputs: 4,
        half_side: 1.0,
        beta: 100.0,
        initial,
    };
    let surface = Surface::new(&config, seed, &Device::flex());
    let layout = Arc::new(GridLayout::new(&config.grid));
    let frozen = FrozenSurface::new(&surface, &layout, LEVELS);
    let at = |i: usize| 2.0 * i as f32 / (SIDE - 1) as f32 - 1.0;
    let points: Vec<[f32; 3]> = (0..SIDE.pow(3))
        .map(|i| [at(i % SIDE), at(i / SIDE % SIDE), at(i / SIDE / SIDE)])
        .collect();
    let distances = frozen.distances_of(points.concat());
    points.into_iter().zip(distances)
}

#[test]
fn a_ball_is_a_ball_and_a_hollow_the_other_way_round() {
    for (initial, sign) in [
        (InitialShape::Ball(0.5), 1.0),
        (InitialShape::Hollow(0.5), -1.0),
    ] {
        let errors: Vec<f32> = distances(initial, 1)
            .map(|(point, found)| {
                let radius = point.iter().map(|v| v * v).sum::<f32>().sqrt();
                (found - sign * (radius - 0.5)).abs()
            })
            .collect();
        let error = errors.iter().sum::<f32>() / errors.len() as f32;
        // 64 random directions and weights give the length to about an eighth.
        assert!(error < 0.15, "{initial:?}: mean error {error}");
    }
}

#[test]
fn a_flat_field_has_one_value() {
    for seed in 0..4 {
        for (point, found) in distances(InitialShape::Flat(2.0), seed) {
            assert!(
                (found - 2.0).abs() < 0.02,
                "seed {seed}: {found} at {point:?}"
            );
        }
    }
}
