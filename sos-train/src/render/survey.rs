//! A coarse look at every view, to know which views saw what lies behind the object.

use glam::{Affine3A, Vec2, Vec3};
use image::RgbImage;
use neus_render::rays::Ray;

use super::rays::FrozenScene;
use crate::prepare::Prepared;

/// Pixels between the rays of the survey.
const STRIDE: u32 = 4;
/// How much further than the survey's depth a point may lie and still count as seen.
const DEPTH_TOLERANCE: f32 = 0.03;
/// A matte above this hides what is behind.
const HIDDEN: f32 = 0.2;
/// How far, as a root mean square over the channels, a photo's colour may be from the plate's where
/// it shows the same place: highlights move, but what looks quite different is something else.
const COLOUR_TOLERANCE: f32 = 0.12;

/// One view's matte and background depth on a coarse raster.
#[derive(Clone, Debug)]
struct CoarseView {
    world_from_camera: Affine3A,
    width: usize,
    height: usize,
    matte: Vec<f32>,
    /// Distance along the ray, normalised frame; 0 where nothing was met.
    distance: Vec<f32>,
}

/// What all views saw.
#[derive(Clone, Debug)]
pub struct Survey {
    views: Vec<CoarseView>,
}

impl Survey {
    /// Renders every view of `data` on a coarse raster.
    #[must_use]
    pub fn new(scene: &FrozenScene, data: &Prepared, mut done: impl FnMut()) -> Self {
        let views = data
            .views
            .iter()
            .map(|view| {
                let world_from_camera = view.world_from_camera(&data.frame);
                let width = view.width().div_ceil(STRIDE) as usize;
                let height = view.height().div_ceil(STRIDE) as usize;
                let (mut rays, mut cells) = (Vec::new(), Vec::new());
                for cell in 0..width * height {
                    let (x, y) = ((cell % width) as f32 + 0.5, (cell / width) as f32 + 0.5);
                    let pixel = Vec2::new(x, y) * STRIDE as f32;
                    if let Some(ray) = view.ray(&world_from_camera, pixel) {
                        rays.push(ray);
                        cells.push(cell);
                    }
                }
                let mut matte = vec![1.0; width * height];
                let mut distance = vec![0.0; width * height];
                for (cell, ray) in cells.into_iter().zip(scene.render(&rays)) {
                    matte[cell] = ray.matte;
                    distance[cell] = ray.background_distance;
                }
                done();
                CoarseView {
                    world_from_camera,
                    width,
                    height,
                    matte,
                    distance,
                }
            })
            .collect();
        Self { views }
    }

    /// How many views saw the point that `ray` meets at `distance`, with the object not before it, in
    /// about the `colour` that the plate gives it.
    #[must_use]
    pub fn seen(&self, data: &Prepared, ray: &Ray, distance: f32, colour: Vec3) -> u8 {
        if distance <= 0.0 {
            return 0;
        }
        let point = ray.at(distance);
        let world = data.frame.world_from_normalised(point);
        let count = data
            .views
            .iter()
            .zip(&self.views)
            .filter(|(view, coarse)| {
                view.project(world).is_some_and(|(pixel, _)| {
                    coarse.shows(point, pixel) && agrees(&view.photo, pixel, colour)
                })
            })
            .count();
        count.min(255) as u8
    }
}

/// Whether a photo has this colour at a pixel or next to it.
fn agrees(photo: &RgbImage, pixel: Vec2, colour: Vec3) -> bool {
    let (x, y) = (pixel.x as u32, pixel.y as u32);
    (y.saturating_sub(1)..(y + 2).min(photo.height())).any(|y| {
        (x.saturating_sub(1)..(x + 2).min(photo.width())).any(|x| {
            let there = Vec3::from(photo.get_pixel(x, y).0.map(f32::from)) / 255.0;
            there.distance_squared(colour) <= 3.0 * COLOUR_TOLERANCE * COLOUR_TOLERANCE
        })
    })
}

impl CoarseView {
    fn shows(&self, point: Vec3, pixel: Vec2) -> bool {
        let x = ((pixel.x / STRIDE as f32) as usize).min(self.width - 1);
        let y = ((pixel.y / STRIDE as f32) as usize).min(self.height - 1);
        let away = point.distance(self.world_from_camera.translation.into());
        // The neighbourhood's median depth: single rays slip through a porous surface.
        let mut depths = Vec::with_capacity(9);
        let mut hidden = false;
        for y in y.saturating_sub(1)..(y + 2).min(self.height) {
            for x in x.saturating_sub(1)..(x + 2).min(self.width) {
                depths.push(self.distance[y * self.width + x]);
                // So close to the outline the raster can't tell which side.
                hidden |= self.matte[y * self.width + x] > HIDDEN;
            }
        }
        depths.sort_by(f32::total_cmp);
        let depth = depths[depths.len() / 2];
        !hidden && away <= depth * (1.0 + DEPTH_TOLERANCE)
    }
}
