//! One training step: samples, both fields, compositing, losses, gradients.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::Device;
use glam::Vec3;
use hashgrid::{GridLayout, SparseGrad};
use losses::{ColourLoss, RowLoss, RowTerm, mean_weights, row_losses};
use neus_render::composite::{self, column};
use scene_decomp::colour_field::{Reading, RowConfig};
use scene_decomp::sdf_field::SdfFieldConfig;
use scene_decomp::{Scene, Sharpness};
use tensor_slices::matrix;

use super::batch::{FieldSamples, MarchedBatch};
use super::blend::{Blended, blend};
use super::distortion::Spread;
use super::ledger::{Entry, Ledger};
use super::pixel_losses::PixelLosses;
use super::sampler::RayBatch;
use super::semantic;
use super::shape_losses::Shape;
use super::total::{Total, Weighed};
use super::visible::composite_config;
use crate::config::{self, AlphaSource, Blend, Fields, ModelConfig, TrainConfig, Transparency};
use crate::prepare::{Label, Shown};

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
    /// Sparse points that m^P gives to the object, in the normalised frame.
    pub points: Vec<Vec3>,
}

/// What changes from step to step by schedule.
#[derive(Clone, Copy, Debug)]
pub struct StepSchedule {
    /// The step's number.
    pub step: u32,
    /// FoCoR's levels in use: all of them when it is a density, which needs no help to settle.
    pub active_levels: usize,
    /// BaCo's, likewise.
    pub background_levels: usize,
    /// NeuS's cosine annealing, 0 to 1.
    pub cos_anneal: f32,
    /// Factor on the view directions that colours depend on.
    pub view_share: f32,
    /// Weight of the mask loss.
    pub mask_weight: f32,
    /// Weight of light that comes from far away.
    pub far_weight: f32,
    /// Weight of light from elsewhere than where rays are known to end.
    pub sight_weight: f32,
}

/// Rows of a list as a tensor without gradient.
pub(super) fn constant(values: &[f32], columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len().checked_div(columns).unwrap_or(0);
    matrix(values.to_vec(), [rows, columns], device)
}

/// What is known about a batch's rays from looking ahead and back.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// Of the samples, unless nothing that has a price by where it comes from is wanted.
    pub spread: Option<&'a Spread>,
    /// The share of each ray's light that BaCo sends from inside the box, `[rays]`; none where it is empty.
    pub box_background: &'a [f32],
    /// How far each ray's mask can be relied on in detail, 0 to 1, `[rays]`; none where it is empty.
    pub mask_trust: &'a [f32],
}

/// How much a pixel whose mask shows the object counts where something hides it. Floaters, made up for
/// highlights, stand just before cameras; what BaCo keeps inside the box is what m^P gives to it, by the votes of all views. If
/// most of a pixel's light comes from there, its mask is wrong: a table is not to be pierced for what might be below it.
fn bare(box_background: f32) -> f32 {
    (1.0 - 2.0 * box_background).max(0.0)
}

/// The loss of a batch, ready for `backward`, with its parts, which are on the device still.
///
/// Returns `None` when no ray has a sample.
///
/// # Panics
/// When `known.box_background` has another length than the batch, or `known.mask_trust` a shorter one.
#[must_use]
pub fn loss(
    context: &StepContext,
    scene: &Scene,
    sharpness: &Sharpness,
    batch: &RayBatch,
    marched: &MarchedBatch,
    known: Known<'_>,
    schedule: StepSchedule,
) -> Option<(Tensor<1>, Ledger)> {
    if marched.object.is_empty() && marched.background.is_empty() {
        return None;
    }
    let config = &context.config;
    let weights = &config.loss;
    let device = &context.device;
    let object = object_rows(context, scene, &marched.object, schedule);
    let (background, geometry) = background_rows(context, scene, &marched.background, schedule);
    let n_rays = batch.rays.len();
    assert!(known.box_background.is_empty() || known.box_background.len() == n_rays);
    let mut packing = marched.packing.clone();
    if let Some(spread) = known.spread {
        packing = packing.with_marks(spread.marks());
    }
    let packing = Arc::new(packing);
    let compositing = composite_config(config, schedule.cos_anneal);
    let pixels = blend(
        object.clone(),
        background.clone(),
        sharpness.b(),
        packing.clone(),
        compositing,
        &config.model,
    );
    let mut total = Total::default();
    let (rows, at) = pixel_rows(&pixels, &config.model);
    total.add(pixel_losses(config, schedule, batch, known, at).of(rows, device));
    let mut add = |part: Tensor<1>, weight: f32, entry: Entry| {
        if weight > 0.0 {
            total.add(Weighed::one(part, weight, entry));
        }
    };
    if config.model.fields == Fields::Semantic {
        let share = semantic::share(
            background.clone(),
            geometry,
            sharpness.b(),
            packing,
            compositing,
        );
        let part = semantic::loss(share, &batch.masks);
        add(part, weights.semantic, |losses| &mut losses.mask);
    }
    // What follows speaks of a distance.
    let surface = !marched.object.is_empty() && config.model.foreground == Transparency::Sdf;
    let shape = Shape {
        context,
        scene,
        schedule,
    };
    if surface {
        let part = eikonal_of(object, &marched.object, device);
        add(part, weights.eikonal, |losses| &mut losses.eikonal);
    }
    if weights.curvature > 0.0 && surface {
        let part = shape.curvature(&marched.object.points);
        add(part, weights.curvature, |losses| &mut losses.curvature);
    }
    if !marched.background.is_empty() && config.model.background == Transparency::Sdf {
        let part = eikonal_of(background, &marched.background, device);
        add(part, weights.eikonal_background, |losses| {
            &mut losses.eikonal
        });
    }
    if surface && let Some(distances) = shape.distances() {
        total.add(distances);
    }
    Some(total.sum(device))
}

