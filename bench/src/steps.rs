//! Training steps as a run does them.

use std::collections::BTreeMap;

use anyhow::Result;
use demo_scene::DemoConfig;
use serde::Serialize;
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::Prepared;
use sos_train::train::{Trainer, schedule};

use crate::phases::Marks;
use crate::scene::prepared;

/// What is known of a kind of step.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct StepFigures {
    /// Samples that were learnt from.
    pub(crate) trained_samples_per_s: f64,
    pub(crate) samples_per_step: f64,
    /// The median.
    pub(crate) step_ms: f64,
    /// Means.
    pub(crate) phase_ms: BTreeMap<String, f64>,
    pub(crate) phase_share: BTreeMap<String, f64>,
    /// Share of optimisers and bookkeeping.
    pub(crate) overhead_share: f64,
}

/// A short run of a preset: BaCo alone, then both fields.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PresetSteps {
    pub(crate) preset: Preset,
    /// Before FoCoR is carved out; none where it is there from the start.
    pub(crate) background_alone: Option<StepFigures>,
    /// Afterwards.
    pub(crate) both_fields: StepFigures,
}

/// Steps at the beginning of either half that are not measured.
const SETTLING: u32 = 40;

/// Trains `steps` steps of `preset` on the demo scene.
pub(crate) fn measure(preset: Preset, steps: u32, device: &str) -> Result<PresetSteps> {
    let mut config = TrainConfig::preset(preset);
    config.steps = steps;
    config.device = device.to_owned();
    let data = prepared(&DemoConfig::default(), &config)?;
    let mut trainer = Trainer::new(&config, &data)?;
    let carve = schedule::carve_step(&config);
    let background_alone = (carve > 0)
        .then(|| until(&mut trainer, &data, carve))
        .transpose()?;
    let both_fields = until(&mut trainer, &data, steps)?;
    Ok(PresetSteps {
        preset,
        background_alone,
        both_fields,
    })
}

/// Trains up to `end` and measures all but the first steps. Samples of both fields count.
///
/// # Errors
/// Where only those are left, or a loss is no number.
fn until(trainer: &mut Trainer, data: &Prepared, end: u32) -> Result<StepFigures> {
    let begin = trainer.step_number();
    anyhow::ensure!(
        end > begin + SETTLING,
        "{} steps of a part of training are too few, as the first {SETTLING} are not measured; raise --default-steps",
        end - begin
    );
    let mut marks = Marks::begin(trainer);
    while trainer.step_number() < end {
        if trainer.step_number() == begin + SETTLING {
            trainer.settle();
            marks = Marks::begin(trainer);
        }
        let report = trainer.step(data);
        anyhow::ensure!(report.is_finite(), "a loss is no number");
        if trainer.step_number() == end {
            trainer.settle();
        }
        marks.step_done(report.object_samples + report.background_samples);
    }
    Ok(marks.figures(trainer))
}
