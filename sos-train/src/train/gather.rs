//! From a batch of rays to the samples that a step learns from.
//!
//! Rays are marched, looked along and thinned out a few at a time, so that all cores work and what a
//! task holds stays in its core's cache. Only the samples that light reaches leave the task.

use glam::Vec3;
use neus_render::composite::{Packing, Visibility};
use neus_render::march::{Grids, Jitter, MarchConfig};
use neus_render::rays::Ray;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::batch::{BatchMarcher, FieldSamples, MarchedBatch, Partition};
use super::contested::Contested;
use super::distortion::{self, Spread};
use super::representatives::Representatives;
use super::sampler::RayBatch;
use super::visible::{Alone, FrozenFields, Look};
use crate::config::{AlphaSource, Blend, TrainConfig, Transparency};
use crate::prepare::Label;

/// Rays that one task takes: few, so that tasks run beside each other and their lists stay in a core's cache.
const RAYS_PER_TASK: usize = 64;
/// Lighter samples do not vote.
const LEAST_VOTE: f32 = 0.02;

/// How rays become samples.
#[derive(Clone, Copy)]
pub(super) struct Rules<'a> {
    pub(super) config: &'a TrainConfig,
    pub(super) grids: Grids<'a>,
    pub(super) march: MarchConfig,
    pub(super) partition: Partition<'a>,
    pub(super) cos_anneal: f32,
    /// Whether the samples' spread is wanted.
    pub(super) spread: bool,
    /// Views in which FoCoR has the right of way.
    pub(super) contested: &'a Contested,
    /// Seeds the raster and the choice of samples; another one for every step.
    pub(super) seed: u64,
}

/// What a step learns from, and what was found on the way.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    pub(super) marched: MarchedBatch,
    pub(super) spread: Option<Spread>,
    /// The visible object's share of each pixel, `[rays]`.
    pub(super) mattes: Vec<f32>,
    /// The share of each pixel that BaCo sends from inside the box, where it may hide the object, `[rays]`.
    pub(super) box_background: Vec<f32>,
    pub(super) votes: Vec<SurfaceVote>,
}

/// A point that a pixel sees, for or against the object.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceVote {
    pub(super) point: Vec3,
    pub(super) weight: f32,
    pub(super) object: bool,
}

/// Gathers the samples of `batch`. The result does not depend on the number of threads.
pub(super) fn gather(batch: &RayBatch, fields: &FrozenFields, rules: Rules<'_>) -> Gathered {
    let parts: Vec<Gathered> = batch
        .rays
        .par_chunks(RAYS_PER_TASK)
        .enumerate()
        .map_init(BatchMarcher::default, |marcher, (number, rays)| {
            let first = number * RAYS_PER_TASK;
            gather_chunk(batch, first, rays, fields, rules, marcher)
        })
        .collect();
    join(parts, rules.spread)
}

/// The rays from number `first` on.
fn gather_chunk(
    batch: &RayBatch,
    first: usize,
    rays: &[Ray],
    fields: &FrozenFields,
    rules: Rules<'_>,
    marcher: &mut BatchMarcher,
) -> Gathered {
    let config = rules.config;
    let seed = rules.seed ^ (first as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
    let march = MarchConfig {
        jitter: Jitter::Seeded(seed),
        ..rules.march
    };
    let marched = marcher.march(rays, rules.grids, &march, rules.partition);
    // What is drawn by itself has to be complete behind the other one too: BaCo, and FoCoR where they are blended ray by ray.
    let by_ray = config.model.blend == Blend::Ray;
    let both_alone = by_ray || config.model.alpha == AlphaSource::Head;
    let outside_alone = config.loss.background > 0.0;
    let cleared = |ray: usize| {
        let ray = first + ray;
        rules.contested.clears(batch.views[ray], batch.shown[ray])
    };
    let alone = |ray: usize| Alone {
        object: by_ray || cleared(ray),
        background: both_alone || (outside_alone && batch.labels[first + ray] == Label::Background),
    };
    let (marched, look) = fields.look(marched, config, rules.cos_anneal, alone);
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x00d4_a3e1);
    let share = config.sampling.clear_share;
    let rows = look.object_reached(|i| alone(marched.object.ray[i] as usize).object);
    let object = match config.model.foreground {
        Transparency::Sdf => {
            Representatives::thinned(rows, &look.visibility.object, share, &mut random)
        }
        Transparency::Density => Representatives::all(rows),
    };
    let alone = |ray: usize| alone(ray).background;
    let background = match config.model.background {
        Transparency::Sdf => {
            let rows = look.background_reached(|i| alone(marched.background.ray[i] as usize));
            let seen = &look.visibility.background;
            Representatives::thinned(rows, seen, share, &mut random)
        }
        Transparency::Density => look.background_drawn(&marched, alone, &mut random),
    };
    let spread = rules.spread.then(|| {
        distortion::spread(&marched, &look, &batch.ends[first..first + rays.len()])
            .select(&object.rows, &background.rows)
    });
    let mut mattes = vec![0.0f32; rays.len()];
    for (ray, seen) in marched.object.ray.iter().zip(&look.visibility.object) {
        mattes[*ray as usize] += seen.weight;
    }
    let mut box_background =
        box_background(rays.len(), &marched.background, &look.visibility.background);
    for (ray, share) in box_background.iter_mut().enumerate() {
        if cleared(ray) {
            *share = 0.0;
        }
    }
    let votes = votes(batch, first, &marched, &look);
    let mut marched = marched.keep(&object.rows, &background.rows);
    marched.object.stands_for = object.stands_for;
    marched.background.stretch = background.stretch;
    marched.background.stands_for = background.stands_for;
    marched.background.look_up(rules.partition.map);
    Gathered {
        marched,
        spread,
        mattes,
        box_background,
        votes,
    }
}

