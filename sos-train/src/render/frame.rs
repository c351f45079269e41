//! One picture from a camera where no photo was taken.

use super::edge_width::EdgeWidth;
use super::path::NovelCamera;
use super::rays::FrozenScene;
use glam::{Vec2, Vec3};
use neus_render::intersect::{Aabb, ray_box};
use neus_render::rays::Ray;

/// Rays along each side of a pixel.
const RAYS: u32 = 2;

/// A picture's pixels, rows from the top. Colours are straight, sRGB in `[0, 1]`.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Coverage by the object.
    pub alpha: Vec<f32>,
    /// The object's own colour.
    pub object: Vec<Vec3>,
    /// Everything; empty for a picture of the object alone.
    pub scene: Vec<Vec3>,
    /// Everything but the object; empty likewise.
    pub background: Vec<Vec3>,
}

/// The object by itself, as if nothing else were there.
#[must_use]
pub fn draw_object(scene: &FrozenScene, camera: &NovelCamera) -> Frame {
    let box_ = Aabb::UNIT;
    let (rays, owner) = rays(camera, |ray| ray_box(ray, &box_).is_some());
    let pixels = (camera.width * camera.height) as usize;
    let mut alpha = vec![0.0; pixels];
    let mut object = vec![Vec3::ZERO; pixels];
    let edge_width = EdgeWidth::new(scene, camera.pixel_at_object());
    for (hit, &i) in scene.objects(&rays).iter().zip(&owner) {
        let opacity = edge_width.of(hit.object_opacity);
        alpha[i] += opacity;
        object[i] += opacity * hit.object;
    }
    straight(&mut alpha, &mut object);
    Frame {
        alpha,
        object,
        scene: Vec::new(),
        background: Vec::new(),
    }
}

/// The whole scene, the scene without the object, and what is to be seen of the object.
#[must_use]
pub fn draw_scene(scene: &FrozenScene, camera: &NovelCamera) -> Frame {
    let (rays, owner) = rays(camera, |_| true);
    let pixels = (camera.width * camera.height) as usize;
    let mut frame = Frame {
        alpha: vec![0.0; pixels],
        object: vec![Vec3::ZERO; pixels],
        scene: vec![Vec3::ZERO; pixels],
        background: vec![Vec3::ZERO; pixels],
    };
    let edge_width = EdgeWidth::new(scene, camera.pixel_at_object());
    for (hit, &i) in scene.render(&rays).iter().zip(&owner) {
        let matte = edge_width.of(hit.matte);
        frame.alpha[i] += matte;
        frame.object[i] += matte * hit.object;
        frame.scene[i] += hit.joint / (RAYS * RAYS) as f32;
        frame.background[i] += hit.background / (RAYS * RAYS) as f32;
    }
    straight(&mut frame.alpha, &mut frame.object);
    frame
}

/// From sums over a pixel's rays to means, and from premultiplied colours to straight ones.
fn straight(alpha: &mut [f32], colours: &mut [Vec3]) {
    for (alpha, colour) in alpha.iter_mut().zip(colours) {
        *colour = (*colour / alpha.max(1e-6)).clamp(Vec3::ZERO, Vec3::ONE);
        *alpha = (*alpha / (RAYS * RAYS) as f32).clamp(0.0, 1.0);
    }
}

/// Rays spread over every pixel, those that are wanted, with the pixel's number.
fn rays(camera: &NovelCamera, wanted: impl Fn(&Ray) -> bool) -> (Vec<Ray>, Vec<usize>) {
    let (mut rays, mut owner) = (Vec::new(), Vec::new());
    for y in 0..camera.height * RAYS {
        for x in 0..camera.width * RAYS {
            let pixel = (Vec2::new(x as f32, y as f32) + 0.5) / RAYS as f32;
            if let Some(ray) = camera.ray(pixel).filter(&wanted) {
                rays.push(ray);
                owner.push((y / RAYS * camera.width + x / RAYS) as usize);
            }
        }
    }
    (rays, owner)
}