/// Columns of the pixels' rows that losses are of.
#[derive(Clone, Copy, Debug)]
struct At {
    colour: usize,
    matte: usize,
}

/// The pixels as rows for [`row_losses`], with what both fields make of them behind what compositing gave, where that does
/// not hold it.
fn pixel_rows(pixels: &Blended, model: &ModelConfig) -> (Tensor<2>, At) {
    let rows = pixels.rendered.clone();
    if model.blend == Blend::Sample && model.alpha != AlphaSource::Head {
        let at = At {
            colour: column::JOINT_COLOUR,
            matte: column::MATTE,
        };
        return (rows, at);
    }
    let at = At {
        colour: column::COUNT,
        matte: column::COUNT + 3,
    };
    let parts = vec![rows, pixels.colour.clone(), pixels.matte.clone()];
    (Tensor::cat(parts, 1), at)
}

/// The losses of pixels.
fn pixel_losses(
    config: &TrainConfig,
    schedule: StepSchedule,
    batch: &RayBatch,
    known: Known<'_>,
    at: At,
) -> PixelLosses {
    let weights = &config.loss;
    let mut losses = PixelLosses::new(batch.rays.len());
    let [photo, ..] = [0, 1, 2]
        .map(|channel| losses.know(batch.colours.iter().skip(channel).step_by(3).copied()));
    let kind = match weights.colour {
        config::ColourLoss::L2 => ColourLoss::L2,
        config::ColourLoss::L1 => ColourLoss::L1,
        config::ColourLoss::Huber => ColourLoss::Huber {
            delta: weights.huber_delta,
        },
    };
    let colour = |kind, colour| RowLoss::Colour {
        kind,
        colour,
        photo,
    };
    // Without BaCo nothing explains what is not the object.
    let explained = if config.model.fields == Fields::Object {
        let share = |label: &Label| {
            let (target, trust) = label.target();
            target * trust
        };
        losses.know_weights(batch.labels.iter().map(share))
    } else {
        losses.mean()
    };
    let squares = colour(ColourLoss::L2, at.colour);
    losses.add(squares, explained, 0.0, |losses| &mut losses.mse);
    let joint = colour(kind, at.colour);
    losses.add(joint, explained, 1.0, |losses| &mut losses.colour);
    if config.model.fields == Fields::Both && weights.background > 0.0 {
        let outside = (batch.labels.iter()).map(|l| f32::from(u8::from(*l == Label::Background)));
        let outside = losses.know_weights(outside);
        let alone = colour(kind, column::BACKGROUND_COLOUR);
        losses.add(alone, outside, weights.background, |losses| {
            &mut losses.background
        });
    }
    // Of the visible share, not of the object's own opacity: what stands before it hides it.
    let mut add_masks = |wanted: Vec<(f32, f32)>, weight: f32| {
        let (targets, trust): (Vec<f32>, Vec<f32>) = wanted.into_iter().unzip();
        let mask = losses.know(targets);
        let trust = losses.know_weights(trust);
        let opacity = at.matte;
        losses.add(RowLoss::Mask { opacity, mask }, trust, weight, |losses| {
            &mut losses.mask
        });
    };
    if schedule.mask_weight > 0.0 {
        let targets = batch.labels.iter().map(|l| l.target());
        add_masks(targets.collect(), schedule.mask_weight);
    }
    let mask_trust = known.mask_trust;
    if weights.mask_trusted > 0.0 && mask_trust.iter().any(|trust| *trust > 0.0) {
        let targets = batch.votes.iter().zip(mask_trust).map(|(vote, trust)| {
            vote.map_or((0.0, 0.0), |vote| {
                (f32::from(u8::from(vote.object)), *trust)
            })
        });
        add_masks(targets.collect(), weights.mask_trusted);
    }
    if weights.hidden > 0.0 && config.model.blend == Blend::Sample {
        add_hidden(&mut losses, batch, known.box_background, weights.hidden);
    }
    if known.spread.is_some() {
        let mean = losses.mean();
        // On rays whose end is known, the second mark is how far from that light comes; on others, from how far away.
        let is_sight = |end: &Option<Vec3>| f32::from(u8::from(end.is_some()));
        let any_sight = batch.ends.iter().any(Option::is_some);
        let (others, sights) = if any_sight {
            let others = losses.know_weights(batch.ends.iter().map(|end| 1.0 - is_sight(end)));
            let sights = losses.know_weights(batch.ends.iter().map(is_sight));
            (others, sights)
        } else {
            (mean, mean)
        };
        let mut add_marks = |mark: usize, pixels: usize, weight: f32, entry: Entry| {
            if weight > 0.0 {
                let column = column::MARKS + mark;
                losses.add(RowLoss::Value { column }, pixels, weight, entry);
            }
        };
        add_marks(0, mean, weights.distortion, |losses| &mut losses.distortion);
        add_marks(1, others, schedule.far_weight, |losses| &mut losses.far);
        if any_sight {
            add_marks(1, sights, schedule.sight_weight, |losses| &mut losses.sight);
        }
    }
    losses
}

