//! Where the time of training steps goes.

use std::time::{Duration, Instant};

/// A part of a training step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Occupancy grids follow the fields.
    Grids,
    /// Rays are drawn.
    Draw,
    /// Rays are marched, and samples chosen that light reaches.
    Gather,
    /// Votes on m^P, and how mattes agree with masks.
    Vote,
    /// Fields, compositing and losses.
    Forward,
    /// Autodiff's way back.
    Backward,
    /// Optimisers of networks and sharpness.
    Networks,
    /// Optimisers of the hash tables.
    Tables,
    /// A software renderer works off what it was given, on the cores that are the host's too.
    Wait,
}

impl Phase {
    /// All of them, in the order of a step.
    pub const ALL: [Self; 9] = [
        Self::Grids,
        Self::Draw,
        Self::Gather,
        Self::Vote,
        Self::Forward,
        Self::Backward,
        Self::Networks,
        Self::Tables,
        Self::Wait,
    ];
}

/// Adds up the time of each phase over all steps.
#[derive(Clone, Debug)]
pub struct StepClock {
    totals: [Duration; Phase::ALL.len()],
    last: Instant,
}

impl StepClock {
    /// All at zero.
    #[must_use]
    pub fn new() -> Self {
        Self {
            totals: [Duration::ZERO; Phase::ALL.len()],
            last: Instant::now(),
        }
    }

    /// What follows belongs to the next phase that is named.
    pub fn begin(&mut self) {
        self.last = Instant::now();
    }

    /// The time since the last call was spent in `phase`.
    pub fn lap(&mut self, phase: Phase) {
        let now = Instant::now();
        self.totals[phase as usize] += now - self.last;
        self.last = now;
    }

    /// Time spent in a phase so far.
    #[must_use]
    pub fn total(&self, phase: Phase) -> Duration {
        self.totals[phase as usize]
    }
}

impl Default for StepClock {
    fn default() -> Self {
        Self::new()
    }
}
