//! From rays to pixels with fields in closed form: marching and compositing together.

// A test fails by panicking.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use glam::Vec3;
use neus_render::{
    alpha::{NeusParameters, density_alpha, neus_alpha, weights_from_alphas},
    composite::{CompositeConfig, Packing, column, composite},
    contraction::{contract, contract_direction},
    march::{Field, Grids, MarchConfig, march},
    occupancy::OccupancyGrid,
    random::unit_float,
    rays::Ray,
};

fn full(resolution: u32, half: f32) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(resolution, half);
    grid.set_all(1.0);
    grid
}

/// A red sphere of radius 0.5 (the object); a green ball in front of it and a blue wall far behind
/// (the background, signed distance in contracted space).
#[test]
fn two_fields_appear_in_depth_order() {
    let (object_grid, background_grid) = (full(32, 1.0), full(32, 2.0));
    let grids = Grids {
        object: Some(&object_grid),
        background: Some(&background_grid),
    };
    let towards = |x: f32| Ray {
        origin: Vec3::new(x, 0.0, -3.0),
        direction: Vec3::Z,
    };
    // Through the ball to the sphere; the sphere only; past both.
    let rays = [towards(0.0), towards(0.3), towards(0.8)];
    let config = MarchConfig {
        background_samples: 256,
        ..MarchConfig::default()
    };
    let intervals = march(&rays, grids, &config);

    let f = intervals.samples(Field::Object, &rays);
    let object: Vec<f32> = f
        .points
        .iter()
        .flat_map(|p| [p.length() - 0.5, p.normalize().z, 1.0, 0.0, 0.0, 1.0])
        .collect();
    let b = intervals.samples(Field::Background, &rays);
    let ball = Vec3::new(0.0, 0.0, -0.8);
    let background: Vec<f32> = b
        .points
        .iter()
        .zip(&b.ray)
        .flat_map(|(&p, &ray)| {
            let c = contract(p);
            let v = contract_direction(p, rays[ray as usize].direction);
            let to_ball = c - ball;
            // The wall stands at z = 4, which is 1.75 contracted.
            if to_ball.length() - 0.1 < 1.75 - c.z {
                [
                    to_ball.length() - 0.1,
                    to_ball.normalize().dot(v),
                    0.0,
                    1.0,
                    0.0,
                ]
            } else {
                [1.75 - c.z, -v.z, 0.0, 0.0, 1.0]
            }
        })
        .collect();
    let device = Device::flex();
    let pixels = composite(
        Tensor::from_data(TensorData::new(object, [f.len(), 6]), &device),
        Tensor::from_data(TensorData::new(background, [b.len(), 5]), &device),
        Tensor::from_floats([2000.0, 2000.0], &device),
        Arc::new(Packing::from_intervals(&intervals)),
        CompositeConfig::default(),
    );
    let pixels: Vec<f32> = pixels.into_data().try_to_vec().unwrap();
    let pixel = |i: usize| &pixels[i * column::COUNT..(i + 1) * column::COUNT];
    #[track_caller]
    fn near(found: f32, expected: f32, tolerance: f32) {
        assert!(
            (found - expected).abs() < tolerance,
            "{found} instead of {expected}"
        );
    }
    // What each ray sees: colour, matte, depth, and the two fields alone.
    let expected = [
        ([0.0, 1.0, 0.0], 0.0, 3.0 - 0.9, 1.0),
        ([1.0, 0.0, 0.0], 1.0, 3.0 - 0.4, 1.0),
        ([0.0, 0.0, 1.0], 0.0, 3.0 + 4.0, 0.0),
    ];
    for (i, (colour, matte, depth, alone)) in expected.into_iter().enumerate() {
        let pixel = pixel(i);
        for c in 0..3 {
            near(pixel[column::JOINT_COLOUR + c], colour[c], 0.01);
        }
        near(pixel[column::MATTE], matte, 0.01);
        near(pixel[column::OBJECT_OPACITY], alone, 0.01);
        near(pixel[column::OBJECT_COLOUR], alone, 0.01);
        near(pixel[column::JOINT_OPACITY], 1.0, 0.01);
        // Steps near the wall are 25 / 256 long.
        near(
            pixel[column::JOINT_DEPTH],
            depth,
            if i == 2 { 0.1 } else { 0.02 },
        );
    }
    near(pixel(1)[column::BACKGROUND_COLOUR + 2], 1.0, 0.01);
    assert!(pixel(2)[column::OBJECT_LOG_TRANSMITTANCE].abs() < 0.02);
    assert!(pixel(0)[column::OBJECT_LOG_TRANSMITTANCE] < -5.0);
}

/// The stable single-precision form against the formula as written, in f64.
#[test]
fn neus_alpha_equals_the_textbook() {
    for i in 0..20_000u64 {
        let random = |k| f64::from(unit_float(21, 8 * i + k));
        let s = 10f64.powf(3.5 * random(0)) as f32;
        let sdf = ((random(1) - 0.5) * 20.0 / f64::from(s)) as f32;
        let slope = (2.0 * random(2) - 1.0) as f32;
        let dt = (0.1 * random(3)) as f32;
        for (anneal, epsilon) in [(1.0, 1e-5), (0.3, 1e-5), (1.0, 0.0)] {
            let parameters = NeusParameters {
                sharpness: s,
                cos_anneal: anneal,
                epsilon,
            };
            let found = f64::from(neus_alpha(sdf, slope, dt, &parameters));
            let wide = |x: f32| f64::from(x);
            let (sdf, slope, dt, s) = (wide(sdf), wide(slope), wide(dt), wide(s));
            let (anneal, epsilon) = (wide(anneal), wide(epsilon));
            let c = -(0.5 - 0.5 * slope).max(0.0) * (1.0 - anneal) - (-slope).max(0.0) * anneal;
            let phi = |x: f64| 1.0 / (1.0 + (-s * x).exp());
            let (before, after) = (phi(sdf - c * dt / 2.0), phi(sdf + c * dt / 2.0));
            let exact = ((before - after + epsilon) / (before + epsilon)).clamp(0.0, 1.0);
            // Arguments of the exponentials are up to 200, with errors of 1e-5.
            assert!(
                (found - exact).abs() < 3e-5,
                "{found} {exact} {parameters:?}"
            );
        }
    }
}

#[test]
fn rungs_add_up() {
    let alphas: Vec<f32> = (0..50)
        .map(|i| density_alpha(unit_float(1, i), 0.3))
        .collect();
    let sum: f32 = weights_from_alphas(&alphas).iter().sum();
    let through: f32 = alphas.iter().map(|a| 1.0 - a).product();
    assert!((sum + through - 1.0).abs() < 1e-6);
}
