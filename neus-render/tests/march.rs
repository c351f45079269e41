//! Rays, intersection, contraction, occupancy and marching on cases that are known in closed form.

// A test fails by panicking.
#![allow(clippy::unwrap_used)]

use glam::{Affine3A, Quat, Vec2, Vec3};
use neus_render::{
    contraction::{contract, contract_direction, uncontract},
    intersect::{Aabb, ray_box, ray_sphere},
    march::{Field, Grids, Intervals, Jitter, MarchConfig, Marcher, march},
    occupancy::{OccupancyError, OccupancyGrid},
    random::unit_float,
    rays::{Pinhole, Projection, Ray, camera_ray},
};

/// Distances of about 10 in single precision, summed over a thousand intervals.
const LENGTH_TOLERANCE: f32 = 1e-4;

fn full(resolution: u32, half: f32) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(resolution, half);
    grid.set_all(1.0);
    grid
}

fn random_vector(seed: u64, counter: u64) -> Vec3 {
    Vec3::from([0, 1, 2].map(|i| unit_float(seed, 3 * counter + i) * 2.0 - 1.0))
}

/// Rays from everywhere, with some that miss the box, begin inside it, or run along an axis.
fn some_rays(count: u64) -> Vec<Ray> {
    let mut rays: Vec<Ray> = (0..count)
        .filter_map(|i| Ray::new(3.0 * random_vector(1, i), random_vector(2, i)))
        .collect();
    for origin in [
        Vec3::ZERO,
        Vec3::new(0.3, 0.2, -4.0),
        Vec3::new(1.0, 1.0, -4.0),
        Vec3::new(1.5, 0.0, -4.0),
        Vec3::new(-1.0, -1.0, -1.0),
    ] {
        for direction in [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
            rays.push(Ray { origin, direction });
        }
    }
    rays
}

fn of_ray(intervals: &Intervals, ray: usize) -> std::ops::Range<usize> {
    intervals.ray_offsets[ray] as usize..intervals.ray_offsets[ray + 1] as usize
}

#[test]
fn unprojected_pixels_project_back() {
    let camera = Pinhole {
        focal: Vec2::new(500.0, 480.0),
        centre: Vec2::new(320.0, 240.0),
    };
    let pose = Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.25),
        Quat::from_rotation_y(0.7),
        Vec3::new(1.0, 2.0, 3.0),
    );
    for pixel in [Vec2::splat(0.5), Vec2::new(600.0, 3.0)] {
        let ray = camera_ray(&camera, pose, pixel).unwrap();
        assert!((ray.direction.length() - 1.0).abs() < 1e-6);
        let back = camera.project(pose.inverse().transform_point3(ray.at(5.0)));
        assert!(back.unwrap().distance(pixel) < 1e-2);
    }
}

#[test]
fn boxes_and_spheres_are_hit_where_they_are() {
    for (i, ray) in some_rays(500).iter().enumerate() {
        if let Some(span) = ray_box(ray, &Aabb::UNIT) {
            for t in [span.near, span.far] {
                let surface = ray.at(t).abs().max_element();
                assert!((surface - 1.0).abs() < 1e-5, "ray {i}");
            }
        }
        let centre = random_vector(3, i as u64);
        if let Some(span) = ray_sphere(ray, centre, 0.7) {
            for t in [span.near, span.far] {
                assert!((ray.at(t).distance(centre) - 0.7).abs() < 1e-5, "ray {i}");
            }
        }
    }
    let beside = Ray {
        origin: Vec3::new(1.0001, 0.0, -3.0),
        direction: Vec3::new(0.0, -0.0, 1.0),
    };
    assert_eq!(ray_box(&beside, &Aabb::UNIT), None);
    let inside = Ray {
        origin: Vec3::ZERO,
        direction: Vec3::new(-0.0, 0.0, -1.0),
    };
    let span = ray_box(&inside, &Aabb::UNIT).unwrap();
    assert_eq!((span.near, span.far), (-1.0, 1.0));
}

