//! What a training step knows of fields that are learnt elsewhere.
//!
//! Which samples light reaches is asked on the CPU, also while a GPU trains: of a copy of both fields that
//! is some steps old. The next batch is gathered while the GPU works on this one, and no step waits for what it is asked:
//! copy and losses are sent for every so many steps and taken when the next ones are, by which time they are long
//! there. Occupancy, which follows the same copy, changes no faster.

use burn::Tensor;
use burn::tensor::Device;
use scene_decomp::FrozenSurface;

use super::Trainer;
use super::courier::{Courier, Parcel};
use super::ledger::{Batch, Ledger, StepLosses};
use super::step::StepSchedule;
use super::visible::FrozenFields;
use crate::config::Transparency;

/// Steps of a GPU between two looks at what it has learnt and at its losses; what is known is from one to two
/// times as old.
const LAG: u32 = 16;

/// The least share of samples in clear space that has to be learnt from for all of them to be written down.
const LEAST_TAPED: f32 = 0.5;

/// The fields as they were, and the losses since.
pub(super) struct Outlook {
    /// Where the fields are learnt on a GPU. On the CPU looking costs nothing.
    afar: Option<Afar>,
    /// As far as they have been read.
    losses: StepLosses,
}

/// Fields, and losses, on their way from a GPU.
struct Afar {
    courier: Courier,
    /// As they arrived last.
    fields: Option<FrozenFields>,
    /// The step at which they were last looked at.
    looked: Option<u32>,
    coming: Option<Parcel<FrozenFields>>,
    unread: Vec<Ledger>,
    losses_coming: Option<Parcel<StepLosses>>,
}

/// Both fields where they are learnt.
pub(super) struct Snapshot {
    object: FrozenSurface,
    background: FrozenSurface,
    /// `b` of both, `[2]`.
    sharpness: Tensor<1>,
    view_share: f32,
}

impl Snapshot {
    /// The same for looking alone: [`FrozenSurface::without_features`].
    fn without_features(self) -> Self {
        Self {
            object: self.object.without_features(),
            background: self.background.without_features(),
            ..self
        }
    }

    /// With numbers for what its user computes with. Waits for the device.
    fn read(self) -> FrozenFields {
        FrozenFields {
            object: self.object,
            background: self.background,
            sharpness: pair(self.sharpness),
            view_share: self.view_share,
            taped: [false; 2],
        }
    }

    /// All of it on the CPU. Waits for the device.
    fn fetch(self) -> FrozenFields {
        self.read().to_device(&Device::flex())
    }
}

impl Afar {
    fn new() -> Self {
        Self {
            courier: Courier::new(),
            fields: None,
            looked: None,
            coming: None,
            unread: Vec::new(),
            losses_coming: None,
        }
    }

    /// What is known at `step`, unless it is time to look again.
    fn known(&self, step: u32) -> Option<&FrozenFields> {
        let due = step.is_multiple_of(LAG) && self.looked != Some(step);
        self.fields.as_ref().filter(|_| !due)
    }

    /// Sends for the fields as they are `now`. Returns those that it sent for the last time; where there are none
    /// yet, it waits for these.
    fn look(&mut self, step: u32, now: Snapshot) -> FrozenFields {
        self.looked = Some(step);
        let arrived = match (self.coming.take(), &self.fields) {
            (Some(fields), _) => fields.open(),
            (None, Some(known)) => known.clone(),
            (None, None) => return self.fields.insert(now.fetch()).clone(),
        };
        self.coming = Some(self.courier.send(move || now.fetch()));
        self.fields.insert(arrived).clone()
    }

    /// Sends for the losses since the last time. Returns those that it was sent for then, if any.
    fn swap_losses(&mut self) -> Option<StepLosses> {
        let arrived = self.losses_coming.take().map(Parcel::open);
        if !self.unread.is_empty() {
            let losses = Batch::of(std::mem::take(&mut self.unread));
            self.losses_coming = Some(self.courier.send(move || losses.mean()));
        }
        arrived
    }
}

