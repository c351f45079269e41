//! Depths of the views, from the fields without gradients.

use glam::Vec2;
use neus_render::rays::Ray;

use crate::prepare::{Prepared, outline};
use crate::render::rays::FrozenScene;

/// Distances along the rays of one view, on a raster `stride` pixels apart.
#[derive(Clone, Debug)]
pub struct DepthPicture {
    /// Pixels from point to point of the raster.
    pub stride: u32,
    /// Points along a row.
    pub width: u32,
    /// Row-major, normalised frame; infinite where a ray meets nothing in the box, not a number where
    /// nobody looked.
    pub distances: Vec<f32>,
}

impl DepthPicture {
    /// The distance at a pixel.
    #[must_use]
    pub fn at(&self, pixel: Vec2) -> f32 {
        let x = (pixel.x.max(0.0) as u32 / self.stride).min(self.width - 1);
        let y = pixel.y.max(0.0) as u32 / self.stride;
        let i = (y * self.width + x) as usize;
        self.distances.get(i).copied().unwrap_or(f32::NAN)
    }
}

/// Where half of each ray's light has come from, for the pixels that may show the object.
#[must_use]
pub fn depth_pictures(scene: &FrozenScene, data: &Prepared, stride: u32) -> Vec<DepthPicture> {
    data.views
        .iter()
        .map(|view| {
            let world_from_camera = view.world_from_camera(&data.frame);
            let (width, height) = (
                view.width().div_ceil(stride),
                view.height().div_ceil(stride),
            );
            let asked = outline::silhouette(view, &data.frame, &data.map, stride).into_raw();
            let limit = (255.0 * scene.config.prepare.hull_threshold * 0.5) as u8;
            let mut distances = vec![f32::NAN; (width * height) as usize];
            let (mut rays, mut at): (Vec<Ray>, Vec<usize>) = (Vec::new(), Vec::new());
            for i in 0..width * height {
                if asked[i as usize] < limit {
                    continue;
                }
                let pixel =
                    Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5) * stride as f32;
                if let Some(ray) = view.ray(&world_from_camera, pixel) {
                    rays.push(ray);
                    at.push(i as usize);
                }
            }
            for (i, distance) in at.into_iter().zip(scene.median_distances(&rays)) {
                distances[i] = distance;
            }
            DepthPicture {
                stride,
                width,
                distances,
            }
        })
        .collect()
}
