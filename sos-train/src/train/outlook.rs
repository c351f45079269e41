//! What a training step knows of fields that are learnt elsewhere.
//!
//! Which samples light reaches is asked on the CPU, also while a GPU trains: of a copy of both fields that
//! is some steps old. The next batch is gathered while the GPU works on this one, and nobody waits for
//! the other but when the copy is made. Occupancy, which follows the same copy, changes no faster.

use burn::tensor::Device;
use scene_decomp::FrozenSurface;

use super::Trainer;
use super::ledger::Ledger;
use super::step::{StepLosses, StepSchedule};
use super::visible::FrozenFields;

/// Steps of a GPU between two looks at what it has learnt and at its losses.
const LAG: u32 = 16;

/// The fields as they were, and the losses since.
pub(super) struct Outlook {
    lag: u32,
    /// The fields, and the step at which they were.
    fields: Option<(u32, FrozenFields)>,
    unread: Vec<Ledger>,
    /// As far as they have been read.
    losses: StepLosses,
}

impl Outlook {
    /// Of fields on the CPU, where looking costs nothing, or on a GPU.
    pub(super) fn new(is_cpu: bool) -> Self {
        Self {
            lag: if is_cpu { 1 } else { LAG },
            fields: None,
            unread: Vec::new(),
            losses: StepLosses::default(),
        }
    }

    /// What was seen of other fields than those of now.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.lag == 1);
    }

    /// What was seen of the fields, unless it is time at `step` to [`see`](Self::see) them again.
    pub(super) fn fields(&self, step: u32) -> Option<FrozenFields> {
        let fresh = |at: u32| at == step || !step.is_multiple_of(self.lag);
        let seen = self.fields.as_ref().filter(|(at, _)| fresh(*at));
        seen.map(|(_, fields)| fields.clone())
    }

    /// The fields as they are at `step`, as somebody sees them on the CPU.
    pub(super) fn see(&mut self, step: u32, fields: FrozenFields) -> FrozenFields {
        if self.lag == 1 {
            // They are there already; to hold them longer would have the optimiser copy them.
            return fields;
        }
        let fields = fields.to_device(&Device::flex());
        self.fields = Some((step, fields.clone()));
        fields
    }

    /// Takes the losses of a step, of which `steps` are done with it; waits for the device where it is time
    /// to look, or `wanted`. Returns what is known: the mean since the last look.
    pub(super) fn losses(&mut self, ledger: Ledger, steps: u32, wanted: bool) -> StepLosses {
        let first = self.losses == StepLosses::default();
        self.unread.push(ledger);
        if first || wanted || steps.is_multiple_of(self.lag) {
            self.settle();
        }
        self.losses
    }

    /// Waits for all losses. Returns what is known then.
    pub(super) fn settle(&mut self) -> StepLosses {
        if !self.unread.is_empty() {
            self.losses = Ledger::read_mean(std::mem::take(&mut self.unread));
        }
        self.losses
    }
}

impl Trainer {
    /// FoCoR without gradients, at the current number of levels.
    #[must_use]
    pub fn freeze_object(&self, active_levels: usize) -> FrozenSurface {
        FrozenSurface::new(
            &self.scene.object,
            &self.context.object_layout,
            active_levels,
        )
    }

    /// BaCo without gradients, at the current number of levels.
    #[must_use]
    pub fn freeze_background(&self, active_levels: usize) -> FrozenSurface {
        FrozenSurface::new(
            &self.scene.background,
            &self.context.background_layout,
            active_levels,
        )
    }

    /// Both fields without gradients, at the current number of levels.
    #[must_use]
    pub fn freeze_fields(&self, schedule: StepSchedule) -> FrozenFields {
        FrozenFields {
            object: self.freeze_object(schedule.active_levels),
            background: self.freeze_background(schedule.background_levels),
            sharpness: self.sharpness(),
            view_share: schedule.view_share,
        }
    }

    /// The fields' geometry for looking ahead, on the CPU: on a GPU's it may be some steps old.
    pub(super) fn look_ahead(&mut self, schedule: StepSchedule) -> FrozenFields {
        if let Some(fields) = self.outlook.fields(self.step) {
            return fields;
        }
        let now = self.freeze_fields(schedule).without_features();
        self.outlook.see(self.step, now)
    }

    /// Waits until the device has done all steps. Returns the mean losses since somebody last asked.
    pub fn settle(&mut self) -> StepLosses {
        self.outlook.settle()
    }
}
