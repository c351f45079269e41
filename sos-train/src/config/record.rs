//! `config.toml` as a run writes it: the configuration, what it was given, what made it.

use super::overlay::{one_line, reworded};
use super::{ConfigError, Preset, TrainConfig};
use crate::discover::hint::{Click, WorldBox};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use toml::{Table, Value};

/// Sections of the file that are not settings.
const INPUT: &str = "input";
const VERSIONS: &str = "versions";

const HEADER: &str = "\
# Everything needed to repeat this run: sos train --config THIS_FILE --out NEW_FOLDER
";

/// Which colour of a mask means the object, as a user states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum MaskPolarity {
    /// White is the object.
    White,
    /// Black is the object.
    Black,
}

impl From<MaskPolarity> for io_colmap::Polarity {
    fn from(polarity: MaskPolarity) -> Self {
        match polarity {
            MaskPolarity::White => Self::WhiteIsObject,
            MaskPolarity::Black => Self::BlackIsObject,
        }
    }
}

/// What a run was given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputRecord {
    /// The scene's folder, absolute.
    pub scene: PathBuf,
    /// The folder of coarse masks, absolute; none for a run without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masks: Option<PathBuf>,
    /// Polarity as stated by the user; none where it was detected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polarity: Option<MaskPolarity>,
    /// The folder of what is not to be learned from, absolute.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ignore: Option<PathBuf>,
    /// The run's own folder, absolute.
    pub out: PathBuf,
    /// Whether the scene is the built-in demo, which the run generated itself.
    #[serde(default)]
    pub demo: bool,
    /// The folder or file that the run turned into its scene, absolute; none where it was used as
    /// it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported_from: Option<PathBuf>,
    /// A pixel that shows the object, for a run without masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub click: Option<Click>,
    /// A box around the object, for a run without masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_box: Option<WorldBox>,
}

impl InputRecord {
    /// Whether the scene lies in the run's own folder.
    #[must_use]
    pub fn owns_scene(&self) -> bool {
        self.demo || self.imported_from.is_some()
    }
}

/// What made a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// Version of this program.
    pub sos: String,
    /// Operating system and processor.
    pub platform: String,
}

impl Versions {
    /// Of the program that is running.
    #[must_use]
    pub fn current() -> Self {
        Self {
            sos: env!("CARGO_PKG_VERSION").to_owned(),
            platform: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        }
    }
}

/// The content of a run's `config.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecord {
    /// All settings.
    pub config: TrainConfig,
    /// What the run was given; none in a file written by hand.
    pub input: Option<InputRecord>,
    /// What made the run; none in a file written by hand.
    pub versions: Option<Versions>,
}

impl RunRecord {
    /// The record of a run that this program starts.
    #[must_use]
    pub fn new(config: TrainConfig, input: InputRecord) -> Self {
        Self {
            config,
            input: Some(input),
            versions: Some(Versions::current()),
        }
    }

    /// The file's text.
    ///
    /// # Errors
    /// [`ConfigError::Syntax`] if a path is not Unicode, which TOML cannot hold.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        let mut text = format!("{HEADER}{}", written(&self.config)?);
        if let Some(input) = &self.input {
            text.push_str(&format!(
                "\n{}",
                written(&BTreeMap::from([(INPUT, input)]))?
            ));
        }
        if let Some(versions) = &self.versions {
            text.push_str(&format!(
                "\n{}",
                written(&BTreeMap::from([(VERSIONS, versions)]))?
            ));
        }
        Ok(text)
    }

    /// Reads a file's text. Settings it lacks are those of its preset.
    ///
    /// # Errors
    /// [`ConfigError`] for text that is not TOML, unknown keys, and values of the wrong kind or out
    /// of range, with the line where the text has one.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        Self::parsed(text).map_err(|error| in_line(error, text))
    }

    fn parsed(text: &str) -> Result<Self, ConfigError> {
        let mut table = parse(text)?;
        let preset = match table.get("preset") {
            Some(value) => section::<Preset>("preset", value.clone())?,
            None => Preset::default(),
        };
        let input = table
            .remove(INPUT)
            .map(|value| section(INPUT, value))
            .transpose()?;
        let versions = table
            .remove(VERSIONS)
            .map(|value| section(VERSIONS, value))
            .transpose()?;
        let config = super::overlay::lay_over(&TrainConfig::preset(preset), table)?;
        config.validate()?;
        Ok(Self {
            config,
            input,
            versions,
        })
    }
}

/// The settings in a file's text, without the other sections.
pub(super) fn settings(text: &str) -> Result<Table, ConfigError> {
    let mut table = parse(text)?;
    table.remove(INPUT);
    table.remove(VERSIONS);
    Ok(table)
}

fn parse(text: &str) -> Result<Table, ConfigError> {
    text.parse::<Table>().map_err(|e| {
        let line = e.span().map_or(0, |span| {
            text.get(..span.start).unwrap_or(text).matches('\n').count() + 1
        });
        ConfigError::Syntax {
            reason: format!("line {line}: {}", one_line(e.message())),
        }
    })
}

/// Says in which line the key stands that an error is about; a value may also come from a preset.
fn in_line(error: ConfigError, text: &str) -> ConfigError {
    let line = match &error {
        ConfigError::UnknownKey { key, .. } | ConfigError::Value { key, .. } => line_of(key, text),
        _ => None,
    };
    match line {
        Some(line) => ConfigError::Line {
            line,
            error: Box::new(error),
        },
        None => error,
    }
}

/// The number of the line that sets a key, or begins a section of that name.
fn line_of(key: &str, text: &str) -> Option<usize> {
    let mut section = "";
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        let full = if let Some(head) = line.strip_prefix('[') {
            section = head.split(']').next().unwrap_or_default().trim();
            section.to_owned()
        } else {
            let name = line.split('=').next().unwrap_or_default();
            let name = name.trim().trim_matches('"');
            if section.is_empty() {
                name.to_owned()
            } else {
                format!("{section}.{name}")
            }
        };
        if full == key {
            return Some(number);
        }
    }
    None
}

fn section<T: serde::de::DeserializeOwned>(key: &str, value: Value) -> Result<T, ConfigError> {
    let shown = match &value {
        Value::Table(_) => "[…]".to_owned(),
        plain => plain.to_string(),
    };
    value
        .try_into()
        .map_err(|e: toml::de::Error| ConfigError::Value {
            key: key.to_owned(),
            value: shown,
            reason: reworded(&one_line(e.message())),
        })
}

fn written(value: &impl Serialize) -> Result<String, ConfigError> {
    toml::to_string(value).map_err(|e| ConfigError::Syntax {
        reason: one_line(e.to_string()),
    })
}
