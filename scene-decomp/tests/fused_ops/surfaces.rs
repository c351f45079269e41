//! Surfaces while they are learnt and afterwards: both say the same.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::GridLayout;
use scene_decomp::directions::harmonics;
use scene_decomp::{FrozenSurface, SurfaceConfig};

use crate::{config, numbers, surface_of, values};

/// With and without further inputs, of whole directions and their harmonics.
#[test]
fn a_frozen_surface_has_the_colours_of_the_surface() {
    let device = Device::flex().autodiff();
    for (direction_degree, extra) in [(1, 1), (3, 1), (4, 1), (4, 0)] {
        let config = SurfaceConfig {
            direction_degree,
            extra,
            ..config()
        };
        let surface = surface_of(&config, &device);
        let inputs = 9 + 1 + config.features + extra + harmonics(direction_degree);
        assert_eq!(surface.colour[0].weight.dims(), [64, inputs]);
        let layout = Arc::new(GridLayout::new(&config.grid));
        let n = 200;
        let (points, extra) = (numbers(3 * n, 71), numbers(extra * n, 72));
        let directions: Vec<f32> = numbers(3 * n, 73)
            .chunks_exact(3)
            .flat_map(|v| glam::Vec3::from_slice(v).normalize().to_array())
            .collect();
        let settings = surface.sdf_config(&layout, 5, None);
        let samples = surface.sample(&points, &directions, &extra, settings);
        let frozen = FrozenSurface::new(&surface, &layout, 5);
        let geometry = frozen.geometry(&points);
        let colours = frozen.colour(&geometry, &points, &directions, &extra);
        assert_eq!(geometry.values, values(samples.geometry));
        assert_eq!(colours, values(samples.colour), "{direction_degree}");
        // Which depend on the direction.
        let turned: Vec<f32> = directions.iter().map(|v| -v).collect();
        assert_ne!(colours, frozen.colour(&geometry, &points, &turned, &extra));
    }
}