#[test]
fn contraction_is_continuous_and_invertible() {
    for i in 0..1000 {
        let direction = random_vector(4, i);
        for r in [0.1, 0.999, 1.0, 1.001, 3.0, 50.0, 1000.0] {
            let p = direction / direction.abs().max_element() * r;
            let c = contract(p);
            assert!(c.abs().max_element() < 2.0);
            // A contracted coordinate has an error of 1e-7, which r^2 magnifies.
            assert!(uncontract(c).distance(p) < 1e-6 * (1.0 + r * r));
        }
        let border = direction / direction.abs().max_element();
        assert!(contract(border * 1.000_001).distance(contract(border * 0.999_999)) < 1e-5);
    }
}

#[test]
fn contracted_directions_are_derivatives() {
    for i in 0..200 {
        let (p, v) = (3.0 * random_vector(5, i), random_vector(6, i).normalize());
        let step = 1e-2;
        // Points whose neighbours lie across a kink of the largest coordinate are left out.
        let axis = |q: Vec3| {
            let q = q.abs();
            if q.max_element() <= 1.0 {
                3
            } else {
                q.max_position()
            }
        };
        if axis(p - step * v) != axis(p + step * v) {
            continue;
        }
        let difference = (contract(p + step * v) - contract(p - step * v)) / (2.0 * step);
        assert!(difference.distance(contract_direction(p, v)) < 1e-3);
    }
}

#[test]
fn occupancy_keeps_decays_and_protects() {
    let mut grid = OccupancyGrid::new(20, 1.0).with_decay(0.5);
    let mut seen = vec![false; grid.cell_count()];
    for cell in 0..grid.cell_count() as u32 {
        assert_eq!(grid.cell_of(grid.centre_of(cell)), Some(cell));
        assert_eq!(grid.cell_of(grid.jittered(cell, 3)), Some(cell));
        seen[cell as usize] = true;
    }
    assert!(seen.iter().all(|&s| s));
    assert_eq!(grid.cell_of(Vec3::ONE), Some(grid.cell_count() as u32 - 1));
    assert_eq!(grid.cell_of(Vec3::splat(1.001)), None);
    assert_eq!(grid.cell_of(Vec3::new(f32::NAN, 0.0, 0.0)), None);

    grid.update(&[5, 6], &[1.0, f32::NAN]);
    grid.rebuild_bits(0.3);
    assert_eq!(grid.occupied_cells().collect::<Vec<_>>(), [5]);
    grid.protect([7, 700]);
    assert_eq!(grid.occupied_count(), 3);
    for _ in 0..4 {
        grid.update(&[5, 7, 700], &[0.0; 3]);
        grid.rebuild_bits(0.3);
    }
    assert_eq!(grid.occupied_cells().collect::<Vec<_>>(), [7, 700]);
    grid.unprotect();
    grid.rebuild_bits(0.3);
    assert_eq!(grid.occupied_count(), 0);

    let stored = grid.values().to_vec();
    let loaded = OccupancyGrid::from_values(20, 1.0, stored.clone()).unwrap();
    assert_eq!(loaded.values(), stored);
    assert_eq!(
        OccupancyGrid::from_values(21, 1.0, stored).unwrap_err(),
        OccupancyError::ValueCount {
            resolution: 21,
            expected: 9261,
            found: 8000
        }
    );
}

#[test]
fn full_grids_cover_every_ray_without_a_gap() {
    let (object, background) = (full(64, 1.0), full(64, 2.0));
    let grids = Grids {
        object: Some(&object),
        background: Some(&background),
    };
    let rays = some_rays(300);
    for jitter in [Jitter::Fixed, Jitter::Seeded(8)] {
        let config = MarchConfig {
            step_object: 0.01,
            near: 0.05,
            far: 40.0,
            jitter,
            ..MarchConfig::default()
        };
        let intervals = march(&rays, grids, &config);
        for (i, ray) in rays.iter().enumerate() {
            let mut at = config.near;
            for k in of_ray(&intervals, i) {
                let (t, dt) = (intervals.t[k], intervals.dt[k]);
                assert!(dt > 0.0);
                assert!(
                    (t - 0.5 * dt - at).abs() < LENGTH_TOLERANCE,
                    "ray {i} at {at}"
                );
                at = t + 0.5 * dt;
                assert!(intervals.background[k]);
                let inside = ray.at(t).abs().max_element();
                assert!(intervals.object[k] == (inside <= 1.0) || (inside - 1.0).abs() < 1e-5);
                if intervals.object[k] {
                    assert!(dt <= config.step_object * 1.001);
                }
            }
            assert!(
                (at - config.far).abs() < LENGTH_TOLERANCE,
                "ray {i} ends at {at}"
            );
        }
    }
}

