//! `config.toml` as a run writes it: the configuration, what it was given, what made it.

use super::overlay::{one_line, reworded};
use super::{ConfigError, Preset, TrainConfig};
use crate::discover::hint::{Click, WorldBox};
use io_colmap::IGNORE_FOLDER;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
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
    /// How many photos there are and what the first and the last are called, by which a scene that has moved is known
    /// again; none in a file of a version that did not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photos: Option<String>,
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

    /// Where photos are not to be learned from, of a run whose scene is at `scene` now: the folder that it was given, or,
    /// where that is gone, the copy that an import made beside the photos.
    #[must_use]
    pub fn ignore_beside(&self, scene: &Path) -> Option<PathBuf> {
        let given = self.ignore.as_ref()?;
        let copy = scene.join(IGNORE_FOLDER);
        let is_moved = !given.exists() && copy.is_dir();
        Some(if is_moved { copy } else { given.clone() })
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

    /// The version that a `config.toml` is of, where it says so and it is not this one, whatever else is in it.
    pub(crate) fn other_in(text: &str) -> Option<String> {
        let table: Table = text.parse().ok()?;
        let sos = table.get(VERSIONS)?.get("sos")?.as_str()?;
        (sos != Self::current().sos).then(|| sos.to_owned())
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
        Self::parsed(text).map_err(|error| {
            let error = in_line(error, text);
            match Versions::other_in(text) {
                Some(written_by) => ConfigError::OtherVersion {
                    written_by,
                    error: Box::new(error),
                },
                None => error,
            }
        })
    }

    /// The settings that a file's text lacks, which are those of its preset today.
    pub(crate) fn left_open(text: &str) -> Vec<String> {
        let stated = settings(text).unwrap_or_default();
        let is_open = |key: &String| match key.split_once('.') {
            Some((section, name)) => stated
                .get(section)
                .is_none_or(|section| section.get(name).is_none()),
            None => !stated.contains_key(key),
        };
        TrainConfig::keys().into_iter().filter(is_open).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_in_a_file_of_another_version_name_both() {
        let of = |body: &str| format!("{body}\n[versions]\nsos = \"9.9.9\"\nplatform = \"x\"\n");
        let says = |text: &str| match RunRecord::from_toml(text) {
            Err(error) => error.to_string(),
            Ok(_) => String::new(),
        };
        for (body, key) in [
            ("[loss]\nfuture = 1", "\"loss.future\""),
            (
                "[input]\nscene = \"a\"\nout = \"b\"\nfuture = 1",
                "unknown field `future`",
            ),
        ] {
            let text = says(&of(body));
            for part in [key, "sos 9.9.9", env!("CARGO_PKG_VERSION"), "start again"] {
                assert!(text.contains(part), "{text}");
            }
            assert!(!says(body).contains("written by"), "{}", says(body));
        }
        let here = of("steps = maybe").replace("9.9.9", env!("CARGO_PKG_VERSION"));
        assert_eq!(Versions::other_in(&here), None);
        assert_eq!(
            Versions::other_in(&of("steps = 1")).as_deref(),
            Some("9.9.9")
        );
    }

    #[test]
    fn settings_that_a_file_lacks_are_known() {
        let mut all = written(&TrainConfig::default()).unwrap_or_default();
        assert_eq!(RunRecord::left_open(&all), [""; 0]);
        all = all.replace("huber_delta = ", "# ");
        all = all.replace("seed = ", "# ");
        assert_eq!(RunRecord::left_open(&all), ["loss.huber_delta", "seed"]);
    }
}
