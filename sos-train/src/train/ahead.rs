//! What the processor does for steps to come while a GPU learns from those before.
//!
//! Which samples a batch has, and which space is occupied, is asked of a copy of the fields that is some steps old anyway
//! ([`outlook`](super::outlook)), so it need not wait for the steps before it. On the CPU, where fields are asked as they
//! are and every core is busy, a batch is gathered when its step comes.

use std::collections::VecDeque;
use std::sync::Arc;

use scene_decomp::probability::ProbabilityMap;

use super::clock::Phase;
use super::contested::Contested;
use super::courier::{Courier, Parcel};
use super::gather::{Gathered, Rules, gather};
use super::grids::FieldGrids;
use super::sampler::RayBatch;
use super::step::StepSchedule;
use super::visible::FrozenFields;
use super::{Trainer, march_config, schedule, space};

use crate::config::TrainConfig;
use crate::prepare::Prepared;

/// Batches on their way beside the one that is learnt from: each has stretches that a single core does.
const DEPTH: usize = 2;

/// A batch and its samples.
type Load = (RayBatch, Gathered);

/// The batches of the next steps, and the next grids.
pub(super) struct Ahead {
    /// Who gathers them in turn, and who renews grids, the last one; nobody on the CPU.
    couriers: Vec<Courier>,
    /// In the order of their steps.
    coming: VecDeque<(u32, Parcel<Load>)>,
    /// On their way since the last renewal.
    grids: Option<Parcel<Arc<FieldGrids>>>,
}

impl Ahead {
    /// For fields that are learnt on the CPU, or on a GPU.
    pub(super) fn new(is_cpu: bool) -> Self {
        let couriers = if is_cpu { 0 } else { DEPTH + 1 };
        Self {
            couriers: (0..couriers).map(|_| Courier::new()).collect(),
            coming: VecDeque::new(),
            grids: None,
        }
    }

    /// Drops what was gathered for other fields than those of now.
    pub(super) fn forget(&mut self) {
        self.coming.clear();
        self.forget_grids();
    }

    /// Drops what was renewed of other grids than those of now.
    pub(super) fn forget_grids(&mut self) {
        self.grids = None;
    }

    /// The grids that were sent for last.
    pub(super) fn take_grids(&mut self) -> Option<Arc<FieldGrids>> {
        self.grids.take().map(Parcel::open)
    }

    /// Sends for `grids` as they are after `renewal`.
    pub(super) fn renew(
        &mut self,
        mut grids: Arc<FieldGrids>,
        renewal: impl FnOnce(&mut FieldGrids) + Send + 'static,
    ) {
        self.grids = self.couriers.last().map(|courier| {
            courier.send(move || {
                renewal(Arc::make_mut(&mut grids));
                grids
            })
        });
    }

    /// The batch of `step`, if it was sent for.
    fn take(&mut self, step: u32) -> Option<Parcel<Load>> {
        let (sent_for, parcel) = self.coming.pop_front()?;
        if sent_for == step {
            return Some(parcel);
        }
        self.forget();
        None
    }

    /// The step to send for next, while `step` is done.
    fn wanted(&self, step: u32) -> Option<u32> {
        let (under_way, gatherers) = (self.coming.len(), self.couriers.len().saturating_sub(1));
        (under_way < gatherers).then_some(step + 1 + under_way as u32)
    }

    fn send(&mut self, step: u32, errand: Errand) {
        let courier = &self.couriers[step as usize % DEPTH];
        let parcel = courier.send(move || errand.run());
        self.coming.push_back((step, parcel));
    }
}

/// All that gathering a batch takes, on whatever thread.
struct Errand {
    batch: RayBatch,
    fields: FrozenFields,
    grids: Arc<FieldGrids>,
    map: Arc<ProbabilityMap>,
    contested: Contested,
    config: TrainConfig,
    schedule: StepSchedule,
}

