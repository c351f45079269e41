//! Derivatives against differences of values.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::GridLayout;
use scene_decomp::{FrozenSurface, InitialShape, Surface, SurfaceConfig};

use crate::{config, numbers, surface, tensor, values};

#[test]
fn the_normal_is_the_gradient_of_the_distance() {
    let device = Device::flex().autodiff();
    let surface = surface(&device);
    let layout = Arc::new(GridLayout::new(&config().grid));
    let at = |p: [f32; 3]| {
        let settings = surface.sdf_config(&layout, 5, None);
        values(surface.geometry(tensor(p.to_vec(), [1, 3], &device), settings))
    };
    // Within a cell the field is smooth; the step is far below the cell of 4 / 40 and far above
    // the rounding of the distance.
    let step = 2e-3;
    let (mut checked, mut left_out) = (0, 0);
    for p in numbers(120, 21)
        .chunks_exact(3)
        .map(|p| [1.7 * p[0], 1.7 * p[1], 1.7 * p[2]])
    {
        let normal = &at(p)[8..11];
        for axis in 0..3 {
            let (mut low, mut high) = (p, p);
            low[axis] -= step;
            high[axis] += step;
            let crosses = layout.levels.iter().any(|level| {
                let cell = |v: f32| ((v / 4.0 + 0.5) * level.resolution as f32).floor();
                cell(low[axis]) != cell(high[axis])
            });
            // There the slope is between both sides'.
            if crosses {
                left_out += 1;
                continue;
            }
            let slope = (at(high)[0] - at(low)[0]) / (2.0 * step);
            assert!(
                (slope - normal[axis]).abs() < 0.02 * (1.0 + slope.abs()),
                "axis {axis} of {p:?}: {slope}, not {}",
                normal[axis]
            );
            checked += 1;
        }
    }
    assert!(checked > 5 * left_out, "{left_out} of {checked} left out");
}

#[test]
fn a_density_has_a_gradient_for_whoever_asks() {
    let device = Device::flex();
    let config = SurfaceConfig {
        beta: 5.0,
        initial: InitialShape::Uneven(2.0),
        ..config()
    };
    let layout = Arc::new(GridLayout::new(&config.grid));
    let frozen = FrozenSurface::new(&Surface::new(&config, 3, &device), &layout, 5);
    let points = numbers(60, 8);
    let geometry = frozen.geometry(&points);
    let gradients = frozen.gradients_of(points.clone());
    let step = 2e-3;
    for (i, gradient) in gradients.into_iter().enumerate() {
        assert_eq!(geometry.normal(i), glam::Vec3::ZERO);
        for (axis, found) in gradient.to_array().into_iter().enumerate() {
            let value = |by: f32| {
                let mut point = points[3 * i..3 * i + 3].to_vec();
                point[axis] += by;
                frozen.distances_of(point)[0]
            };
            // Both in single precision; the values are of the order of 2.
            let expected = (value(step) - value(-step)) / (2.0 * step);
            assert!((found - expected).abs() < 5e-3, "{i}: {found} {expected}");
        }
        assert!(gradient.length() > 1e-2);
    }
}
