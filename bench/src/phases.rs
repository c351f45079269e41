//! Time per phase: the trainer's clock for the parts of a step, the ops' own stopwatches within.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use hashgrid::step_clock::{SCATTER, UPDATE};
use neus_render::composite;
use scene_decomp::{colour_field, sdf_field};
use sos_train::train::Trainer;
use sos_train::train::clock::{Phase, StepClock};
use tensor_slices::Stopwatch;

use crate::steps::StepFigures;

/// The fused ops' stopwatches, by the names of their phases.
const OPS: [(&str, &[&Stopwatch]); 5] = [
    ("sdf field forward", &[&sdf_field::FORWARD]),
    ("sdf field backward", &[&sdf_field::BACKWARD]),
    ("colour field forward", &[&colour_field::FORWARD]),
    ("colour field backward", &[&colour_field::BACKWARD]),
    ("compositing", &[&composite::FORWARD, &composite::BACKWARD]),
];

/// The phase to which the scatter belongs, and the one in whose time it happens: gradients of tables wait
/// for the optimiser, which adds them up level by level.
pub(crate) const SCATTER_OF: &str = "sdf field backward";

/// Phases that are not the method's arithmetic: optimisers and bookkeeping.
pub(crate) const OVERHEAD: [&str; 4] = [
    "votes",
    "losses and autodiff",
    "network optimiser",
    "table optimiser",
];

/// The clocks of optimisers' steps at some time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScatterMark([Duration; 2]);

impl ScatterMark {
    pub(crate) fn now() -> Self {
        Self([SCATTER.total(), UPDATE.total()])
    }

    /// Between 0 and 1: of all threads' time in steps since.
    pub(crate) fn share(self) -> f64 {
        let [scatter, update] = [SCATTER.total() - self.0[0], UPDATE.total() - self.0[1]];
        scatter.as_secs_f64() / (scatter + update).as_secs_f64().max(f64::MIN_POSITIVE)
    }
}

/// The clocks' state when a measurement began, and the steps since.
pub(crate) struct Marks {
    clock: StepClock,
    ops: [Duration; OPS.len()],
    scatter: ScatterMark,
    begun: Instant,
    last: Instant,
    steps: Vec<Duration>,
    samples: usize,
}

impl Marks {
    pub(crate) fn begin(trainer: &Trainer) -> Self {
        let now = Instant::now();
        Self {
            clock: trainer.clock().clone(),
            ops: ops(),
            scatter: ScatterMark::now(),
            begun: now,
            last: now,
            steps: Vec::new(),
            samples: 0,
        }
    }

    /// A step of so many samples is over.
    pub(crate) fn step_done(&mut self, samples: usize) {
        let now = Instant::now();
        self.steps.push(now - self.last);
        self.last = now;
        self.samples += samples;
    }

    /// Means over all steps since the beginning, and the median step.
    pub(crate) fn figures(mut self, trainer: &Trainer) -> StepFigures {
        let count = self.steps.len().max(1) as f64;
        let wall = self.last - self.begun;
        let ms = |time: Duration| time.as_secs_f64() * 1e3 / count;
        let phase = |phase| trainer.clock().total(phase) - self.clock.total(phase);
        let mut phase_ms = BTreeMap::new();
        let mut in_ops = Duration::ZERO;
        for ((name, _), (now, before)) in OPS.iter().zip(ops().iter().zip(&self.ops)) {
            in_ops += *now - *before;
            phase_ms.insert((*name).to_owned(), ms(*now - *before));
        }
        let learning = phase(Phase::Forward) + phase(Phase::Backward);
        let mut known = learning;
        phase_ms.insert(
            "losses and autodiff".to_owned(),
            ms(learning.saturating_sub(in_ops)),
        );
        for (name, of) in [
            ("occupancy", Phase::Grids),
            ("drawing rays", Phase::Draw),
            ("gathering samples", Phase::Gather),
            ("votes", Phase::Vote),
            ("network optimiser", Phase::Networks),
            ("table optimiser", Phase::Tables),
            ("waiting for the device", Phase::Wait),
        ] {
            let time = phase(of);
            known += time;
            if time > Duration::ZERO {
                phase_ms.insert(name.to_owned(), ms(time));
            }
        }
        if let Some(tables) = phase_ms.get("table optimiser").copied() {
            let scatter = tables * self.scatter.share();
            phase_ms.insert("table optimiser".to_owned(), tables - scatter);
            *phase_ms.entry(SCATTER_OF.to_owned()).or_default() += scatter;
        }
        phase_ms.insert(
            "outside the step".to_owned(),
            ms(wall.saturating_sub(known)),
        );
        let total: f64 = phase_ms.values().sum();
        let phase_share = phase_ms
            .iter()
            .map(|(name, ms)| (name.clone(), ms / total))
            .collect();
        let overhead: f64 = OVERHEAD.iter().filter_map(|name| phase_ms.get(*name)).sum();
        self.steps.sort();
        let median = self.steps.get(self.steps.len() / 2);
        StepFigures {
            trained_samples_per_s: self.samples as f64 / wall.as_secs_f64(),
            samples_per_step: self.samples as f64 / count,
            step_ms: median.map_or(0.0, |step| step.as_secs_f64() * 1e3),
            overhead_share: overhead / total,
            phase_ms,
            phase_share,
        }
    }
}

fn ops() -> [Duration; OPS.len()] {
    OPS.map(|(_, stopwatches)| stopwatches.iter().map(|s| s.total()).sum())
}
