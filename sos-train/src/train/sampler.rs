//! Which pixels a step looks at.

use glam::{Affine3A, Vec2};
use neus_render::rays::Ray;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::prepare::{Label, Prepared};

/// Rays of one step with what is known about their pixels; all lists `[rays]`.
#[derive(Clone, Debug, Default)]
pub struct RayBatch {
    /// In the normalised frame.
    pub rays: Vec<Ray>,
    /// The photo's colour in `[0, 1]`, `[rays * 3]`.
    pub colours: Vec<f32>,
    /// What the pixel is taken for.
    pub labels: Vec<Label>,
}

/// Draws rays; the same seed and step give the same batch.
#[derive(Debug)]
pub struct Sampler {
    seed: u64,
    object_share: f32,
    poses: Vec<Affine3A>,
    /// Views in which the object can be seen.
    with_object: Vec<usize>,
}

impl Sampler {
    /// For the views of `scene`; `object_share` of the rays go where the object can be.
    #[must_use]
    pub fn new(scene: &Prepared, seed: u64, object_share: f32) -> Self {
        Self {
            seed,
            object_share,
            poses: scene.views.iter().map(|v| v.world_from_camera(&scene.frame)).collect(),
            with_object: (0..scene.views.len())
                .filter(|&i| !scene.outlines[i].candidates.is_empty())
                .collect(),
        }
    }

    /// The batch of `step`.
    #[must_use]
    pub fn draw(&self, scene: &Prepared, step: u32, rays: usize) -> RayBatch {
        let mut random = step_random(self.seed, step);
        let mut batch = RayBatch::default();
        for _ in 0..rays {
            let (view, x, y) = self.pixel(scene, &mut random);
            let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            // A pixel that a lens can't unproject (its far corner, say) teaches nothing.
            let Some(ray) = scene.views[view].ray(&self.poses[view], pixel) else { continue };
            let colour = scene.views[view].photo.get_pixel(x, y).0;
            batch.rays.push(ray);
            batch.colours.extend(colour.map(|c| f32::from(c) / 255.0));
            batch.labels.push(scene.outlines[view].label(x, y));
        }
        batch
    }

    fn pixel(&self, scene: &Prepared, random: &mut impl Rng) -> (usize, u32, u32) {
        if !self.with_object.is_empty() && random.random::<f32>() < self.object_share {
            let view = self.with_object[random.random_range(0..self.with_object.len())];
            let candidates = &scene.outlines[view].candidates;
            let pixel = candidates[random.random_range(0..candidates.len())];
            let width = scene.views[view].width();
            return (view, pixel % width, pixel / width);
        }
        let view = random.random_range(0..scene.views.len());
        let photo = &scene.views[view].photo;
        (view, random.random_range(0..photo.width()), random.random_range(0..photo.height()))
    }
}

/// Random numbers of one step: a stream of its own, so that a run resumes without stored state.
#[must_use]
pub fn step_random(seed: u64, step: u32) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed ^ u64::from(step).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}
