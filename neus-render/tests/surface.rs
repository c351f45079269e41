//! Tracing and meshing of solids that are known in closed form.

// A test fails by panicking.
#![allow(clippy::unwrap_used)]

use std::collections::HashMap;

use glam::{Affine3A, Vec3};
use neus_render::{
    field::{FnSdf, SdfBatch},
    intersect::{Aabb, ray_box},
    isosurface::{Border, IsosurfaceConfig, IsosurfaceError, Measure, Mesh, extract_isosurface},
    random::unit_float,
    rays::Ray,
    trace::{Hit, TraceConfig, sphere_trace},
};

fn config(resolution: u32) -> IsosurfaceConfig {
    IsosurfaceConfig {
        resolution,
        ..IsosurfaceConfig::default()
    }
}

fn box_sdf(p: Vec3, half: Vec3) -> f32 {
    let q = p.abs() - half;
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
}

/// Every directed edge once, and its reverse once: closed and consistently oriented.
#[track_caller]
fn assert_closed(mesh: &Mesh) {
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            assert_ne!(from, to);
            *edges.entry((from, to)).or_default() += 1;
        }
    }
    for (&(from, to), &count) in &edges {
        assert_eq!(count, 1, "edge {from}-{to}");
        assert_eq!(edges.get(&(to, from)), Some(&1), "edge {to}-{from}");
    }
}

fn part_count(mesh: &Mesh) -> usize {
    let mut parts = mesh.parts();
    parts.sort_unstable();
    parts.dedup();
    parts.len()
}

#[test]
fn a_sphere_is_closed_with_the_right_area_volume_and_normals() {
    // Off the lattice's symmetry, over several blocks.
    let centre = Vec3::new(0.03, -0.07, 0.011);
    let sphere = FnSdf(|p: Vec3| p.distance(centre) - 0.6);
    for resolution in [20, 64, 100] {
        let mesh = extract_isosurface(&sphere, &Aabb::UNIT, &config(resolution)).unwrap();
        assert_closed(&mesh);
        assert_eq!(part_count(&mesh), 1);
        let pi = std::f64::consts::PI;
        assert!((mesh.area() / (4.0 * pi * 0.36) - 1.0).abs() < 0.01);
        assert!((mesh.volume() / (4.0 / 3.0 * pi * 0.216) - 1.0).abs() < 0.02);
        for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
            assert!((*p - centre).normalize().dot(*n) > 0.999);
        }
        // A closed surface without handles: V - E + F = 2, and E = 3F/2.
        assert_eq!(mesh.positions.len() * 2, mesh.triangles.len() + 4);
    }
}

#[test]
fn walls_of_a_hollow_box_keep_both_sides() {
    let hollow = FnSdf(|p: Vec3| {
        let outer = box_sdf(p, Vec3::splat(0.6));
        let inner = box_sdf(p, Vec3::splat(0.56));
        outer.max(-inner)
    });
    let mesh = extract_isosurface(&hollow, &Aabb::UNIT, &config(64)).unwrap();
    assert_closed(&mesh);
    assert_eq!(part_count(&mesh), 2);
    let expected = 1.2f64.powi(3) - 1.12f64.powi(3);
    assert!((mesh.volume() / expected - 1.0).abs() < 0.05);
}

/// Noise cuts cells in every way there is, with ambiguous faces among them.
#[test]
fn noise_is_closed_too() {
    for seed in 0..3 {
        let noise = FnSdf(|p: Vec3| {
            let q = (p * 1000.0).round().as_ivec3();
            let key =
                (q.x as u64 & 0xffff) | (q.y as u64 & 0xffff) << 16 | (q.z as u64 & 0xffff) << 32;
            unit_float(seed, key) - 0.4
        });
        let mesh = extract_isosurface(&noise, &Aabb::UNIT, &config(40)).unwrap();
        assert!(mesh.triangles.len() > 50_000);
        assert_closed(&mesh);
    }
}

/// A field whose values at the same point differ from call to call by rounding, as those of
/// matrix products in batches of different shape do.
#[test]
fn a_field_that_rounds_differently_leaves_no_crack() {
    struct Shaky(std::sync::atomic::AtomicU64);
    impl SdfBatch for Shaky {
        fn sdf(&self, points: &[Vec3], out: &mut [f32]) {
            for (value, p) in out.iter_mut().zip(points) {
                let call = self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                // The box's faces pass exactly through nodes, where only the error decides.
                *value = box_sdf(*p, Vec3::splat(0.5)) + 1e-6 * (unit_float(1, call) - 0.5);
            }
        }
    }
    let mesh = extract_isosurface(&Shaky(0.into()), &Aabb::UNIT, &config(64)).unwrap();
    assert_closed(&mesh);
}

