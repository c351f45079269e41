//! The training loop and what it keeps.

mod adam;
pub mod agreement;
mod ahead;
mod alike;
pub mod batch;
pub mod blend;
mod cameras;
pub mod carve;
pub mod checkpoint;
pub mod clock;
mod contested;
mod courier;
pub mod distortion;
mod found_masks;
mod gather;
pub mod grids;
pub mod ledger;
mod order;
mod outlook;
mod pixel_losses;
mod probes;
mod renewal;
mod representatives;
mod rounds;
pub mod run;
pub mod sampler;
pub mod schedule;
pub mod semantic;
pub mod setup;
mod shape_losses;
pub mod step;
#[cfg(test)]
mod tiny;
mod total;
pub mod visible;

use std::sync::Arc;

use burn::optim::GradientsParams;
use glam::Vec3;
use hashgrid::{LazyAdam, SparseGrad};
use neus_render::march::{Grids, MarchConfig};
use scene_decomp::probability::ProbabilityMap;
use scene_decomp::{Scene, Sharpness, SurfaceVotes};

use crate::config::{Fields, ProbabilitySource, TrainConfig};
use crate::device::DeviceKind;
use crate::prepare::mask_faults::MaskFaults;
use crate::prepare::{Frame, Prepared};
use adam::NetworkOptimiser;
use agreement::Agreement;
use ahead::Ahead;
use batch::{MarchedBatch, Partition};
use cameras::Cameras;
use clock::{Phase, StepClock};
use contested::Contested;
use distortion::Spread;
use grids::FieldGrids;
use ledger::StepLosses;
use outlook::Outlook;
use sampler::{RayBatch, Sampler};
use step::{Known, StepContext, StepSchedule};

pub use run::run;

/// Steps inside the box that the background alone is marched at once.
pub(crate) const BACKGROUND_STRIDE: u32 = 2;
/// Steps between two updates of m^P from the votes.
const VOTES_EVERY: u32 = 250;
/// What votes are worth after each update.
const VOTES_KEPT: f32 = 0.7;
/// Share of the run after the carving, or after the start, in which FoCoR finds its outline before
/// masks are compared with it.
const SETTLING: f32 = 0.1;
/// Rays of a step at least, however many samples they take.
const FEWEST_RAYS: f32 = 64.0;
/// How far `s` may stay below its cap: b by a factor of 2.
const SHARPNESS_SLACK: f32 = 0.07;

/// A run in progress.
pub struct Trainer {
    context: StepContext,
    /// The box of the scene.
    frame: Frame,
    scene: Scene,
    sharpness: Sharpness,
    optimiser: NetworkOptimiser,
    sharpness_optimiser: NetworkOptimiser,
    object_adam: LazyAdam,
    background_adam: LazyAdam,
    grids: Arc<FieldGrids>,
    device_name: String,
    device_kind: DeviceKind,
    /// m^P as it is now.
    map: Arc<ProbabilityMap>,
    /// Sparse points in the box, whatever they are of.
    sparse_points: Vec<Vec3>,
    votes: SurfaceVotes,
    agreement: Agreement,
    /// Of each view's mask with its photo; empty until somebody asks.
    mask_contrasts: Vec<Option<f32>>,
    /// What geometry has shown to be wrong with the masks.
    mask_faults: MaskFaults,
    contested: Contested,
    cameras: Cameras,
    sampler: Sampler,
    outlook: Outlook,
    ahead: Ahead,
    step: u32,
    /// Rays a step, followed so that the samples meet the budget.
    rays: f32,
    /// Learning rates are multiplied by this: halved whenever a step had to be undone.
    rate_scale: f64,
    empty_batches: u32,
    clock: StepClock,
}

/// What one step did.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct StepReport {
    /// The losses; zero when the batch was empty. On a GPU those that were read last, the mean of some steps.
    #[serde(flatten)]
    pub losses: StepLosses,
    /// Rays in the batch.
    pub rays: usize,
    /// FoCoR's samples.
    pub object_samples: usize,
    /// BaCo's samples.
    pub background_samples: usize,
    /// Grid levels in use.
    pub active_levels: usize,
}

impl StepReport {
    /// Whether every loss is a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.losses.is_finite()
    }
}

impl Trainer {
    /// The step to be done next.
    #[must_use]
    pub fn step_number(&self) -> u32 {
        self.step
    }

    /// The run's settings.
    #[must_use]
    pub fn config(&self) -> &TrainConfig {
        &self.context.config
    }

    /// What computes, as in "Flex on 8 threads".
    #[must_use]
    pub fn device_name(&self) -> &str {
        &self.device_name
    }

    /// Both fields' occupancy.
    #[must_use]
    pub fn grids(&self) -> &FieldGrids {
        &self.grids
    }

