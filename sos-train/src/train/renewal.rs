//! Occupancy follows the fields: some cells are asked about every few steps.

use std::sync::Arc;

use super::grids::{FieldGrids, GridRule};
use super::step::StepSchedule;
use super::visible::FrozenFields;
use super::{Trainer, schedule};
use crate::config::Fields;

/// Share of a run after which occupied space changes slowly.
const SETTLED: f32 = 0.5;

/// What grids are to learn of the fields.
struct Renewal {
    fields: FrozenFields,
    /// Of FoCoR and BaCo, where they are asked.
    object: Option<GridRule>,
    background: Option<GridRule>,
    seed: u64,
    /// The number of the update.
    round: u32,
}

impl Renewal {
    fn apply(&self, grids: &mut FieldGrids) {
        let (fields, seed, round) = (&self.fields, self.seed, self.round);
        if let Some(rule) = self.object {
            grids.update_object(&fields.object, rule, seed, round);
        }
        if let Some(rule) = self.background {
            grids.update_background(&fields.background, rule, seed, round);
        }
    }
}

impl Trainer {
    /// Renews occupancy, if the fields have something to say. On a GPU what was asked of them at the last renewal is taken,
    /// and the next one is sent for.
    pub(super) fn update_grids(&mut self, schedule: StepSchedule) {
        // For the first steps the fields say nothing yet: everything stays occupied.
        let warm = (0.04 * self.config().steps as f32).max(64.0) as u32;
        if self.step < warm {
            return;
        }
        let fields = self.look_ahead(schedule);
        let config = self.config();
        let settled = schedule::progress(config, self.step) > SETTLED;
        let rule = |transparency, sharpness| GridRule {
            transparency,
            sharpness,
            settled,
        };
        let [b_object, b_background] = fields.sharpness;
        // What is not trained yet says nothing: until it is carved out, FoCoR may be anywhere.
        let object = !schedule::background_alone(config, self.step);
        let background = config.model.fields != Fields::Object;
        let renewal = Renewal {
            object: object.then(|| rule(config.model.foreground, b_object)),
            background: background.then(|| rule(config.model.background, b_background)),
            seed: config.seed,
            round: self.step / config.sampling.occupancy_every.max(1),
            fields,
        };
        if !self.outlook.is_afar() {
            return renewal.apply(Arc::make_mut(&mut self.grids));
        }
        if let Some(renewed) = self.ahead.take_grids() {
            self.grids = renewed;
        }
        let grids = self.grids.clone();
        self.ahead.renew(grids, move |grids| renewal.apply(grids));
    }
}
