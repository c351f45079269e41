//! One picture from a camera where no photo was taken.

use std::ops::Range;

use super::edge_width::EdgeWidth;
use super::path::NovelCamera;
use super::rays::FrozenScene;
use glam::{Vec2, Vec3};
use neus_render::intersect::{Aabb, ray_box};
use neus_render::rays::Ray;

/// Rays along each side of a pixel.
const RAYS: u32 = 2;
/// Pixels whose rays are drawn at once: some 90 bytes each ray, and twice that while they are collected.
const PIXELS_AT_ONCE: u32 = 1 << 17;

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
    let pixels = pixel_count(camera);
    let mut alpha = vec![0.0; pixels];
    let mut object = vec![Vec3::ZERO; pixels];
    let edge_width = EdgeWidth::new(scene, camera.pixel_at_object());
    for rows in bands(camera.width, camera.height) {
        let (rays, owner) = rays(camera, rows, |ray| ray_box(ray, &box_).is_some());
        for (hit, &i) in scene.objects(&rays).iter().zip(&owner) {
            let opacity = edge_width.of(hit.object_opacity);
            alpha[i] += opacity;
            object[i] += opacity * hit.object;
        }
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
    let pixels = pixel_count(camera);
    let mut frame = Frame {
        alpha: vec![0.0; pixels],
        object: vec![Vec3::ZERO; pixels],
        scene: vec![Vec3::ZERO; pixels],
        background: vec![Vec3::ZERO; pixels],
    };
    let edge_width = EdgeWidth::new(scene, camera.pixel_at_object());
    for rows in bands(camera.width, camera.height) {
        let (rays, owner) = rays(camera, rows, |_| true);
        for (hit, &i) in scene.render(&rays).iter().zip(&owner) {
            let matte = edge_width.of(hit.matte);
            frame.alpha[i] += matte;
            frame.object[i] += matte * hit.object;
            frame.scene[i] += hit.joint / (RAYS * RAYS) as f32;
            frame.background[i] += hit.background / (RAYS * RAYS) as f32;
        }
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

fn pixel_count(camera: &NovelCamera) -> usize {
    camera.width as usize * camera.height as usize
}

/// Rows of pixels that are drawn at once, one stretch after the other.
fn bands(width: u32, height: u32) -> impl Iterator<Item = Range<u32>> {
    let rows = (PIXELS_AT_ONCE / width.max(1)).clamp(1, height.max(1));
    let begins = (0..height).step_by(rows as usize);
    begins.map(move |begin| begin..(begin + rows).min(height))
}

/// Rays spread over every pixel of some rows, those that are wanted, with the pixel's number in the picture.
fn rays(
    camera: &NovelCamera,
    rows: Range<u32>,
    wanted: impl Fn(&Ray) -> bool,
) -> (Vec<Ray>, Vec<usize>) {
    let (mut rays, mut owner) = (Vec::new(), Vec::new());
    for y in rows.start * RAYS..rows.end * RAYS {
        for x in 0..camera.width * RAYS {
            let pixel = (Vec2::new(x as f32, y as f32) + 0.5) / RAYS as f32;
            if let Some(ray) = camera.ray(pixel).filter(&wanted) {
                rays.push(ray);
                let (x, y) = ((x / RAYS) as usize, (y / RAYS) as usize);
                owner.push(y * camera.width as usize + x);
            }
        }
    }
    (rays, owner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_all_rows_once() {
        for (width, height) in [(0, 3), (640, 480), (8192, 5000), (200_000, 3)] {
            let rows: Vec<u32> = bands(width, height).flatten().collect();
            assert_eq!(rows, (0..height).collect::<Vec<_>>());
            let most = bands(width, height).map(|rows| rows.len()).max();
            let pixels = most.unwrap_or(0) * width as usize;
            assert!(pixels <= (PIXELS_AT_ONCE as usize).max(width as usize));
        }
    }
}