    /// Does one step.
    pub fn step(&mut self, data: &Prepared) -> StepReport {
        let config = self.context.config.clone();
        let schedule = self.schedule();
        let both = config.model.fields == Fields::Both;
        if self.is_carving_due() {
            self.carve(data);
            self.outlook.forget();
            self.ahead.forget();
        }
        self.clock.begin();
        if self.step.is_multiple_of(config.sampling.occupancy_every) {
            self.update_grids(schedule);
        }
        self.clock.lap(Phase::Grids);
        let (batch, gathered) = self.collect(data);
        // What is not split needs no m^P to split it.
        if both && config.model.probability == ProbabilitySource::Surface {
            self.vote(data, &gathered.votes);
        }
        self.compare_masks(data, &batch, &gathered.mattes);
        self.clock.lap(Phase::Vote);
        self.learn(
            &batch,
            &gathered.marched,
            gathered.spread.as_ref(),
            &gathered.box_background,
            schedule,
        )
    }

    /// The second half of a step: learns from the samples of a batch, whoever chose them. `spread` and
    /// `box_background` are as in [`step::Known`].
    pub fn learn(
        &mut self,
        batch: &RayBatch,
        marched: &MarchedBatch,
        spread: Option<&Spread>,
        box_background: &[f32],
        schedule: StepSchedule,
    ) -> StepReport {
        self.clock.begin();
        let mut report = StepReport {
            rays: batch.rays.len(),
            object_samples: marched.object.len(),
            background_samples: marched.background.len(),
            active_levels: schedule.active_levels,
            ..StepReport::default()
        };
        self.follow_budget(marched.object.stood_for() + marched.background.stood_for());
        let trust: Vec<f32> = batch
            .views
            .iter()
            .zip(&batch.tiles)
            .map(|(view, tile)| self.agreement.trust(*view as usize, *tile))
            .collect();
        let loss = step::loss(
            &self.context,
            &self.scene,
            &self.sharpness,
            batch,
            marched,
            Known {
                spread,
                box_background,
                mask_trust: &trust,
            },
            schedule,
        );
        self.clock.lap(Phase::Forward);
        self.step += 1;
        let Some((loss, ledger)) = loss else {
            self.empty_batches += 1;
            return report;
        };
        self.empty_batches = 0;
        let config = &self.context.config;
        // What is written to files now has to be known to be sound.
        let written = [config.export.checkpoint_every, config.export.preview_every];
        let wanted = self.step == config.steps
            || written.iter().any(|every| self.step.is_multiple_of(*every));
        report.losses = self.outlook.losses(ledger, self.step, wanted);
        if report.is_finite() {
            self.descend(loss);
        }
        report
    }

    /// What geometry has shown to be wrong with the masks since the start.
    #[must_use]
    pub fn mask_faults(&self) -> &MaskFaults {
        &self.mask_faults
    }

    /// Where the time of all steps so far has gone.
    #[must_use]
    pub fn clock(&self) -> &StepClock {
        &self.clock
    }

    /// What the schedules say now.
    #[must_use]
    pub fn schedule(&self) -> StepSchedule {
        self.schedule_of(self.step)
    }

    fn schedule_of(&self, step: u32) -> StepSchedule {
        let levels = self.context.object_layout.levels.len();
        schedule::at(self.config(), step, levels)
    }

    /// The hash tables' learning rate at the last step.
    #[must_use]
    pub fn learning_rate(&self) -> f32 {
        let factor = schedule::rate_factor(self.config(), self.step.saturating_sub(1));
        (f64::from(self.config().schedule.learning_rate) * factor * self.rate_scale) as f32
    }

    /// How many steps in a row had no sample at all.
    #[must_use]
    pub fn empty_batches(&self) -> u32 {
        self.empty_batches
    }

    /// Adds the votes of a batch's pixels on m^P, and follows them every so often.
    fn vote(&mut self, data: &Prepared, votes: &[gather::SurfaceVote]) {
        let config = &self.context.config;
        for vote in votes {
            self.votes.add(vote.point, vote.weight, vote.object);
        }
        let due = schedule::progress(config, self.step) >= config.schedule.votes_start;
        if due && self.step >= schedule::carve_step(config) && self.step.is_multiple_of(VOTES_EVERY)
        {
            self.follow(self.probability(data));
        }
        if self.step.is_multiple_of(VOTES_EVERY) {
            self.votes.fade(VOTES_KEPT);
        }
    }

    /// Makes `map` m^P: samples and sparse points are the object's where it says so.
    fn follow(&mut self, map: ProbabilityMap) {
        let crop = self.context.config.prepare.crop_threshold;
        self.context.points = shape_losses::surely_of_object(&self.sparse_points, &map);
        self.ahead.forget_grids();
        Arc::make_mut(&mut self.grids).allow(&map, crop);
        self.map = Arc::new(map);
    }