/// What stands before the object where a mask or colours show it. Of the surface, whoever draws the matte: an alpha head that
/// holds back hides nothing.
fn add_hidden(losses: &mut PixelLosses, batch: &RayBatch, box_background: &[f32], weight: f32) {
    let n = batch.rays.len() as f32;
    let by_mask = batch.shown.iter().enumerate().map(|(ray, shown)| {
        let background = box_background.get(ray).copied().unwrap_or(0.0);
        match shown {
            Shown::ByMask => bare(background) / n,
            Shown::ByColour | Shown::No => 0.0,
        }
    });
    let by_mask = losses.know(by_mask);
    let hidden = RowLoss::Shortfall {
        seen: column::MATTE,
        most: column::OBJECT_OPACITY,
    };
    losses.add(hidden, by_mask, weight, |losses| &mut losses.hidden);
    let by_colour = |shown: &Shown| f32::from(u8::from(*shown == Shown::ByColour));
    if batch.shown.contains(&Shown::ByColour) {
        // Where something opaque hides it, a shortfall has no gradient left; its logarithm has.
        let opacity = column::MATTE;
        let mask = losses.know(batch.shown.iter().map(by_colour));
        let pixels = losses.know(batch.shown.iter().map(|shown| by_colour(shown) / n));
        let hidden = RowLoss::Mask { opacity, mask };
        losses.add(hidden, pixels, weight, |losses| &mut losses.hidden);
    }
}

/// The eikonal loss of samples with these `rows`, whose last column is the normal's length.
fn eikonal_of(rows: Tensor<2>, at: &FieldSamples, device: &Device) -> Tensor<1> {
    let [m, columns] = rows.dims();
    let counts = if at.stands_for.is_empty() {
        vec![1.0; m]
    } else {
        at.stands_for.clone()
    };
    let loss = RowLoss::UnitLength {
        length: columns - 1,
    };
    let term = RowTerm { loss, weight: 0 };
    row_losses(rows, constant(&mean_weights(counts), 1, device), vec![term])
}

/// FoCoR's samples as rows for compositing, `[m, 7]`.
fn object_rows(
    context: &StepContext,
    scene: &Scene,
    at: &FieldSamples,
    schedule: StepSchedule,
) -> Tensor<2> {
    if at.is_empty() {
        return Tensor::zeros([0, composite::object_column::COUNT], &context.device);
    }
    scene.object.sample_rows(
        &at.points,
        &at.directions,
        [&[], &[]],
        SdfFieldConfig {
            forward: at.forward(),
            ..scene.object.sdf_config(
                &context.object_layout,
                schedule.active_levels,
                Some(context.object_gradient.clone()),
            )
        },
        RowConfig {
            reading: reading(context.config.model.foreground),
            view_share: schedule.view_share,
        },
    )
}

/// BaCo's samples as rows for compositing, `[m, 6]`, and its geometry there, `[m, 1 + G + 3]`.
fn background_rows(
    context: &StepContext,
    scene: &Scene,
    at: &FieldSamples,
    schedule: StepSchedule,
) -> (Tensor<2>, Tensor<2>) {
    let model = &context.config.model;
    if at.is_empty() {
        let nothing = |columns| Tensor::zeros([0, columns], &context.device);
        let geometry = scene.background.sdf_weights().b2.dims()[0] + 3;
        return (
            nothing(composite::background_column::COUNT),
            nothing(geometry),
        );
    }
    let probability: &[f32] = match model.fields {
        Fields::Semantic => &[],
        Fields::Both | Fields::Object => &at.probability,
    };
    scene.background.rows_and_geometry(
        [&at.points, &at.directions, probability, &at.stretch],
        SdfFieldConfig {
            forward: at.forward(),
            ..scene.background.sdf_config(
                &context.background_layout,
                schedule.background_levels,
                Some(context.background_gradient.clone()),
            )
        },
        RowConfig {
            reading: reading(model.background),
            view_share: 1.0,
        },
    )
}

/// How a field's first output is read.
fn reading(transparency: Transparency) -> Reading {
    match transparency {
        Transparency::Sdf => Reading::Distance,
        Transparency::Density => Reading::Density,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_of_background_in_the_box_need_not_show_the_object() {
        assert_eq!([0.0, 0.25, 0.75].map(bare), [1.0, 0.5, 0.0]);
    }
}
