//! Giving FoCoR a shape and colours before it is drawn for the first time.

use burn::Tensor;
use burn::optim::GradientsParams;
use burn::tensor::Device;
use glam::Vec3;
use losses::eikonal_loss;
use rand::{Rng, RngExt};
use scene_decomp::SurfaceSamples;
use scene_decomp::probability::ProbabilityMap;
use tensor_slices::matrix;

use super::super::Trainer;
use super::super::sampler::step_random;
use crate::config::Transparency;
use crate::prepare::Prepared;

/// Steps, and points of each.
const STEPS: u32 = 200;
const POINTS: usize = 8192;
/// How many of them lie near the surface, and are told colours.
const COLOURED: usize = POINTS / 2;
/// Points within this share of the truncation are told their distance, others only their side.
const NEAR: f32 = 0.9;
/// Weight of the colours beside the distances.
const COLOUR_WEIGHT: f32 = 0.1;
const EIKONAL_WEIGHT: f32 = 0.02;
/// `b` of an object just carved, where it is a density: about what schedules give a distance's.
const CARVED_B: f32 = 120.0;

/// The shape to start from.
pub struct Shape {
    /// Signed distance, `[resolution^3]`, cut off at `truncation`.
    pub distance: ProbabilityMap,
    /// The largest absolute value.
    pub truncation: f32,
    /// Cells with the surface in or next to them.
    pub near: Vec<u32>,
}

/// Points of one step with what is asked of them: first [`COLOURED`] near the surface, where there is one, then others.
struct Lesson {
    points: Vec<f32>,
    /// Unit directions from some camera, for the teacher's colours.
    directions: Vec<f32>,
    distances: Vec<f32>,
}

impl Trainer {
    /// Fits FoCoR's distance to `shape`, and its colours near the surface to BaCo's.
    pub(super) fn fit_object(&mut self, data: &Prepared, shape: &Shape) {
        let schedule = self.schedule();
        let teacher = self.freeze_background(schedule.background_levels);
        let device = self.context.device.clone();
        let config = self.context.config.schedule.clone();
        let cameras: Vec<Vec3> = data
            .views
            .iter()
            .map(|view| view.camera_centre(&data.frame))
            .collect();
        let near = NEAR * shape.truncation;
        let transparency = self.context.config.model.foreground;
        for step in 0..STEPS {
            let mut random = step_random(self.context.config.seed ^ 0x0f17_c0de, step);
            let lesson = lesson(shape, &cameras, &mut random);
            let (near_surface, elsewhere) = lesson.points.split_at(3 * COLOURED);
            let geometry = teacher.geometry(near_surface);
            let probability: Vec<f32> = near_surface
                .chunks_exact(3)
                .map(|p| self.map.at(Vec3::from_slice(p)))
                .collect();
            let colours = teacher.colour(&geometry, near_surface, &lesson.directions, &probability);
            let views: Vec<f32> = lesson
                .directions
                .iter()
                .map(|d| schedule.view_share * d)
                .collect();
            let op = self.scene.object.sdf_config(
                &self.context.object_layout,
                schedule.active_levels,
                Some(self.context.object_gradient.clone()),
            );
            let coloured = self
                .scene
                .object
                .sample(near_surface, &views, &[], op.clone());
            let others = rows(elsewhere, 3, &device);
            let samples = SurfaceSamples {
                geometry: Tensor::cat(
                    vec![coloured.geometry, self.scene.object.geometry(others, op)],
                    0,
                ),
                colour: coloured.colour,
            };
            let flags = |of: &dyn Fn(f32) -> bool| -> Tensor<2> {
                let values: Vec<f32> = lesson
                    .distances
                    .iter()
                    .map(|d| f32::from(u8::from(of(*d))))
                    .collect();
                rows(&values, 1, &device)
            };
            let targets: Vec<f32> = lesson
                .distances
                .iter()
                .map(|d| target(*d, transparency))
                .collect();
            let target = rows(&targets, 1, &device);
            let side: Vec<f32> = lesson.distances.iter().map(|d| d.signum()).collect();
            let close = flags(&|d| d.abs() < near);
            let far = flags(&|d| d.abs() >= near);
            let sdf = match transparency {
                Transparency::Sdf => samples.sdf(),
                Transparency::Density => samples.sdf().div_scalar(CARVED_B),
            };
            // Far from the surface only the side is known, and that the distance is no smaller.
            let short = (target.clone() - sdf.clone()).mul(rows(&side, 1, &device));
            let distance = (sdf - target).abs().mul(close) + short.clamp_min(0.0).mul(far);
            let surface = flags(&|d| d.abs() < 0.25 * shape.truncation);
            let seen = samples.colour.clone().slice([0..COLOURED, 0..3]);
            let colour = (seen - rows(&colours, 3, &device))
                .powf_scalar(2.0)
                .mean_dim(1)
                .mul(surface.slice([0..COLOURED, 0..1]));
            let colour = colour.sum().div_scalar(POINTS as f32);
            let mut loss = distance.mean() + colour.mul_scalar(COLOUR_WEIGHT);
            if transparency == Transparency::Sdf {
                loss = loss + eikonal_loss(samples.normal(), None).mul_scalar(EIKONAL_WEIGHT);
            }
            let mut grads = loss.backward();
            let fields = GradientsParams::from_module(&mut grads, &self.scene);
            drop(grads);
            let rate = 1.0 - 0.9 * step as f32 / STEPS as f32;
            self.scene = self.optimiser.step(
                f64::from(config.learning_rate_mlp * rate),
                self.scene.clone(),
                fields,
            );
            self.object_adam.step_grid(
                &mut self.scene.object.grid,
                &self.context.object_gradient,
                f64::from(config.learning_rate * rate),
            );
        }
    }
}