impl Outlook {
    /// Of fields on the CPU, or on a GPU.
    pub(super) fn new(is_cpu: bool) -> Self {
        Self {
            afar: (!is_cpu).then(Afar::new),
            losses: StepLosses::default(),
        }
    }

    /// Whether the fields are learnt on a GPU.
    pub(super) fn is_afar(&self) -> bool {
        self.afar.is_some()
    }

    /// What was seen of other fields than those of now.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.afar.is_none());
    }

    /// What is known of the fields at `step`, on the CPU, unless it is time to [`look`](Self::look) again.
    pub(super) fn known(&self, step: u32) -> Option<FrozenFields> {
        self.afar.as_ref()?.known(step).cloned()
    }

    /// Looks at the fields as they are `now`, at `step`. Returns what is known of them then.
    pub(super) fn look(&mut self, step: u32, now: Snapshot) -> FrozenFields {
        match &mut self.afar {
            Some(afar) => afar.look(step, now),
            // For this step alone: to hold them longer would have the optimiser copy them.
            None => now.read(),
        }
    }

    /// Takes the losses of a step, of which `steps` are done with it; waits for the device at the first one, and
    /// where they are `wanted`. Returns what is known: the mean over some steps.
    pub(super) fn losses(&mut self, ledger: Ledger, steps: u32, wanted: bool) -> StepLosses {
        let Some(afar) = &mut self.afar else {
            self.losses = ledger.read();
            return self.losses;
        };
        afar.unread.push(ledger);
        if wanted || self.losses == StepLosses::default() {
            return self.settle();
        }
        if steps.is_multiple_of(LAG)
            && let Some(losses) = afar.swap_losses()
        {
            self.losses = losses;
        }
        self.losses
    }

    /// Waits for all losses. Returns what is known then.
    pub(super) fn settle(&mut self) -> StepLosses {
        if let Some(afar) = &mut self.afar {
            // Those on their way, then those since.
            for _ in 0..2 {
                if let Some(losses) = afar.swap_losses() {
                    self.losses = losses;
                }
            }
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
        self.snapshot(schedule).read()
    }

    /// The same on the CPU, for whoever asks from many threads about a few points each: a GPU's fields are copied.
    pub(super) fn fetch_fields(&self, schedule: StepSchedule) -> FrozenFields {
        let now = self.snapshot(schedule);
        if self.outlook.is_afar() {
            now.fetch()
        } else {
            now.read()
        }
    }

    fn snapshot(&self, schedule: StepSchedule) -> Snapshot {
        Snapshot {
            object: self.freeze_object(schedule.active_levels),
            background: self.freeze_background(schedule.background_levels),
            sharpness: self.sharpness.b().detach(),
            view_share: schedule.view_share,
        }
    }

    /// `b` of FoCoR and BaCo. Waits for the device.
    #[must_use]
    pub fn sharpness(&self) -> [f32; 2] {
        pair(self.sharpness.b())
    }

    /// The fields' geometry for looking ahead in the step that `schedule` is of, on the CPU: a GPU's as it was some steps ago.
    pub(super) fn look_ahead(&mut self, schedule: StepSchedule) -> FrozenFields {
        if let Some(fields) = self.outlook.known(schedule.step) {
            return fields;
        }
        let now = self.snapshot(schedule).without_features();
        self.outlook.look(schedule.step, now)
    }

    /// The same for a step that learns from what it looks at, which is written down on the CPU: but for samples of
    /// which only a few representatives are learnt from, as backward goes through all that is.
    pub(super) fn look_to_learn(&mut self, schedule: StepSchedule) -> FrozenFields {
        if self.outlook.is_afar() {
            return self.look_ahead(schedule);
        }
        let config = &self.context.config;
        let thinned = config.sampling.clear_share < LEAST_TAPED;
        let drawn = config.model.background == Transparency::Density;
        let mut fields = self.freeze_fields(schedule);
        fields.taped = [!thinned, !thinned && !drawn];
        let [object, background] = fields.taped;
        if !object {
            fields.object = fields.object.without_features();
        }
        if !background {
            fields.background = fields.background.without_features();
        }
        fields
    }

    /// Waits until the device has done all steps. Returns the mean losses since somebody last asked.
    pub fn settle(&mut self) -> StepLosses {
        self.outlook.settle()
    }
}