#[test]
fn a_surface_that_the_first_pass_missed_is_followed() {
    // Distances are overstated tenfold, but a bulge reaches a block centre.
    let steep = FnSdf(|p: Vec3| 10.0 * (p.distance(Vec3::splat(0.1)) - 0.7));
    let wary = IsosurfaceConfig {
        overestimate: 1.0,
        ..config(96)
    };
    let mesh = extract_isosurface(&steep, &Aabb::UNIT, &wary).unwrap();
    assert_closed(&mesh);
}

#[test]
fn the_border_closes_or_cuts() {
    let half_space = FnSdf(|p: Vec3| p.z - 0.1);
    let closed = extract_isosurface(&half_space, &Aabb::UNIT, &config(24)).unwrap();
    assert_closed(&closed);
    let open = IsosurfaceConfig {
        border: Border::Open,
        ..config(24)
    };
    let open = extract_isosurface(&half_space, &Aabb::UNIT, &open).unwrap();
    assert!((open.area() - 4.0).abs() < 1e-3);
    // A box that isn't a cube, with a resolution that isn't a multiple of the block's.
    let aabb = Aabb {
        min: Vec3::new(-0.8, -0.5, -0.3),
        max: Vec3::new(0.9, 0.5, 0.4),
    };
    let solid = extract_isosurface(&FnSdf(|_| -1.0), &aabb, &config(37)).unwrap();
    assert_closed(&solid);
    // All of the box is in it, but for half a cell along the edges.
    assert!((solid.volume() / (1.7 * 0.7) - 1.0).abs() < 0.015);
    let corner = |take: fn(Vec3, Vec3) -> Vec3| solid.positions.iter().copied().reduce(take);
    assert!(corner(Vec3::min).unwrap().distance(aabb.min) < 1e-6);
    assert!(corner(Vec3::max).unwrap().distance(aabb.max) < 1e-6);
}

/// A field that knows nothing of what lies outside the box, be it a cube, blocks full or not, the surface cut off or
/// not.
#[test]
fn the_field_is_asked_within_the_box_alone() {
    let slab = Aabb {
        min: Vec3::new(-0.8, -0.5, -0.3),
        max: Vec3::new(0.9, 0.5, 0.4),
    };
    let thin = Aabb {
        min: Vec3::new(0.2, 0.2, 0.1),
        max: Vec3::new(1.2, 0.7, 0.107),
    };
    let centre = Vec3::new(0.7, 0.2, 0.1);
    let borders = [Border::Open, Border::Closed];
    for (aabb, resolution, borders) in [
        (Aabb::UNIT, 100, &borders[..]),
        (Aabb::UNIT, 49, &borders),
        (slab, 37, &borders),
        // A single layer of cells, of which nothing is left by a border that closes.
        (thin, 10, &borders[..1]),
    ] {
        let ball = FnSdf(|p: Vec3| {
            let sdf = p.distance(centre) - 0.4;
            if aabb.contains(p) { sdf } else { f32::NAN }
        });
        for &border in borders {
            let config = IsosurfaceConfig {
                border,
                ..config(resolution)
            };
            let mesh = extract_isosurface(&ball, &aabb, &config).unwrap();
            assert!(mesh.positions.iter().all(|&p| aabb.contains(p)));
            for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
                assert!((*p - centre).normalize().dot(*n) > 0.99);
            }
            if border == Border::Closed {
                assert_closed(&mesh);
            }
        }
    }
}

#[test]
fn no_surface_is_said_so() {
    let error = extract_isosurface(&FnSdf(|_| 5.0), &Aabb::UNIT, &config(32)).unwrap_err();
    assert_eq!(error, IsosurfaceError::NoSurface { side: "positive" });
    assert!(error.to_string().starts_with("the box contains no surface"));
    let nan = extract_isosurface(&FnSdf(|_| f32::NAN), &Aabb::UNIT, &config(32));
    assert!(matches!(nan, Err(IsosurfaceError::NotFinite { .. })));
    let flat = Aabb {
        min: Vec3::ZERO,
        max: Vec3::new(1.0, 1.0, 0.0),
    };
    let flat = extract_isosurface(&FnSdf(|_| 1.0), &flat, &config(32));
    assert_eq!(flat, Err(IsosurfaceError::NoGrid { resolution: 32 }));
}

#[test]
fn a_box_of_a_single_cell_cannot_be_closed() {
    let thin = Aabb {
        min: Vec3::new(-1.0, -1.0, 0.0),
        max: Vec3::new(1.0, 1.0, 0.1),
    };
    let solid = FnSdf(|_| -1.0);
    let error = extract_isosurface(&solid, &thin, &config(20)).unwrap_err();
    assert_eq!(error, IsosurfaceError::TooThin { resolution: 20 });
    assert!(error.to_string().contains("higher resolution"));
    let one = extract_isosurface(&solid, &Aabb::UNIT, &config(1));
    assert_eq!(one, Err(IsosurfaceError::TooThin { resolution: 1 }));
    // Two cells have nodes between them.
    assert_closed(&extract_isosurface(&solid, &thin, &config(40)).unwrap());
}

