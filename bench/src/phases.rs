//! Time per phase: the trainer's clock for the parts of a step, the ops' own stopwatches within.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

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

/// Phases that are not the method's arithmetic: optimisers and bookkeeping.
pub(crate) const OVERHEAD: [&str; 4] = [
    "votes",
    "losses and autodiff",
    "network optimiser",
    "table optimiser",
];

/// The clocks' state when a measurement began, and the steps since.
pub(crate) struct Marks {
    clock: StepClock,
    ops: [Duration; OPS.len()],
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
        ] {
            let time = phase(of);
            known += time;
            if time > Duration::ZERO {
                phase_ms.insert(name.to_owned(), ms(time));
            }
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
