//! One training step: samples, both fields, compositing, losses, gradients.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::{Device, TensorData};
use hashgrid::{GridLayout, SparseGrad};
use losses::{ColourLoss, SparsityForm, background_loss, eikonal_loss, mask_loss, sparsity_loss};
use neus_render::composite::{self, CompositeConfig, column, composite};
use scene_decomp::{Scene, Sharpness, SurfaceSamples};

use super::batch::{FieldSamples, MarchedBatch};
use super::sampler::RayBatch;
use crate::config::{self, AlphaSource, TrainConfig, Transparency};
use crate::prepare::Label;

/// The density that BaCo's first output stands for when it is read as one.
#[must_use]
pub fn density_of(raw: f32) -> f32 {
    (-raw).clamp(-15.0, 12.0).exp()
}

/// What is fixed over a run.
#[derive(Clone, Debug)]
pub struct StepContext {
    /// The run's settings.
    pub config: TrainConfig,
    /// FoCoR's grid levels.
    pub object_layout: Arc<GridLayout>,
    /// BaCo's grid levels.
    pub background_layout: Arc<GridLayout>,
    /// Where FoCoR's table gradient goes.
    pub object_gradient: SparseGrad,
    /// Where BaCo's table gradient goes.
    pub background_gradient: SparseGrad,
    /// The autodiff device.
    pub device: Device,
}

/// What changes from step to step by schedule.
#[derive(Clone, Copy, Debug)]
pub struct StepSchedule {
    /// Levels in use.
    pub active_levels: usize,
    /// NeuS's cosine annealing, 0 to 1.
    pub cos_anneal: f32,
    /// Weight of the mask loss.
    pub mask_weight: f32,
    /// Share of the joint colour's gradient that reaches BaCo at pixels that may show the object.
    pub background_gate: f32,
}

/// The losses of a step, as numbers.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct StepLosses {
    /// The sum that is differentiated.
    pub total: f32,
    /// Joint colour.
    pub colour: f32,
    /// BaCo alone, outside the object.
    pub background: f32,
    /// Eikonal, both fields.
    pub eikonal: f32,
    /// Sparsity.
    pub sparsity: f32,
    /// Mask.
    pub mask: f32,
    /// Mean squared error of the joint colour.
    pub mse: f32,
}

/// Rows of a list as a tensor without gradient.
fn constant(values: &[f32], columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len().checked_div(columns).unwrap_or(0);
    Tensor::from_data(TensorData::new(values.to_vec(), [rows, columns]), device)
}

/// A list as a tensor without gradient.
fn list(values: Vec<f32>, device: &Device) -> Tensor<1> {
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}

/// `normal . direction`, `[m, 1]`.
fn slope(samples: &SurfaceSamples, directions: &Tensor<2>) -> Tensor<2> {
    samples.normal().mul(directions.clone()).sum_dim(1)
}

/// The loss of a batch, ready for `backward`, with its parts.
///
/// Returns `None` when no ray has a sample.
#[must_use]
pub fn loss(
    context: &StepContext,
    scene: &Scene,
    sharpness: &Sharpness,
    batch: &RayBatch,
    marched: &MarchedBatch,
    schedule: StepSchedule,
) -> Option<(Tensor<1>, StepLosses)> {
    if marched.object.is_empty() && marched.background.is_empty() {
        return None;
    }
    let config = &context.config;
    let weights = &config.loss;
    let device = &context.device;
    let (object_samples, object) = object_columns(context, scene, &marched.object, schedule);
    // Where a pixel may show the object, the background is drawn but not taught, unless the gate
    // says otherwise: it could learn the object.
    let first_gated = batch
        .labels
        .partition_point(|label| *label == Label::Background) as u32;
    let taught = marched
        .background
        .ray
        .partition_point(|ray| *ray < first_gated);
    let (background_samples, background) =
        background_columns(context, scene, &marched.background, taught, schedule);
    let n_rays = batch.rays.len();
    let rendered = composite(
        object,
        background,
        sharpness.b(),
        Arc::new(marched.packing.clone()),
        CompositeConfig {
            background: match config.model.background {
                Transparency::Sdf => composite::Transparency::Sdf,
                Transparency::Density => composite::Transparency::Density,
            },
            cos_anneal: schedule.cos_anneal,
            ..CompositeConfig::default()
        },
    );
    let columns =
        |first: usize, count: usize| rendered.clone().slice([0..n_rays, first..first + count]);
    let photo = constant(&batch.colours, 3, device);
    let joint = columns(column::JOINT_COLOUR, 3);
    let alone = columns(column::BACKGROUND_COLOUR, 3);
    let matte = columns(column::MATTE, 1).reshape([n_rays]);

    let mut losses = StepLosses::default();
    let squared = (joint.clone() - photo.clone()).powf_scalar(2.0).mean();
    losses.mse = scalar(&squared);
    let kind = match weights.colour {
        config::ColourLoss::L2 => ColourLoss::L2,
        config::ColourLoss::L1 => ColourLoss::L1,
        config::ColourLoss::Huber => ColourLoss::Huber {
            delta: weights.huber_delta,
        },
    };
    let mut total = kind.loss(joint, photo.clone(), None);
    losses.colour = scalar(&total);
    let mut add = |part: Tensor<1>, weight: f32, value: &mut f32| {
        if weight > 0.0 {
            *value += scalar(&part);
            total = total.clone() + part.mul_scalar(weight);
        }
    };

    let outside = batch
        .labels
        .iter()
        .map(|l| f32::from(u8::from(*l == Label::Background)));
    let part = background_loss(kind, alone, photo, list(outside.collect(), device));
    add(part, weights.background, &mut losses.background);
    if schedule.mask_weight > 0.0 {
        let (targets, trust) = batch.labels.iter().map(|l| l.target()).unzip();
        // The visible share, not the object's own opacity: what stands before it hides it. The
        // offset keeps a gradient where the matte is 1 and should be 0.
        let hidden = matte.clone().neg().add_scalar(1.001).log();
        let part = mask_loss(
            matte,
            hidden,
            list(targets, device),
            Some(list(trust, device)),
        );
        add(part, schedule.mask_weight, &mut losses.mask);
    }
    if let Some(samples) = &object_samples {
        add(
            eikonal_loss(samples.normal(), None),
            weights.eikonal,
            &mut losses.eikonal,
        );
        let m = samples.sdf().dims()[0];
        let sdf = samples.sdf().reshape([m]);
        let part = sparsity_loss(sdf, weights.sparsity_tau, SparsityForm::Plain, None);
        add(part, weights.sparsity, &mut losses.sparsity);
    }
    if let (Some(samples), Transparency::Sdf) = (&background_samples, config.model.background) {
        let part = eikonal_loss(samples.normal(), None);
        add(part, weights.eikonal_background, &mut losses.eikonal);
    }
    losses.total = scalar(&total);
    Some((total, losses))
}

