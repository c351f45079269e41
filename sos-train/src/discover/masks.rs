//! From the points that are the object to a rough mask for a view.

use glam::{Vec2, Vec3};
use image::{GrayImage, Luma};
use neus_render::rays::Ray;

use super::part_set::voxel;
use crate::prepare::{Frame, TrainView};
use crate::train::carve::depth::DepthPicture;

/// How many voxels before what all views together see a view's own surface is haze, which the others see past.
const HAZE: f32 = 2.0;
/// Steps per voxel along a ray.
const STEPS: f32 = 2.0;

/// The pixels of a raster and the points of the normalised frame that they show.
pub(super) fn points<'a>(
    view: &'a TrainView,
    frame: &Frame,
    depth: &'a DepthPicture,
) -> impl Iterator<Item = (Vec2, Vec3)> + 'a {
    rays(view, frame, depth).map(|(pixel, ray, distance)| (pixel, ray.at(distance)))
}

/// The pixels of a raster, their rays and how far along them the view sees.
fn rays<'a>(
    view: &'a TrainView,
    frame: &Frame,
    depth: &'a DepthPicture,
) -> impl Iterator<Item = (Vec2, Ray, f32)> + 'a {
    let world_from_camera = view.world_from_camera(frame);
    let stride = depth.stride as f32;
    (0..depth.distances.len()).filter_map(move |i| {
        let distance = depth.distances[i];
        if !distance.is_finite() {
            return None;
        }
        let raster = Vec2::new(
            (i as u32 % depth.width) as f32,
            (i as u32 / depth.width) as f32,
        );
        let last = Vec2::new(view.width() as f32 - 0.5, view.height() as f32 - 0.5);
        let pixel = ((raster + 0.5) * stride).min(last);
        let ray = view.ray(&world_from_camera, pixel)?;
        Some((pixel, ray, distance))
    })
}

/// What a view shows at the end of a ray: its own surface, or where that is haze the first one behind it that all views together see,
/// by the distances `fused` of `resolution^3` voxels.
fn shown(ray: &Ray, distance: f32, fused: &[f32], resolution: usize) -> Vec3 {
    let side = 2.0 / resolution as f32;
    let at = |point: Vec3| voxel(point, resolution).map(|cell| fused[cell]);
    let own = ray.at(distance);
    if at(own).is_none_or(|before| before <= HAZE * side) {
        return own;
    }
    (1..)
        .map(|step| ray.at(distance + step as f32 * side / STEPS))
        .map_while(|point| at(point).map(|before| (point, before)))
        .find(|(_, before)| *before < 0.0)
        .map_or(own, |(point, _)| point)
}

/// White where `view` shows points that are the object; `fused` are the distances of what all views see, on `resolution^3` voxels.
#[must_use]
pub fn project(
    view: &TrainView,
    frame: &Frame,
    depth: &DepthPicture,
    (fused, resolution): (&[f32], usize),
    is_object: impl Fn(Vec3) -> bool,
) -> GrayImage {
    let stride = depth.stride;
    let (width, height) = (
        depth.width,
        depth.distances.len() as u32 / depth.width.max(1),
    );
    let mut raster = GrayImage::new(width, height);
    for (pixel, ray, distance) in rays(view, frame, depth) {
        if is_object(shown(&ray, distance, fused, resolution)) {
            let x = (pixel.x as u32 / stride).min(width - 1);
            let y = (pixel.y as u32 / stride).min(height - 1);
            raster.put_pixel(x, y, Luma([255]));
        }
    }
    let even = majority(&majority(&raster));
    GrayImage::from_fn(view.width(), view.height(), |x, y| {
        *even.get_pixel((x / stride).min(width - 1), (y / stride).min(height - 1))
    })
}

/// Each pixel as most of the nine around it are: specks and pinholes vanish.
fn majority(mask: &GrayImage) -> GrayImage {
    let (width, height) = mask.dimensions();
    GrayImage::from_fn(width, height, |x, y| {
        let mut white = 0;
        for dy in -1..=1i64 {
            for dx in -1..=1i64 {
                let at =
                    |v: u32, d: i64, n: u32| (i64::from(v) + d).clamp(0, i64::from(n) - 1) as u32;
                white += u32::from(mask.get_pixel(at(x, dx, width), at(y, dy, height)).0[0] >= 128);
            }
        }
        Luma([if white >= 5 { 255 } else { 0 }])
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use scene_decomp::probability::ProbabilityMap;

    use super::*;

    #[test]
    fn haze_gives_way_to_what_all_views_see_behind_it() {
        let n = 40;
        // Solid from 0.3 on along the ray.
        let fused: Vec<f32> = (0..n * n * n)
            .map(|cell| ProbabilityMap::centre(n, cell).x)
            .map(|x| (0.3 - x).clamp(-0.2, 0.2))
            .collect();
        let ray = Ray::new(Vec3::new(-0.95, 0.02, 0.02), Vec3::X).unwrap();
        let at = |distance: f32| shown(&ray, distance, &fused, n).x;
        assert!((at(0.5) - 0.3).abs() < 0.05, "{}", at(0.5));
        // Near the surface, behind it and beyond the region a view is believed.
        for distance in [1.2, 1.6, 2.5] {
            assert_eq!(at(distance), ray.at(distance).x);
        }
        // Nothing is behind it.
        assert_eq!(shown(&ray, 0.5, &vec![0.2; n * n * n], n), ray.at(0.5));
    }

    #[test]
    fn specks_and_pinholes_vanish() {
        let mut mask = GrayImage::new(12, 12);
        for (x, y) in (0..12).flat_map(|y| (6..12).map(move |x| (x, y))) {
            mask.put_pixel(x, y, Luma([255]));
        }
        let clean = mask.clone();
        mask.put_pixel(2, 5, Luma([255]));
        mask.put_pixel(9, 5, Luma([0]));
        assert_eq!(majority(&mask), clean);
    }
}
