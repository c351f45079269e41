//! Depths of the views, from the fields without gradients.

use glam::Vec2;
use neus_render::rays::Ray;

use crate::prepare::{Frame, Prepared, TrainView, outline};
use crate::render::rays::FrozenScene;

/// Points of all rasters together: 256 MiB of distances, however many photos there are and however small the object is in them.
const MOST_POINTS: f32 = 67_108_864.0;

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
    /// The pixel that a point of the raster stands for.
    #[must_use]
    pub fn pixel(&self, i: usize) -> Vec2 {
        let (x, y) = (i as u32 % self.width, i as u32 / self.width);
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * self.stride as f32
    }

    /// The distance at a pixel.
    #[must_use]
    pub fn at(&self, pixel: Vec2) -> f32 {
        let x = (pixel.x.max(0.0) as u32 / self.stride).min(self.width - 1);
        let y = pixel.y.max(0.0) as u32 / self.stride;
        let i = (y * self.width + x) as usize;
        self.distances.get(i).copied().unwrap_or(f32::NAN)
    }
}

/// Where half of each ray's light has come from, for the pixels that may show the object; about `rays` in
/// all views together, on a raster.
#[must_use]
pub fn depth_pictures(scene: &FrozenScene, data: &Prepared, rays: usize) -> Vec<DepthPicture> {
    let pixels: usize = data.outlines.iter().map(|o| o.candidates.len()).sum();
    let all: usize = data
        .views
        .iter()
        .map(|view| view.width() as usize * view.height() as usize)
        .sum();
    let least = (pixels as f32 / rays as f32).max(all as f32 / MOST_POINTS);
    let stride = least.sqrt().ceil().max(1.0) as u32;
    let limit = (255.0 * scene.config.prepare.hull_threshold * 0.5) as u8;
    data.views
        .iter()
        .map(|view| {
            let asked = outline::silhouette(view, &data.frame, &data.map, stride).into_raw();
            depth_picture(scene, view, &data.frame, stride, |i| asked[i] >= limit)
        })
        .collect()
}

/// The same for one view, where `asked` holds for a point of the raster, row-major.
#[must_use]
pub fn depth_picture(
    scene: &FrozenScene,
    view: &TrainView,
    frame: &Frame,
    stride: u32,
    asked: impl Fn(usize) -> bool,
) -> DepthPicture {
    let world_from_camera = view.world_from_camera(frame);
    let width = view.width().div_ceil(stride);
    let points = (width * view.height().div_ceil(stride)) as usize;
    let mut picture = DepthPicture {
        stride,
        width,
        distances: vec![f32::NAN; points],
    };
    let (rays, at): (Vec<Ray>, Vec<usize>) = (0..points)
        .filter(|&i| asked(i))
        .filter_map(|i| Some((view.ray(&world_from_camera, picture.pixel(i))?, i)))
        .unzip();
    for (i, distance) in at.into_iter().zip(scene.median_distances(&rays)) {
        picture.distances[i] = distance;
    }
    picture
}