/// The background alone is marched in longer steps, but not within six steps before the object.
#[test]
fn long_steps_keep_away_from_the_object_and_leave_no_gap() {
    let mut half_full = OccupancyGrid::new(32, 1.0);
    let left: Vec<u32> = (0..half_full.cell_count() as u32)
        .filter(|cell| half_full.centre_of(*cell).x < 0.0)
        .collect();
    half_full.update(&left, &vec![1.0; left.len()]);
    half_full.rebuild_bits(0.5);
    let (none, all) = (OccupancyGrid::new(32, 1.0), full(32, 1.0));
    let background = full(32, 2.0);
    let rays = some_rays(300);
    for (object, stride) in [&none, &half_full, &all]
        .into_iter()
        .flat_map(|object| [(object, 2), (object, 6)])
    {
        let grids = Grids {
            object: Some(object),
            background: Some(&background),
        };
        let fine = MarchConfig {
            step_object: 0.02,
            far: 40.0,
            ..MarchConfig::default()
        };
        let config = MarchConfig {
            background_stride: stride,
            ..fine
        };
        let step = config.step_object;
        let (intervals, single) = (march(&rays, grids, &config), march(&rays, grids, &fine));
        let mut long = 0;
        for (i, ray) in rays.iter().enumerate() {
            let place = format!("ray {i}, stride {stride}");
            let mut at = config.near;
            for k in of_ray(&intervals, i) {
                let (from, dt) = (intervals.t[k] - 0.5 * intervals.dt[k], intervals.dt[k]);
                assert!((from - at).abs() < LENGTH_TOLERANCE, "{place}, at {at}");
                at = from + dt;
                if ray.at(intervals.t[k]).abs().max_element() > 1.0 - 1e-5 {
                    continue;
                }
                assert!(dt <= stride as f32 * step * 1.001, "{place}, at {at}");
                if dt > step * 1.001 {
                    long += 1;
                    assert!(!intervals.object[k], "{place}, at {at}");
                    for ahead in 0..6 {
                        let p = ray.at(from + (ahead as f32 + 0.5) * step);
                        // On the border between cells rounding decides.
                        let is_clear = p.x.abs() < 1e-4 || !object.occupied(p);
                        assert!(
                            is_clear,
                            "{place}: the object is {ahead} steps ahead of {at}"
                        );
                    }
                }
            }
            assert!((at - config.far).abs() < LENGTH_TOLERANCE, "{place}, {at}");
            // What the object has is as if there were no long steps.
            let of_object = |of: &Intervals| -> Vec<(f32, f32)> {
                let range = of_ray(of, i).filter(|&k| of.object[k]);
                range.map(|k| (of.t[k], of.dt[k])).collect()
            };
            assert_eq!(of_object(&intervals), of_object(&single), "{place}");
        }
        let is_full = object.occupied_count() == object.cell_count();
        assert_eq!(long == 0, is_full, "{long} long steps, stride {stride}");
    }
}