/// A tensor's two values. Waits for the device.
fn pair(tensor: Tensor<1>) -> [f32; 2] {
    let values = tensor.into_data();
    let mut values = values.iter::<f32>();
    [(); 2].map(|()| values.next().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hashgrid::{GridConfig, GridLayout};
    use scene_decomp::{InitialShape, Surface, SurfaceConfig};

    use super::*;

    /// Fields that are told apart by their `b`.
    fn fields(b: f32) -> Snapshot {
        let device = Device::flex();
        let grid = GridConfig {
            levels: 2,
            log2_table_size: 8,
            ..GridConfig::default()
        };
        let config = SurfaceConfig {
            grid: grid.clone(),
            hidden: 8,
            features: 2,
            extra: 0,
            direction_degree: 0,
            outputs: 3,
            half_side: 1.0,
            beta: 100.0,
            initial: InitialShape::Ball(0.5),
        };
        let layout = Arc::new(GridLayout::new(&grid));
        let surface = FrozenSurface::new(&Surface::new(&config, 1, &device), &layout, 2);
        Snapshot {
            object: surface.clone(),
            background: surface,
            sharpness: Tensor::from_floats([b, b], &device),
            view_share: 1.0,
        }
    }

    fn ledger(total: f32) -> Ledger {
        let mut ledger = Ledger::default();
        let loss = Tensor::from_floats([total], &Device::flex().autodiff());
        ledger.note(&loss, |losses| &mut losses.total);
        ledger
    }

    #[test]
    fn on_the_cpu_everything_is_of_this_step() {
        let mut outlook = Outlook::new(true);
        for step in 0..2 * LAG {
            assert!(outlook.known(step).is_none());
            let now = step as f32;
            assert_eq!(outlook.look(step, fields(now)).sharpness, [now; 2]);
            assert_eq!(outlook.losses(ledger(now), step + 1, false).total, now);
        }
    }

    #[test]
    fn a_gpus_fields_are_those_of_the_look_before() {
        let mut outlook = Outlook::new(false);
        let mut seen = Vec::new();
        for step in 5..4 * LAG {
            // A step may ask more than once.
            for _ in 0..2 {
                let known = outlook.known(step);
                let known = known.unwrap_or_else(|| outlook.look(step, fields(step as f32)));
                seen.push((step, known.sharpness[0]));
            }
        }
        for (step, b) in seen {
            // Of the first step until there is a look that has come back.
            let expected = match step / LAG {
                0 | 1 => 5.0,
                looks => (looks - 1) as f32 * LAG as f32,
            };
            assert_eq!(b, expected, "at step {step}");
        }
    }

    #[test]
    fn what_is_forgotten_is_looked_at_at_once() {
        let mut outlook = Outlook::new(false);
        outlook.look(3, fields(3.0));
        outlook.forget();
        assert!(outlook.known(3).is_none());
        assert_eq!(outlook.look(3, fields(4.0)).sharpness, [4.0; 2]);
    }

    #[test]
    fn a_gpus_losses_are_the_mean_of_those_before_the_last_look() {
        let mut outlook = Outlook::new(false);
        // The first are waited for: something has to be said.
        assert_eq!(outlook.losses(ledger(9.0), 1, false).total, 9.0);
        for step in 2..2 * LAG {
            let expected = 9.0;
            assert_eq!(outlook.losses(ledger(1.0), step, false).total, expected);
        }
        // Of steps 2 to 16; those up to 32 are on their way.
        assert_eq!(outlook.losses(ledger(33.0), 2 * LAG, false).total, 1.0);
        assert_eq!(outlook.settle().total, 3.0);
        // Wanted ones are waited for, with those since.
        assert_eq!(outlook.losses(ledger(7.0), 2 * LAG + 1, true).total, 7.0);
    }
}