#[test]
fn small_parts_are_dropped_and_frames_changed() {
    let field = FnSdf(|p: Vec3| {
        let big = p.distance(Vec3::splat(-0.3)) - 0.4;
        let small = p.distance(Vec3::splat(0.5)) - 0.2;
        let tiny = p.distance(Vec3::new(0.8, -0.8, 0.0)) - 0.06;
        big.min(small).min(tiny)
    });
    let mut mesh = extract_isosurface(&field, &Aabb::UNIT, &config(64)).unwrap();
    assert_eq!(part_count(&mesh), 3);
    // Areas are as 1 : 0.25 : 0.02, volumes as 1 : 0.125 : 0.003.
    assert_eq!(mesh.clone().keep_large_parts(Measure::Area, 0.2), 1);
    assert_eq!(mesh.clone().keep_large_parts(Measure::Volume, 0.2), 2);
    assert_eq!(mesh.keep_large_parts(Measure::Volume, 0.1), 1);
    assert_closed(&mesh);
    assert_eq!(part_count(&mesh), 2);
    let volume = mesh.volume();
    mesh.transform(&Affine3A::from_scale(Vec3::new(-2.0, 2.0, 2.0)));
    assert!((mesh.volume() / (8.0 * volume) - 1.0).abs() < 1e-4);
}

#[test]
fn traced_rays_arrive_at_a_sphere() {
    let sphere = FnSdf(|p: Vec3| p.length() - 0.5);
    let rays: Vec<Ray> = (0u64..500)
        .filter_map(|i| {
            let at = |k| 2.0 * unit_float(5, 4 * i + k) - 1.0;
            let origin = Vec3::new(at(0), at(1), -3.0);
            Ray::new(origin, Vec3::new(0.2 * at(2), 0.2 * at(3), 1.0))
        })
        .collect();
    let spans: Vec<_> = rays.iter().map(|ray| ray_box(ray, &Aabb::UNIT)).collect();
    let (hits, statistics) = sphere_trace(&sphere, &rays, &spans, &TraceConfig::default());
    assert_eq!(statistics.given_up, 0);
    assert_eq!(statistics.hits + statistics.misses, rays.len());
    for (ray, hit) in rays.iter().zip(&hits) {
        let exact = neus_render::intersect::ray_sphere(ray, Vec3::ZERO, 0.5);
        match (hit.distance(), exact) {
            // Grazing rays meet the tolerance before the sphere.
            (Some(t), Some(span)) => {
                assert!((ray.at(t).length() - 0.5).abs() < 2e-4 && t <= span.far)
            }
            (Some(t), None) => assert!(ray.at(t).length() < 0.5002),
            (None, exact) => assert!(exact.is_none()),
        }
    }
}

/// Steps that are too long pass through a thin shell's front; the bracket finds it again.
#[test]
fn overstated_distances_are_brought_back() {
    let steep = FnSdf(|p: Vec3| 1.6 * (p.length() - 0.5));
    let ray = Ray {
        origin: Vec3::new(0.1, 0.0, -3.0),
        direction: Vec3::Z,
    };
    let spans = [ray_box(&ray, &Aabb::UNIT)];
    let (hits, statistics) = sphere_trace(&steep, &[ray], &spans, &TraceConfig::default());
    let t = hits[0].distance().unwrap();
    assert!((ray.at(t).length() - 0.5).abs() < 1e-3);
    assert!(statistics.rounds < 30);
}

#[test]
fn rays_that_begin_inside_or_nowhere_end_at_once() {
    let field = FnSdf(|p: Vec3| p.length() - 0.5);
    let ray = Ray {
        origin: Vec3::ZERO,
        direction: Vec3::Z,
    };
    let inside = ray_box(&ray, &Aabb::UNIT).and_then(|span| span.clip(0.1, 10.0));
    let (hits, _) = sphere_trace(
        &field,
        &[ray, ray],
        &[inside, None],
        &TraceConfig::default(),
    );
    assert_eq!(hits, [Hit::Surface(0.1), Hit::Miss]);
    let broken = FnSdf(|_| f32::NAN);
    let (hits, statistics) = sphere_trace(&broken, &[ray], &[inside], &TraceConfig::default());
    assert_eq!(hits, [Hit::GivenUp(0.1)]);
    assert_eq!(statistics.given_up, 1);
}
