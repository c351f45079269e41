//! One training step: samples, both fields, compositing, losses, gradients.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::{Device, TensorData};
use glam::Vec3;
use hashgrid::{GridLayout, SparseGrad};
use losses::{
    ColourLoss, PointPenalty, SparsityForm, background_loss, eikonal_loss, mask_loss, point_loss,
    sparsity_loss,
};
use neus_render::composite::{self, CompositeConfig, Packing, column, composite};
use rand::RngExt;
use scene_decomp::{Scene, Sharpness, SurfaceSamples};

use super::batch::{FieldSamples, MarchedBatch};
use super::blend::blend;
use super::distortion::Spread;
use super::sampler::{RayBatch, step_random};
use super::visible::composite_config;
use crate::config::{self, Blend, TrainConfig, Transparency};
use crate::prepare::Label;

/// Points of the box that the sparsity loss looks at in each step.
const SPARSITY_POINTS: usize = 512;
/// Sparse points that each step asks for.
const SURFACE_POINTS: usize = 256;

/// Bounds of the logarithm of a density: of air, and of a wall in any step.
const LEAST_LOG_DENSITY: f32 = -15.0;
const MOST_LOG_DENSITY: f32 = 12.0;

/// The density that BaCo's first output stands for when it is read as one.
#[must_use]
pub fn density_of(raw: f32) -> f32 {
    (-raw).clamp(LEAST_LOG_DENSITY, MOST_LOG_DENSITY).exp()
}

/// [`density_of`] for a tensor.
fn densities_of(raw: Tensor<2>) -> Tensor<2> {
    raw.neg().clamp(LEAST_LOG_DENSITY, MOST_LOG_DENSITY).exp()
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
    /// Sparse points of the object, in the normalised frame.
    pub points: Vec<Vec3>,
}