impl Errand {
    fn run(self) -> Load {
        let (config, schedule) = (&self.config, self.schedule);
        let (grids, partition) = space(config, schedule.step, &self.grids, &self.map);
        let rules = Rules {
            config,
            grids,
            march: march_config(config),
            partition,
            cos_anneal: schedule.cos_anneal,
            spread: config.loss.distortion > 0.0
                || schedule.far_weight > 0.0
                || schedule.sight_weight > 0.0,
            contested: &self.contested,
            seed: config.seed ^ (u64::from(schedule.step) << 20),
        };
        let gathered = gather(&self.batch, &self.fields, rules);
        (self.batch, gathered)
    }
}

impl Trainer {
    /// The batch of this step with its samples. On a GPU those of the next steps are sent for.
    pub(super) fn collect(&mut self, data: &Prepared) -> Load {
        let load = match self.ahead.take(self.step) {
            Some(parcel) => {
                self.send_ahead(data);
                parcel.open()
            }
            None => {
                let errand = self.errand(data, self.step);
                self.send_ahead(data);
                errand.run()
            }
        };
        self.clock.lap(Phase::Gather);
        load
    }

    /// Sends for batches as far ahead as couriers go, but not past the carving, after which nothing is as it was.
    fn send_ahead(&mut self, data: &Prepared) {
        while let Some(step) = self.ahead.wanted(self.step) {
            let carve = schedule::carve_step(self.config());
            if step >= self.config().steps || (self.step < carve && step >= carve) {
                return;
            }
            let errand = self.errand(data, step);
            self.ahead.send(step, errand);
        }
    }

    fn errand(&mut self, data: &Prepared, step: u32) -> Errand {
        let batch = self.sampler.draw(data, step, self.rays as usize);
        self.clock.lap(Phase::Draw);
        let schedule = self.schedule_of(step);
        Errand {
            batch,
            fields: self.look_to_learn(schedule),
            grids: self.grids.clone(),
            map: self.map.clone(),
            contested: self.contested.clone(),
            config: self.config().clone(),
            schedule,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(ahead: &mut Ahead, step: u32) -> Option<u32> {
        let wanted = ahead.wanted(step)?;
        let parcel = ahead.couriers[0].send(Load::default);
        ahead.coming.push_back((wanted, parcel));
        Some(wanted)
    }

    #[test]
    fn a_gpus_batches_come_in_the_order_of_their_steps() {
        let mut ahead = Ahead::new(false);
        assert!(ahead.take(7).is_none());
        assert_eq!(sent(&mut ahead, 7), Some(8));
        assert_eq!(sent(&mut ahead, 7), Some(9));
        assert_eq!(sent(&mut ahead, 7), None);
        assert!(ahead.take(8).is_some());
        assert_eq!(sent(&mut ahead, 8), Some(10));
        // What is not wanted any more is gathered anew.
        assert!(ahead.take(3).is_none());
        assert_eq!(sent(&mut ahead, 3), Some(4));
    }

    #[test]
    fn grids_are_renewed_beside_those_in_use_unless_these_have_changed() {
        let map = ProbabilityMap::new(8, vec![0.5; 512]);
        let in_use = Arc::new(FieldGrids::new(8, &map, 0.5));
        let empty = |grids: &mut FieldGrids| grids.background.set_all(0.0);
        let mut ahead = Ahead::new(false);
        assert!(ahead.take_grids().is_none());
        ahead.renew(in_use.clone(), empty);
        let renewed = ahead.take_grids().expect("they were sent for");
        let values = |grids: &FieldGrids| grids.background.values().to_vec();
        assert_eq!(values(&renewed), vec![0.0; 512]);
        assert_ne!(values(&in_use), values(&renewed));
        // Nobody wants what was made of grids that are not in use any more.
        ahead.renew(in_use, empty);
        ahead.forget_grids();
        assert!(ahead.take_grids().is_none());
    }

    #[test]
    fn on_the_cpu_nothing_is_gathered_before_its_step() {
        let mut ahead = Ahead::new(true);
        assert_eq!(ahead.wanted(0), None);
        assert!(ahead.take(0).is_none());
    }
}