    /// Compares the batch's mattes with the masks, once there is an object to speak of.
    fn compare_masks(&mut self, data: &Prepared, batch: &RayBatch, mattes: &[f32]) {
        let config = &self.context.config;
        let settled = schedule::carve_step(config) + (SETTLING * config.steps as f32) as u32;
        if config.loss.mask_trusted == 0.0 || self.step < settled {
            return;
        }
        let pixels = batch.views.iter().zip(&batch.tiles);
        for (((view, tile), vote), matte) in pixels.zip(&batch.votes).zip(mattes) {
            if let Some(vote) = vote {
                self.agreement
                    .add(*view as usize, *tile, *matte, vote.object);
            }
        }
        // Not of what a few steps have seen.
        if self.step.is_multiple_of(VOTES_EVERY) && self.step >= settled + VOTES_EVERY {
            self.look_at_outlines(data);
            self.agreement.update(&self.mask_contrasts);
        }
    }

    fn descend(&mut self, loss: burn::Tensor<1>) {
        let config = &self.context.config;
        let factor = schedule::rate_factor(config, self.step - 1) * self.rate_scale;
        let rate = |base: f32| f64::from(base) * factor;
        let mut grads = loss.backward();
        let fields = GradientsParams::from_module(&mut grads, &self.scene);
        let sharpness = GradientsParams::from_module(&mut grads, &self.sharpness);
        drop(grads);
        self.clock.lap(Phase::Backward);
        let mlp = rate(config.schedule.learning_rate_mlp);
        let b = rate(config.schedule.sharpness_learning_rate);
        let table = rate(config.schedule.learning_rate);
        self.scene = self.optimiser.step(mlp, self.scene.clone(), fields);
        self.sharpness = self
            .sharpness_optimiser
            .step(b, self.sharpness.clone(), sharpness);
        let finest = self
            .context
            .object_layout
            .levels
            .last()
            .map_or(512, |l| l.resolution);
        // Phi_b falls from 0.95 to 0.05 over 6 / b. Thinner than a cell of the finest level,
        // 2 / resolution, there is nothing to see; much thinner than a step along the ray, 2 /
        // steps, the opacity hangs on the noise of single normals.
        let steps = config.sampling.object_steps as f32;
        let sharpest = (3.0 * finest as f32).min(2.4 * steps);
        let cap = schedule::sharpness_cap(config, self.step, sharpest);
        // Nor may it fall far behind, which is fog: the background seen through the object.
        self.sharpness.limit(cap - SHARPNESS_SLACK, cap);
        self.clock.lap(Phase::Networks);
        self.object_adam.step_grid(
            &mut self.scene.object.grid,
            &self.context.object_gradient,
            table,
        );
        self.background_adam.step_grid(
            &mut self.scene.background.grid,
            &self.context.background_gradient,
            table,
        );
        self.clock.lap(Phase::Tables);
        if self.device_kind == DeviceKind::Renderer {
            // Whoever is further ahead has a core ask whether there is room in CubeCL's queue, which the device then lacks.
            // What has failed is missed when it is read.
            let _ = self.context.device.sync();
            self.clock.lap(Phase::Wait);
        }
    }

    /// Moves the number of rays towards the sample budget (a tenth of the way each step); those that `samples` stand
    /// for count.
    fn follow_budget(&mut self, samples: f32) {
        let sampling = &self.context.config.sampling;
        let wanted = self.rays * sampling.target_samples as f32 / samples.max(1.0);
        let next = 0.9 * self.rays + 0.1 * wanted.clamp(0.5 * self.rays, 2.0 * self.rays);
        let most = sampling.most_rays as f32;
        self.rays = next.clamp(most.min(FEWEST_RAYS), most);
    }
}

/// How rays are marched in training.
fn march_config(config: &TrainConfig) -> MarchConfig {
    MarchConfig {
        step_object: 2.0 / config.sampling.object_steps as f32,
        background_stride: BACKGROUND_STRIDE,
        background_samples: config.sampling.background_samples,
        ..MarchConfig::default()
    }
}

/// Where each field is marched at `step`: BaCo everywhere while it is alone, then each on its side of
/// m^P; FoCoR on its own side too where there is no BaCo.
pub(crate) fn space<'a>(
    config: &TrainConfig,
    step: u32,
    grids: &'a FieldGrids,
    map: &'a ProbabilityMap,
) -> (Grids<'a>, Partition<'a>) {
    let alone = schedule::background_alone(config, step);
    let partition = grids.partition(map, !alone);
    let grids = Grids {
        object: (!alone).then_some(&grids.object),
        background: (config.model.fields != Fields::Object).then_some(&grids.background),
    };
    (grids, partition)
}

/// The accumulators shared between the ops and the optimisers.
fn gradient_sinks(context_layouts: [&Arc<hashgrid::GridLayout>; 2]) -> [SparseGrad; 2] {
    context_layouts.map(|layout| SparseGrad::new(layout))
}