/// What changes from step to step by schedule.
#[derive(Clone, Copy, Debug)]
pub struct StepSchedule {
    /// The step's number.
    pub step: u32,
    /// FoCoR's levels in use.
    pub active_levels: usize,
    /// BaCo's: all of them when it is a density, which needs no help to settle.
    pub background_levels: usize,
    /// NeuS's cosine annealing, 0 to 1.
    pub cos_anneal: f32,
    /// Factor on the view directions that colours depend on.
    pub view_share: f32,
    /// Weight of the mask loss.
    pub mask_weight: f32,
    /// Weight of light that comes from far away.
    pub far_weight: f32,
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
    /// Sparse points.
    pub points: f32,
    /// Distortion.
    pub distortion: f32,
    /// Light from far away.
    pub far: f32,
    /// What hides the object.
    pub hidden: f32,
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

/// What is known about a batch's rays from looking ahead and back.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// Of the samples, unless neither the distortion loss nor the price of distance is wanted.
    pub spread: Option<&'a Spread>,
    /// How far each ray's mask can be relied on in detail, 0 to 1, `[rays]`; none where it is empty.
    pub mask_trust: &'a [f32],
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
    known: Known<'_>,
    schedule: StepSchedule,
) -> Option<(Tensor<1>, StepLosses)> {
    if marched.object.is_empty() && marched.background.is_empty() {
        return None;
    }
    let config = &context.config;
    let weights = &config.loss;
    let device = &context.device;
    let (object_samples, object) = object_columns(context, scene, &marched.object, schedule);
    let (background_samples, background) =
        background_columns(context, scene, &marched.background, schedule);
    let n_rays = batch.rays.len();
    let packing = Arc::new(marched.packing.clone());
    let compositing = composite_config(config, schedule.cos_anneal);
    let spread = known.spread.map(|spread| {
        spread_pixels(
            object.clone(),
            background.clone(),
            sharpness.b(),
            packing.clone(),
            compositing,
            spread,
        )
    });
    let pixels = blend(
        object,
        background,
        sharpness.b(),
        packing,
        compositing,
        &config.model,
    );
    let photo = constant(&batch.colours, 3, device);
    let joint = pixels.colour;
    let first = column::BACKGROUND_COLOUR;
    let alone = pixels.rendered.clone().slice([0..n_rays, first..first + 3]);
    let first = column::OBJECT_OPACITY;
    let opacity = pixels.rendered.slice([0..n_rays, first..first + 1]);
    let matte = pixels.matte.reshape([n_rays]);

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
            matte.clone(),
            hidden,
            list(targets, device),
            Some(list(trust, device)),
        );
        add(part, schedule.mask_weight, &mut losses.mask);
    }
    let mask_trust = known.mask_trust;
    if weights.mask_trusted > 0.0 && mask_trust.iter().any(|trust| *trust > 0.0) {
        let (targets, trust) = batch
            .votes
            .iter()
            .zip(mask_trust)
            .map(|(vote, trust)| {
                vote.map_or((0.0, 0.0), |vote| {
                    (f32::from(u8::from(vote.object)), *trust)
                })
            })
            .unzip();
        let hidden = matte.clone().neg().add_scalar(1.001).log();
        let part = mask_loss(
            matte.clone(),
            hidden,
            list(targets, device),
            Some(list(trust, device)),
        );
        add(part, weights.mask_trusted, &mut losses.mask);
    }
    if weights.hidden > 0.0 && config.model.blend == Blend::Sample {
        // Where the mask says that the object is to be seen, nothing hides it: floaters near a
        // camera, made up for a highlight.
        let visible = batch
            .votes
            .iter()
            .map(|v| v.map_or(0.0, |v| f32::from(u8::from(v.object && v.weight == 1.0))));
        let opacity = opacity.reshape([n_rays]).detach();
        let part = (opacity - matte.clone())
            .clamp_min(0.0)
            .mul(list(visible.collect(), device))
            .mean();
        add(part, weights.hidden, &mut losses.hidden);
    }
    if let Some([spread, far]) = spread {
        add(spread.mean(), weights.distortion, &mut losses.distortion);
        add(far.mean(), schedule.far_weight, &mut losses.far);
    }
    if let Some(samples) = &object_samples {
        add(
            eikonal_loss(samples.normal(), None),
            weights.eikonal,
            &mut losses.eikonal,
        );
    }
    if weights.sparsity > 0.0 && !marched.object.is_empty() {
        let points = unseen_points(config.seed, schedule.step);
        let sdf = object_sdf(context, scene, schedule, &points);
        let part = sparsity_loss(sdf, weights.sparsity_tau, SparsityForm::Plain, None);
        add(part, weights.sparsity, &mut losses.sparsity);
    }
    if weights.points > 0.0 && !marched.object.is_empty() && !context.points.is_empty() {
        let mut random = step_random(context.config.seed ^ 0x0901_4720, schedule.step);
        let chosen: Vec<f32> = (0..SURFACE_POINTS)
            .flat_map(|_| context.points[random.random_range(0..context.points.len())].to_array())
            .collect();
        let sdf = object_sdf(context, scene, schedule, &chosen);
        let part = point_loss(sdf, PointPenalty::L1, None);
        add(part, weights.points, &mut losses.points);
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

/// Of each ray the distortion loss, up to terms without gradient, and how far its light comes from;
/// each `[rays, 1]`.
fn spread_pixels(
    object: Tensor<2>,
    background: Tensor<2>,
    sharpness: Tensor<1>,
    packing: Arc<Packing>,
    compositing: CompositeConfig,
    spread: &Spread,
) -> [Tensor<2>; 2] {
    let painted = |samples: Tensor<2>, spread: &[f32], far: &[f32], colour: usize| {
        let [m, columns] = samples.dims();
        let device = samples.device();
        let mut parts = vec![
            samples.clone().slice([0..m, 0..colour]),
            constant(spread, 1, &device),
            constant(far, 1, &device),
            Tensor::zeros([m, 1], &device),
        ];
        if columns > colour + 3 {
            parts.push(Tensor::ones([m, columns - colour - 3], &device));
        }
        Tensor::cat(parts, 1)
    };
    let rays = packing.ray_count();
    let pixels = composite(
        painted(
            object,
            &spread.object,
            &vec![0.0; spread.object.len()],
            composite::object_column::COLOUR,
        ),
        painted(
            background,
            &spread.background,
            &spread.far,
            composite::background_column::COLOUR,
        ),
        sharpness,
        packing,
        compositing,
    );
    [column::JOINT_COLOUR, column::JOINT_COLOUR + 1]
        .map(|of| pixels.clone().slice([0..rays, of..of + 1]))
}

/// Random points of the box, `[SPARSITY_POINTS * 3]`: mostly where no ray ever looks.
///
/// Samples of rays will not do: those that light reaches lie before the surface, and keeping them
/// off it would wear the object away.
fn unseen_points(seed: u64, step: u32) -> Vec<f32> {
    let mut random = step_random(seed ^ 0x05ba_25e0, step);
    (0..3 * SPARSITY_POINTS)
        .map(|_| random.random_range(-1.0..1.0))
        .collect()
}

/// FoCoR's distance at `points` `[n * 3]`, `[n]`.
fn object_sdf(
    context: &StepContext,
    scene: &Scene,
    schedule: StepSchedule,
    points: &[f32],
) -> Tensor<1> {
    let geometry = scene.object.geometry(
        constant(points, 3, &context.device),
        scene.object.sdf_config(
            &context.object_layout,
            schedule.active_levels,
            Some(context.object_gradient.clone()),
        ),
    );
    let n = points.len() / 3;
    geometry.slice([0..n, 0..1]).reshape([n])
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
    let directions = constant(&at.directions, 3, device);
    let views: Vec<f32> = at
        .directions
        .iter()
        .map(|d| schedule.view_share * d)
        .collect();
    let samples = scene.object.sample(
        &at.points,
        &views,
        &[],
        scene.object.sdf_config(
            &context.object_layout,
            schedule.active_levels,
            Some(context.object_gradient.clone()),
        ),
    );
    let colour = samples.colour.clone();
    // The colour network's outputs are colour and alpha head, in the op's order.
    let columns = Tensor::cat(vec![samples.sdf(), slope(&samples, &directions), colour], 1);
    (Some(samples), columns)
}

/// BaCo's samples and its columns for compositing, `[m, 5]`.
fn background_columns(
    context: &StepContext,
    scene: &Scene,
    at: &FieldSamples,
    schedule: StepSchedule,
) -> (Option<SurfaceSamples>, Tensor<2>) {
    let device = &context.device;
    if at.is_empty() {
        return (
            None,
            Tensor::zeros([0, composite::background_column::COUNT], device),
        );
    }
    let directions = constant(&at.directions, 3, device);
    let samples = scene.background.sample(
        &at.points,
        &at.directions,
        &at.probability,
        scene.background.sdf_config(
            &context.background_layout,
            schedule.background_levels,
            Some(context.background_gradient.clone()),
        ),
    );
    let columns = match context.config.model.background {
        Transparency::Sdf => vec![
            samples.sdf(),
            slope(&samples, &directions),
            samples.colour.clone(),
        ],
        Transparency::Density => {
            let density = densities_of(samples.sdf());
            let density = if at.stretch.is_empty() {
                density
            } else {
                density.mul(constant(&at.stretch, 1, device))
            };
            let slope = Tensor::zeros([at.len(), 1], device);
            vec![density, slope, samples.colour.clone()]
        }
    };
    (Some(samples), Tensor::cat(columns, 1))
}