fn scalar(tensor: &Tensor<1>) -> f32 {
    tensor.clone().into_scalar::<f32>()
}

/// FoCoR's samples and its columns for compositing, `[m, 6]`.
fn object_columns(
    context: &StepContext,
    scene: &Scene,
    at: &FieldSamples,
    schedule: StepSchedule,
) -> (Option<SurfaceSamples>, Tensor<2>) {
    let device = &context.device;
    if at.is_empty() {
        return (
            None,
            Tensor::zeros([0, composite::object_column::COUNT], device),
        );
    }
    let m = at.len();
    let directions = constant(&at.directions, 3, device);
    let samples = scene.object.sample(
        constant(&at.points, 3, device),
        directions.clone(),
        Tensor::zeros([m, 0], device),
        scene.object.sdf_config(
            &context.object_layout,
            schedule.active_levels,
            Some(context.object_gradient.clone()),
        ),
    );
    let colour = samples.colour.clone();
    let matte = match context.config.model.alpha {
        AlphaSource::Opacity => Tensor::ones([m, 1], device),
        AlphaSource::Head | AlphaSource::Both => colour.clone().slice([0..m, 3..4]),
    };
    let columns = Tensor::cat(
        vec![
            samples.sdf(),
            slope(&samples, &directions),
            colour.slice([0..m, 0..3]),
            matte,
        ],
        1,
    );
    (Some(samples), columns)
}

/// BaCo's samples and its columns for compositing, `[m, 5]`. The first `taught` rows carry the whole
/// gradient, the others the gate's share of it.
fn background_columns(
    context: &StepContext,
    scene: &Scene,
    at: &FieldSamples,
    taught: usize,
    schedule: StepSchedule,
) -> (Option<SurfaceSamples>, Tensor<2>) {
    let gate = schedule.background_gate;
    let part = |from: usize, to: usize, gradient: bool| {
        if from >= to {
            return None;
        }
        let device = if gradient {
            context.device.clone()
        } else {
            context.device.clone().inner()
        };
        let directions = constant(&at.directions[3 * from..3 * to], 3, &device);
        let points = constant(&at.points[3 * from..3 * to], 3, &device);
        let probability = constant(&at.probability[from..to], 1, &device);
        let settings = scene.background.sdf_config(
            &context.background_layout,
            schedule.active_levels,
            Some(context.background_gradient.clone()),
        );
        let samples = if gradient {
            scene
                .background
                .sample(points, directions.clone(), probability, settings)
        } else {
            scene
                .background
                .sample_constant(points, directions.clone(), probability, settings)
        };
        let first = match context.config.model.background {
            Transparency::Sdf => samples.sdf(),
            Transparency::Density => samples.sdf().neg().clamp(-15.0, 12.0).exp(),
        };
        let slope = slope(&samples, &directions);
        let columns = Tensor::cat(vec![first, slope, samples.colour.clone()], 1);
        Some((samples, columns))
    };
    let m = at.len();
    let tracked = if gate > 0.0 { m } else { taught };
    let (samples, mut columns) = match part(0, tracked, true) {
        Some((samples, columns)) => (Some(samples), vec![columns]),
        None => (None, Vec::new()),
    };
    if gate > 0.0 && gate < 1.0 && taught < m {
        let all = columns.remove(0);
        let gated = all
            .clone()
            .slice([taught..m, 0..composite::background_column::COUNT]);
        let share = gated.clone().mul_scalar(gate) + gated.detach().mul_scalar(1.0 - gate);
        if taught > 0 {
            columns.push(all.slice([0..taught, 0..composite::background_column::COUNT]));
        }
        columns.push(share);
    }
    if let Some((_, constant)) = part(tracked, m, false) {
        columns.push(Tensor::from_inner(constant));
    }
    let columns = match columns.len() {
        0 => Tensor::zeros([0, composite::background_column::COUNT], &context.device),
        1 => columns.remove(0),
        _ => Tensor::cat(columns, 0),
    };
    (samples, columns)
}
