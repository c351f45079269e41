//! Where a photo's colours change, and what the fields have there.

use glam::Vec2;
use neus_render::rays::Ray;
use rand::RngExt;

use super::alignment::{Landmark, look};
use crate::prepare::spans::PixelSpans;
use crate::prepare::{Frame, TrainView};
use crate::render::rays::{FrozenScene, RenderedRay};
use crate::train::sampler::step_random;

/// Pixels that are tried, and those of them that are kept, where colours change the most.
const TRIES: usize = 6000;
const KEPT: usize = 1200;
/// Mattes in between are of pixels that show two places.
const MIXED: std::ops::Range<f32> = 0.15..0.85;

/// A view of the size that it is aligned at.
pub(super) struct Reduced<'a> {
    pub(super) view: &'a TrainView,
    /// Pixels of the photo that is trained on along one of its pixels.
    pub(super) factor: u32,
    /// Where the object can be, in the photo that is trained on, which is as wide as this.
    pub(super) candidates: &'a PixelSpans,
    pub(super) width: u32,
}

/// Landmarks of a view, half of them where the object can be; the same `seed` and `step` give the same.
pub(super) fn landmarks(
    scene: &FrozenScene,
    frame: &Frame,
    reduced: &Reduced<'_>,
    seed: u64,
    step: u32,
) -> Vec<Landmark> {
    let Reduced {
        view,
        factor,
        candidates,
        width,
    } = *reduced;
    let mut random = step_random(seed, step);
    let (last_x, last_y) = (view.width() - 1, view.height() - 1);
    let mut draw = |i: usize| {
        if i.is_multiple_of(2) && !candidates.is_empty() {
            let pixel = candidates.nth(random.random_range(0..candidates.len()));
            let (x, y) = (pixel % width / factor, pixel / width / factor);
            (x.min(last_x), y.min(last_y))
        } else {
            (
                random.random_range(0..=last_x),
                random.random_range(0..=last_y),
            )
        }
    };
    let mut pixels: Vec<(f32, Vec2)> = (0..TRIES)
        .filter_map(|i| {
            let (x, y) = draw(i);
            let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let (_, [by_x, by_y]) = look(&view.photo, centre)?;
            let change = by_x.length_squared() + by_y.length_squared();
            (!view.ignores(x, y)).then_some((change, centre))
        })
        .collect();
    pixels.sort_by(|a, b| b.0.total_cmp(&a.0));
    pixels.truncate(KEPT);
    let world_from_camera = view.world_from_camera(frame);
    let camera_from_world = world_from_camera.inverse();
    let rays: Vec<_> = pixels
        .iter()
        .filter_map(|(_, pixel)| view.ray(&world_from_camera, *pixel))
        .collect();
    let met = scene.render(&rays);
    let landmark = |(ray, met): (&Ray, RenderedRay)| {
        let distance = match met.matte {
            matte if MIXED.contains(&matte) => 0.0,
            matte if matte > 0.5 => met.object_distance,
            _ => met.background_distance,
        };
        (distance > 0.0).then(|| Landmark {
            place: camera_from_world
                .transform_point3(ray.at(distance))
                .as_dvec3(),
            colour: met.joint,
        })
    };
    rays.iter().zip(met).filter_map(landmark).collect()
}
