//! A training step at the paper's sizes, sample for sample what `torch_step.py` does.
//!
//! Rays from a sphere around the box, evenly spaced samples, both fields asked at each: nothing is
//! skipped, so that a sample here is as much work as a sample there. Everything after that is the
//! trainer's own step: both fields forward and backward, compositing, losses, both optimisers.

use anyhow::Result;
use demo_scene::DemoConfig;
use glam::Vec3;
use neus_render::composite::Packing;
use neus_render::rays::Ray;
use rand::{Rng, RngExt};
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::{Label, Vote};
use sos_train::train::Trainer;
use sos_train::train::batch::{FieldSamples, MarchedBatch};
use sos_train::train::sampler::{RayBatch, step_random};
use sos_train::train::step::StepSchedule;

use crate::phases::Marks;
use crate::scene::prepared;
use crate::steps::StepFigures;

/// Sizes of the comparison.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sizes {
    pub(crate) rays: usize,
    pub(crate) samples: usize,
    pub(crate) steps: usize,
}

/// Steps before the measurement.
const WARM_UP: usize = 3;

/// Measures `sizes.steps` steps of the paper preset; a sample is one point asked of both fields.
pub(crate) fn measure(sizes: Sizes, device: &str) -> Result<StepFigures> {
    let mut config = TrainConfig::preset(Preset::Paper);
    config.device = device.to_owned();
    let data = prepared(&DemoConfig::tiny(), &config)?;
    let mut trainer = Trainer::new(&config, &data)?;
    let levels = config.model.levels as usize;
    // Made beforehand: a device's steps are timed by the clock, whatever else the host does.
    let batches: Vec<_> = (0..WARM_UP + sizes.steps)
        .map(|number| {
            let mut random = step_random(7, number as u32);
            let batch = ray_batch(sizes.rays, &mut random);
            let marched = samples(&batch.rays, sizes.samples, &mut random);
            (batch, marched)
        })
        .collect();
    let mut marks = Marks::begin(&trainer);
    for (number, (batch, marched)) in batches.iter().enumerate() {
        if number == WARM_UP {
            trainer.settle();
            marks = Marks::begin(&trainer);
        }
        let schedule = StepSchedule {
            step: number as u32,
            active_levels: levels,
            background_levels: levels,
            cos_anneal: 1.0,
            view_share: 1.0,
            mask_weight: config.loss.mask,
            far_weight: 0.0,
            sight_weight: 0.0,
        };
        let report = trainer.learn(batch, marched, None, &[], schedule);
        anyhow::ensure!(report.is_finite(), "a loss of step {number} is no number");
        if number + 1 == WARM_UP + sizes.steps {
            // What a device has been given to do counts when it is done.
            trainer.settle();
        }
        marks.step_done(sizes.rays * sizes.samples);
    }
    Ok(marks.figures(&trainer))
}

/// A point of the unit sphere.
fn direction(random: &mut impl Rng) -> Vec3 {
    loop {
        let p = Vec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if let Some(unit) = p.try_normalize().filter(|_| p.length_squared() <= 1.0) {
            return unit;
        }
    }
}

fn ray_batch(count: usize, random: &mut impl Rng) -> RayBatch {
    let mut batch = RayBatch::default();
    while batch.rays.len() < count {
        let origin = 1.5 * direction(random);
        let spread = Vec3::from_array(std::array::from_fn(|_| random.random_range(-0.5..0.5)));
        let Some(ray) = Ray::new(origin, spread - origin) else {
            continue;
        };
        batch.rays.push(ray);
        batch.colours.extend((0..3).map(|_| random.random::<f32>()));
        let inside = random.random::<bool>();
        batch.labels.push(if inside {
            Label::Object
        } else {
            Label::Background
        });
        batch.votes.push(Some(Vote {
            object: inside,
            weight: 1.0,
        }));
    }
    batch
}

/// `count` samples on each ray, of both fields.
fn samples(rays: &[Ray], count: usize, random: &mut impl Rng) -> MarchedBatch {
    let n = rays.len() * count;
    let step = 2.0 / count as f32;
    let mut object = FieldSamples::default();
    let mut t = Vec::with_capacity(n);
    for (number, ray) in rays.iter().enumerate() {
        for k in 0..count {
            let distance = 0.5 + (k as f32 + 0.5) * step;
            let point = ray.at(distance).clamp(Vec3::NEG_ONE, Vec3::ONE);
            t.push(distance);
            object.points.extend(point.to_array());
            object.directions.extend(ray.direction.to_array());
            object.ray.push(number as u32);
        }
    }
    let mut background = object.clone();
    background.probability = (0..n).map(|_| random.random()).collect();
    let offsets = (0..=rays.len()).map(|i| (i * count) as u32).collect();
    let all: Vec<u32> = (0..n as u32).collect();
    MarchedBatch {
        packing: Packing::new(offsets, t, vec![step; n], all.clone(), all),
        object,
        background,
    }
}
