//! Draws a signed distance field as text and turns it into a mesh:
//! `cargo run --release -p neus-render --example draw_a_torus`.

use glam::{Affine3A, Vec2, Vec3};
use neus_render::field::FnSdf;
use neus_render::intersect::{Aabb, ray_box};
use neus_render::isosurface::{IsosurfaceConfig, IsosurfaceError, extract_isosurface};
use neus_render::rays::{Pinhole, Ray, camera_ray};
use neus_render::trace::{TraceConfig, sphere_trace};

const WIDTH: usize = 60;
const HEIGHT: usize = 30;
const SHADES: &[u8; 8] = b".,:;+*#@";
const LIGHT: Vec3 = Vec3::new(0.4, 0.6, -0.7);

/// Radii 0.6 and 0.25, the hole along z.
fn torus(p: Vec3) -> f32 {
    Vec2::new(p.truncate().length() - 0.6, p.z).length() - 0.25
}

/// By central differences.
fn normal(p: Vec3) -> Vec3 {
    let slope = |axis: Vec3| torus(p + 1e-3 * axis) - torus(p - 1e-3 * axis);
    Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z)).normalize_or_zero()
}

fn main() -> Result<(), IsosurfaceError> {
    let camera = Pinhole {
        // Characters are twice as high as wide.
        focal: Vec2::new(72.0, 36.0),
        centre: Vec2::new(WIDTH as f32, HEIGHT as f32) / 2.0,
    };
    let turn = Affine3A::from_rotation_x(0.7);
    let world_from_camera = turn * Affine3A::from_translation(Vec3::new(0.0, 0.0, -2.4));
    let pixels = (0..WIDTH * HEIGHT).map(|i| {
        let pixel = Vec2::new((i % WIDTH) as f32 + 0.5, (i / WIDTH) as f32 + 0.5);
        camera_ray(&camera, world_from_camera, pixel)
    });
    let rays: Vec<Ray> = pixels.flatten().collect();
    let spans: Vec<_> = rays.iter().map(|ray| ray_box(ray, &Aabb::UNIT)).collect();
    let field = FnSdf(torus);
    let (hits, statistics) = sphere_trace(&field, &rays, &spans, &TraceConfig::default());
    for (row, hits) in rays.chunks(WIDTH).zip(hits.chunks(WIDTH)) {
        let shade = |(ray, hit): (&Ray, &neus_render::trace::Hit)| match hit.distance() {
            Some(t) => {
                let light = normal(ray.at(t)).dot(turn.transform_vector3(LIGHT).normalize());
                char::from(SHADES[(light.clamp(0.0, 0.99) * SHADES.len() as f32) as usize])
            }
            None => ' ',
        };
        println!("{}", row.iter().zip(hits).map(shade).collect::<String>());
    }
    println!("{statistics:?}");

    let mesh = extract_isosurface(&field, &Aabb::UNIT, &IsosurfaceConfig::default())?;
    let (triangles, area, volume) = (mesh.triangles.len(), mesh.area(), mesh.volume());
    println!("{triangles} triangles, area {area:.3} (exact 5.922), volume {volume:.3} (0.740)");
    Ok(())
}