/// Skipping empty blocks must find what testing every step finds.
#[test]
fn skipping_loses_no_occupied_step() {
    let mut object = OccupancyGrid::new(50, 1.0);
    let mut background = OccupancyGrid::new(70, 2.0);
    for (grid, seed) in [(&mut object, 11), (&mut background, 12)] {
        let cells = grid.cell_count() as f32;
        let some: Vec<u32> = (0..6000)
            .map(|i| (unit_float(seed, i) * cells) as u32)
            .collect();
        grid.update(&some, &vec![1.0; some.len()]);
        grid.rebuild_bits(0.5);
    }
    let (full_object, full_background) = (full(50, 1.0), full(70, 2.0));
    let rays = some_rays(300);
    let config = MarchConfig {
        step_object: 0.013,
        jitter: Jitter::Seeded(3),
        ..MarchConfig::default()
    };
    let found = march(
        &rays,
        Grids {
            object: Some(&object),
            background: Some(&background),
        },
        &config,
    );
    let all = march(
        &rays,
        Grids {
            object: Some(&full_object),
            background: Some(&full_background),
        },
        &config,
    );
    assert!(found.len() > 500);
    for (i, ray) in rays.iter().enumerate() {
        let mut at = of_ray(&found, i).peekable();
        for k in of_ray(&all, i) {
            let p = ray.at(all.t[k]);
            let inside = p.abs().max_element();
            // Which grids were asked there is a matter of rounding.
            if (inside - 1.0).abs() < 1e-5 {
                at.next_if(|&j| found.t[j] == all.t[k]);
                continue;
            }
            let f = inside <= 1.0 && object.occupied(p);
            let b = background.occupied(contract(p));
            if f || b {
                let j = at.next().unwrap();
                assert_eq!((found.t[j], found.dt[j]), (all.t[k], all.dt[k]));
                assert_eq!((found.object[j], found.background[j]), (f, b), "ray {i}");
            }
        }
        // The last one is there whatever the grids say.
        assert!(at.len() <= 1, "ray {i}: {} steps in empty space", at.len());
    }
}

#[test]
fn a_field_without_grid_is_never_asked() {
    let object = full(16, 1.0);
    let rays = some_rays(50);
    let grids = Grids {
        object: Some(&object),
        background: None,
    };
    let intervals = march(&rays, grids, &MarchConfig::default());
    assert!(intervals.background.iter().all(|&b| !b));
    assert_eq!(
        intervals.samples(Field::Object, &rays).len(),
        intervals.len()
    );
    assert!(march(&rays, Grids::default(), &MarchConfig::default()).is_empty());
    assert_eq!(march(&[], grids, &MarchConfig::default()).ray_count(), 0);
}

#[test]
fn rays_may_be_endless_where_no_background_is_marched_there() {
    let (object, background) = (full(16, 1.0), full(16, 2.0));
    let rays = some_rays(50);
    let endless = |behind_box| MarchConfig {
        far: f32::INFINITY,
        behind_box,
        ..MarchConfig::default()
    };
    for (background, behind_box) in [(None, true), (Some(&background), false)] {
        let grids = Grids {
            object: Some(&object),
            background,
        };
        let ends = MarchConfig {
            behind_box,
            ..MarchConfig::default()
        };
        let intervals = march(&rays, grids, &endless(behind_box));
        assert!(!intervals.is_empty());
        assert_eq!(intervals, march(&rays, grids, &ends));
    }
}

#[test]
#[should_panic(
    expected = "march: the background is marched from 0.01 to inf, which must be finite"
)]
fn an_endless_background_is_named() {
    let background = full(16, 2.0);
    let grids = Grids {
        object: None,
        background: Some(&background),
    };
    let config = MarchConfig {
        far: f32::INFINITY,
        ..MarchConfig::default()
    };
    march(&some_rays(1), grids, &config);
}

#[test]
fn too_many_intervals_are_coarsened_not_cut_short() {
    let (object, background) = (full(16, 1.0), full(16, 2.0));
    let grids = Grids {
        object: Some(&object),
        background: Some(&background),
    };
    let rays = some_rays(50);
    let config = MarchConfig {
        max_intervals_per_ray: 100,
        ..MarchConfig::default()
    };
    let intervals = march(&rays, grids, &config);
    for i in 0..rays.len() {
        let range = of_ray(&intervals, i);
        assert!(range.len() <= 100);
        let length: f32 = intervals.dt[range].iter().sum();
        assert!((length / (config.far - config.near) - 1.0).abs() < 1e-4);
    }
}

#[test]
fn memory_is_reused_and_threads_do_not_matter() {
    let object = full(16, 1.0);
    let grids = Grids {
        object: Some(&object),
        background: None,
    };
    let rays = some_rays(500);
    let config = MarchConfig {
        jitter: Jitter::Seeded(1),
        ..MarchConfig::default()
    };
    let mut marcher = Marcher::new();
    let mut out = Intervals::default();
    marcher.march(&rays, grids, &config, &mut out);
    let first = out.clone();
    marcher.march(&rays[..10], grids, &config, &mut out);
    assert_eq!(out.ray_count(), 10);
    let single = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    single.install(|| marcher.march(&rays, grids, &config, &mut out));
    assert_eq!(out, first);
}