/// What FoCoR's first output is asked to be at a signed distance.
///
/// A density gets the one that NeuS's opacity has for rays that meet the surface head on (Wang et al.
/// 2021, eq. 10): `rho(d) = b Phi_b(-d)`, so that a run begins with the same pictures whichever the
/// object is. Its first output is `-ln rho`; divided by `b` it is a distance outside, and errors weigh
/// as much as those of distances do.
fn target(distance: f32, transparency: Transparency) -> f32 {
    match transparency {
        Transparency::Sdf => distance,
        Transparency::Density => {
            let x = CARVED_B * distance;
            let softplus = x.max(0.0) + (-x.abs()).exp().ln_1p();
            (softplus - CARVED_B.ln()) / CARVED_B
        }
    }
}

/// Half of the points lie near the surface, half anywhere in the box; directions are those of the first half.
fn lesson(shape: &Shape, cameras: &[Vec3], random: &mut impl Rng) -> Lesson {
    let mut out = Lesson {
        points: Vec::with_capacity(3 * POINTS),
        directions: Vec::with_capacity(3 * COLOURED),
        distances: Vec::with_capacity(POINTS),
    };
    let n = shape.distance.resolution();
    for i in 0..POINTS {
        let mut unit = || Vec3::new(random.random(), random.random(), random.random());
        let point = if i < COLOURED && !shape.near.is_empty() {
            let jitter = (unit() - 0.5) * 4.0 / n as f32;
            let cell = shape.near[random.random_range(0..shape.near.len())] as usize;
            (ProbabilityMap::centre(n, cell) + jitter).clamp(Vec3::NEG_ONE, Vec3::ONE)
        } else {
            unit() * 2.0 - 1.0
        };
        out.points.extend(point.to_array());
        out.distances.push(shape.distance.at(point));
        if i < COLOURED {
            let camera = cameras[random.random_range(0..cameras.len())];
            out.directions
                .extend((point - camera).normalize_or(Vec3::Z).to_array());
        }
    }
    out
}

fn rows(values: &[f32], columns: usize, device: &Device) -> Tensor<2> {
    matrix(values.to_vec(), [values.len() / columns, columns], device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_density_begins_as_opaque_as_the_surface() {
        // Straight through a wall: NeuS lets Phi_b(d) of the light through, up to distance d.
        let through = |d: f32| 1.0 / (1.0 + (-CARVED_B * d).exp());
        let step = 1e-4;
        let mut depth = 0.0;
        for k in -400..200 {
            let d = -(k as f32 + 0.5) * step;
            let raw = CARVED_B * target(d, Transparency::Density);
            depth += scene_decomp::colour_field::density_of(raw) * step;
            let left = (-depth).exp();
            let expected = through(d - 0.5 * step) / through(400.0 * step);
            assert!((left - expected).abs() < 2e-3, "{d}: {left} {expected}");
        }
        assert!(depth > 2.0);
        assert_eq!(target(-0.3, Transparency::Sdf), -0.3);
    }
}