/// The share of each ray's light that BaCo sends from inside the box, `[rays]`.
fn box_background(rays: usize, background: &FieldSamples, seen: &[Visibility]) -> Vec<f32> {
    let mut shares = vec![0.0f32; rays];
    let points = background.points.chunks_exact(3).map(Vec3::from_slice);
    for ((point, ray), seen) in points.zip(&background.ray).zip(seen) {
        if point.abs().max_element() < 1.0 {
            shares[*ray as usize] += seen.weight;
        }
    }
    shares
}

/// What the pixels' masks say of the points that they see.
fn votes(batch: &RayBatch, first: usize, marched: &MarchedBatch, look: &Look) -> Vec<SurfaceVote> {
    let mut votes = Vec::new();
    for (samples, visibility) in [
        (&marched.object, &look.visibility.object),
        (&marched.background, &look.visibility.background),
    ] {
        for (i, seen) in visibility.iter().enumerate() {
            if seen.weight < LEAST_VOTE {
                continue;
            }
            if let Some(vote) = batch.votes[first + samples.ray[i] as usize] {
                votes.push(SurfaceVote {
                    // In the box BaCo's contracted space is the box's own.
                    point: Vec3::from_slice(&samples.points[3 * i..]),
                    weight: seen.weight * vote.weight,
                    object: vote.object,
                });
            }
        }
    }
    votes
}

/// One batch of all parts, in their order.
fn join(parts: Vec<Gathered>, spread: bool) -> Gathered {
    let total = |count: fn(&MarchedBatch) -> usize| -> usize {
        parts.iter().map(|part| count(&part.marched)).sum()
    };
    let intervals = total(|m| m.packing.interval_count());
    let mut object = FieldSamples::with_capacity(total(|m| m.object.len()));
    let mut background = FieldSamples::with_capacity(total(|m| m.background.len()));
    let mut offsets = vec![0];
    let (mut t, mut dt) = (Vec::with_capacity(intervals), Vec::with_capacity(intervals));
    let (mut object_intervals, mut background_intervals) = (Vec::new(), Vec::new());
    let mut out = Gathered {
        spread: spread.then(Spread::default),
        ..Gathered::default()
    };
    for part in parts {
        let packing = &part.marched.packing;
        let (ray, interval) = (out.mattes.len() as u32, t.len() as u32);
        offsets.extend(packing.ray_offsets()[1..].iter().map(|end| end + interval));
        t.extend_from_slice(packing.t());
        dt.extend_from_slice(packing.dt());
        object_intervals.extend(packing.object().iter().map(|i| i + interval));
        background_intervals.extend(packing.background().iter().map(|i| i + interval));
        object.append(&part.marched.object, ray);
        background.append(&part.marched.background, ray);
        if let (Some(all), Some(spread)) = (&mut out.spread, part.spread) {
            all.append(spread);
        }
        out.mattes.extend(part.mattes);
        out.box_background.extend(part.box_background);
        out.votes.extend(part.votes);
    }
    out.marched = MarchedBatch {
        packing: Packing::new(offsets, t, dt, object_intervals, background_intervals),
        object,
        background,
    };
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_the_background_in_the_box_is_summed_by_ray() {
        let (inside, beyond) = ([0.5, 0.0, -0.9], [0.5, 0.0, -1.1]);
        let mut background = FieldSamples::with_capacity(5);
        for (ray, point) in [
            (0, inside),
            (0, inside),
            (1, inside),
            (1, beyond),
            (2, beyond),
        ] {
            background.points.extend(point);
            background.ray.push(ray);
        }
        let seen = [0.5, 0.25, 0.5, 0.25, 1.0].map(|weight| Visibility {
            weight,
            ..Visibility::default()
        });
        let shares = box_background(4, &background, &seen);
        assert_eq!(shares, [0.75, 0.5, 0.0, 0.0]);
    }
}
