//! Everything that decides how a run goes, as one tree of plain values.
//!
//! A configuration comes about in layers, later ones winning:
//! 1. a [`Preset`],
//! 2. a `config.toml`: the one of RUN with `--resume`, another one with `--config`,
//! 3. the command line: `--steps`, `--seed`, `--device`, `--downscale`, then each `--set key=value` in order.
//!
//! Each layer is laid over the one below by [`TrainConfig::with_toml`] or
//! [`TrainConfig::apply_override`]; both know all keys, and answer a misspelt one with the nearest.
//!
//! ```
//! use sos_train::config::{Preset, TrainConfig};
//!
//! let mut config = TrainConfig::preset(Preset::Quick);
//! config.apply_override("loss.mask=0.2")?;
//! assert_eq!(config.loss.mask, 0.2);
//!
//! let error = config.apply_override("loss.masc=0.2").unwrap_err();
//! assert!(error.to_string().contains("loss.mask"));
//! # Ok::<(), sos_train::config::ConfigError>(())
//! ```

mod check;
mod error;
mod overlay;
mod preset;
mod record;
mod sections;

pub use error::ConfigError;
pub use preset::Preset;
pub use record::{InputRecord, MaskPolarity, RunRecord, Versions};
pub use sections::{
    AlphaSource, Blend, CameraRefinement, ColourLoss, ExportConfig, Fields, Interpolation,
    LossConfig, Majority, ModelConfig, PrepareConfig, ProbabilitySource, SamplingConfig,
    ScheduleConfig, Transparency,
};

use serde::{Deserialize, Serialize};

/// Devices by the name a user gives them.
pub const DEVICES: [&str; 6] = ["auto", "cpu", "ndarray", "flex", "wgpu", "cuda"];

/// Steps of a run on next to no pixels, where they are not stated.
const LEAST_STEPS: u32 = 3500;
/// Steps of a run on many pixels.
const MOST_STEPS: u32 = 8000;
/// Pixels that are worth one step more.
const PIXELS_A_STEP: u64 = 2000;

/// The whole configuration of a run. `Default` is [`Preset::Default`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// The preset everything else started from.
    pub preset: Preset,
    /// Training steps in all; 0: by the number of pixels, see [`TrainConfig::settled`].
    pub steps: u32,
    /// Seed of every random draw; a seed and a configuration determine a run.
    pub seed: u64,
    /// One of [`DEVICES`].
    pub device: String,
    /// The two fields and how their colours meet.
    pub model: ModelConfig,
    /// Weights and shapes of the losses.
    pub loss: LossConfig,
    /// What changes in the course of a run.
    pub schedule: ScheduleConfig,
    /// Rays and samples of a step.
    pub sampling: SamplingConfig,
    /// How the object's box is found.
    pub prepare: PrepareConfig,
    /// What is written, and how often.
    pub export: ExportConfig,
}

/// A setting with two values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The key with its section.
    pub key: String,
    /// Its values here and there, as in `config.toml`.
    pub values: [String; 2],
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self::preset(Preset::Default)
    }
}

impl TrainConfig {
    /// The values of a preset.
    #[must_use]
    pub fn preset(preset: Preset) -> Self {
        preset::values(preset)
    }

    /// Lays a `config.toml` over these values; keys it does not name stay. Sections that belong to
    /// [`RunRecord`] are skipped.
    ///
    /// # Errors
    /// [`ConfigError`] for text that is not TOML, an unknown key or a value of the wrong kind.
    pub fn with_toml(&self, text: &str) -> Result<Self, ConfigError> {
        overlay::lay_over(self, record::settings(text)?)
    }

    /// Sets one value from `key=value`, as in `loss.mask=0.2` or `model.alpha=opacity`.
    ///
    /// # Errors
    /// [`ConfigError`] for an unknown key (with the nearest valid one) or a value of the wrong
    /// kind; the configuration is then as before. Ranges, which may depend on several keys, are
    /// left to [`TrainConfig::validate`].
    pub fn apply_override(&mut self, assignment: &str) -> Result<(), ConfigError> {
        *self = overlay::assign(self, assignment)?;
        Ok(())
    }

    /// With the number of steps that suits the scene, where it is left open: a few pixels are learnt
    /// in fewer steps than many (docs/decisions/training.md, "How long to train").
    #[must_use]
    pub fn settled(&self, model: &io_colmap::Model) -> Self {
        let shrink = u64::from(self.prepare.downscale.max(1)).pow(2);
        let pixels: u64 = model
            .views
            .iter()
            .filter_map(|view| model.cameras.get(&view.camera_id))
            .map(|camera| u64::from(camera.width) * u64::from(camera.height) / shrink)
            .sum();
        let more = u32::try_from(pixels / PIXELS_A_STEP).unwrap_or(MOST_STEPS);
        Self {
            steps: match self.steps {
                0 => LEAST_STEPS.saturating_add(more).min(MOST_STEPS),
                stated => stated,
            },
            ..self.clone()
        }
    }

    /// The first setting, by name, whose value is another one in `other`; where both compute is none
    /// of a run's results.
    ///
    /// # Errors
    /// [`ConfigError`] if the values cannot be written down.
    pub fn difference(&self, other: &Self) -> Result<Option<Difference>, ConfigError> {
        let here = Self {
            device: other.device.clone(),
            ..self.clone()
        };
        overlay::difference(&here, other)
    }

    /// Every key that [`TrainConfig::apply_override`] knows, sorted.
    #[must_use]
    pub fn keys() -> Vec<String> {
        overlay::keys(&Self::default())
    }
}
