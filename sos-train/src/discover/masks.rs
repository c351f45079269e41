//! From the points that are the object to a rough mask for a view.

use glam::{Vec2, Vec3};
use image::{GrayImage, Luma};

use crate::prepare::{Frame, TrainView};
use crate::train::carve::depth::DepthPicture;

/// The pixels of a raster and the points of the normalised frame that they show.
pub(super) fn points<'a>(
    view: &'a TrainView,
    frame: &Frame,
    depth: &'a DepthPicture,
) -> impl Iterator<Item = (Vec2, Vec3)> + 'a {
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
        Some((pixel, ray.at(distance)))
    })
}

/// White where `view` shows points that are the object.
#[must_use]
pub fn project(
    view: &TrainView,
    frame: &Frame,
    depth: &DepthPicture,
    is_object: impl Fn(Vec3) -> bool,
) -> GrayImage {
    let stride = depth.stride;
    let (width, height) = (
        depth.width,
        depth.distances.len() as u32 / depth.width.max(1),
    );
    let mut raster = GrayImage::new(width, height);
    for (pixel, point) in points(view, frame, depth) {
        if is_object(point) {
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
mod tests {
    use super::*;

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
