//! Runs that a table is made of: one that is there is kept, one that was stopped goes on, one that fails is said.

use super::input::{NO_MASKS, Plan, check_free, read_record};
use super::train::train_run;
use super::{SettingArgs, TrainArgs, complain};
use crate::config::{InputRecord, Preset};
use crate::error::{EXIT_OK, InputError, sentence};
use crate::run_folder::RunFolder;
use scene_export::quoted;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A scene's own rough masks, also those that training does not take by itself.
pub(super) fn rough_masks_beside(scene: &Path) -> Option<PathBuf> {
    let folders = ["masks", "coarse_masks"].map(|name| scene.join(name));
    folders.into_iter().find(|dir| dir.is_dir())
}

/// An error where a table is to go into a folder that holds something, but neither an earlier table, which is in the
/// file `json`, nor anything that `belongs` to such a table.
pub(super) fn check_place(
    out: &Path,
    json: &str,
    belongs: impl Fn(&Path) -> bool,
) -> Result<(), InputError> {
    let is_table = |text: String| {
        let table = serde_json::from_str::<serde_json::Value>(&text);
        table.is_ok_and(|table| table.get("rows").is_some())
    };
    if fs::read_to_string(out.join(json)).is_ok_and(is_table) {
        return Ok(());
    }
    let mut entries = fs::read_dir(out).into_iter().flatten().flatten();
    if entries.any(|entry| belongs(&entry.path())) {
        return Ok(());
    }
    check_free(out)
}

/// How far a run has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    Nothing,
    /// A run without anything to go on from.
    Begun,
    /// A run with a checkpoint.
    Saved,
    Finished,
}

impl State {
    /// Of the run in `dir`.
    pub(super) fn of(dir: &Path) -> Self {
        match RunFolder::open_existing(dir) {
            Err(_) => Self::Nothing,
            // The last thing that a run writes.
            Ok(run) if run.report_path().is_file() => Self::Finished,
            Ok(run) if run.has_checkpoint() => Self::Saved,
            Ok(_) => Self::Begun,
        }
    }
}

/// Whether `command`, which names its scene, masks and folder, makes sense, and whether what is in its
/// folder was made by it.
pub(super) fn check(command: &TrainArgs) -> anyhow::Result<()> {
    let plan = Plan::new(command)?;
    let mut wanted = plan.config.clone();
    let (Some(scene), Some(dir)) = (&command.scene, &command.out) else {
        return Ok(());
    };
    if State::of(dir) == State::Nothing {
        return Ok(());
    }
    let path = dir.join("config.toml");
    let (record, _) = read_record(&path)?;
    let given = command.masks.as_deref();
    let masks = given
        .filter(|masks| masks.as_os_str() != NO_MASKS)
        .map(full);
    if let Some(input) = &record.input
        && (&input.scene, &input.masks) != (&full(scene), &masks)
    {
        let masks = match &input.masks {
            Some(masks) => format!(" with the masks in {}", masks.display()),
            None => " without masks".to_owned(),
        };
        return Err(InputError::new(
            dir,
            format!("it is a run of {}{masks}", input.scene.display()),
            "choose another --out",
        )
        .into());
    }
    let input = record.input.as_ref();
    if let Some([there, here]) = input.and_then(|input| difference_of(input, &plan)) {
        return Err(InputError::new(
            dir,
            format!("it was made {there}, not {here}"),
            "choose another --out, or remove it to train it again",
        )
        .into());
    }
    if wanted.steps == 0 {
        // Left open: the run's record has what suited its scene.
        wanted.steps = record.config.steps;
    }
    if let Some(other) = record.config.difference(&wanted)? {
        let [there, here] = other.values;
        return Err(InputError::new(
            dir,
            format!("it was made with {} = {there}, not {here}", other.key),
            "choose another --out, or remove it to train it again",
        )
        .into());
    }
    Ok(())
}

/// What was said about a run's masks and photos, and what is said now, where these are not the same.
fn difference_of(input: &InputRecord, plan: &Plan) -> Option<[String; 2]> {
    if input.polarity != plan.polarity {
        return Some(
            [input.polarity, plan.polarity].map(|polarity| match polarity {
                Some(polarity) => {
                    format!("with --polarity {}", format!("{polarity:?}").to_lowercase())
                }
                None => "without --polarity".to_owned(),
            }),
        );
    }
    let ignore = plan.ignore.as_deref().map(full);
    (input.ignore != ignore).then(|| {
        [&input.ignore, &ignore].map(|folder| match folder {
            Some(folder) => format!("with the ignore pictures in {}", folder.display()),
            None => "without ignore pictures".to_owned(),
        })
    })
}

/// Trains what is missing of the run of `command`, which names its folder; gives the exit code.
pub(super) fn complete(command: TrainArgs) -> anyhow::Result<u8> {
    let state = command.out.as_deref().map_or(State::Nothing, State::of);
    let (code, _) = train_run(&TrainArgs {
        resume: state == State::Saved,
        // A preset and a run to go on with exclude each other.
        preset: command.preset.filter(|_| state != State::Saved),
        force: state == State::Begun,
        ..command
    })?;
    Ok(code)
}

/// How far a table came.
pub(super) enum Made {
    /// All has been tried: what failed last, if anything.
    Tried(anyhow::Result<()>),
    /// One was stopped, with this exit code.
    Stopped(u8),
}

/// Makes each of a table's `parts`; one that fails is said and does not keep the others from being made. `name` gives
/// what a part is called and its folder, `make` its exit code.
pub(super) fn make_all<T>(
    parts: &[T],
    name: impl Fn(&T) -> (String, PathBuf),
    make: impl Fn(&T) -> anyhow::Result<u8>,
) -> Made {
    let mut tried = Ok(());
    for part in parts {
        let (title, folder) = name(part);
        match make(part) {
            Ok(EXIT_OK) => {}
            Ok(code) => {
                let _ = writeln!(
                    std::io::stderr(),
                    "the table is not complete; the same command goes on with {}",
                    quoted(&folder)
                );
                return Made::Stopped(code);
            }
            Err(error) => {
                let error = error.context(format!("{title} failed"));
                complain(&sentence(&error));
                tried = Err(error);
            }
        }
    }
    Made::Tried(tried)
}

/// What all runs of a table are given, in the words of the command line; empty for the defaults.
pub(super) fn words_of(preset: Option<Preset>, settings: &SettingArgs) -> String {
    let mut words = Vec::new();
    let mut say = |option: &str, value: Option<String>| {
        words.extend(value.map(|value| format!("--{option} {value}")));
    };
    say("preset", preset.map(|preset| preset.to_string()));
    say("steps", settings.steps.map(|n| n.to_string()));
    say("downscale", settings.downscale.map(|n| n.to_string()));
    say("seed", settings.seed.map(|n| n.to_string()));
    for setting in &settings.set {
        say("set", Some(setting.clone()));
    }
    words.join(" ")
}

fn full(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::config::{MaskPolarity, RunRecord};
    use std::fs;

    #[test]
    fn a_run_is_kept_only_where_masks_and_photos_are_meant_as_they_were() {
        let dir = tempfile::tempdir().unwrap();
        let [scene, run] = ["scene", "run"].map(|name| dir.path().join(name));
        let [masks, ignore] = ["masks", "ignore"].map(|name| scene.join(name));
        for folder in [&run, &masks] {
            fs::create_dir_all(folder).unwrap();
        }
        let command = TrainArgs {
            scene: Some(scene.clone()),
            masks: Some(masks.clone()),
            out: Some(run.clone()),
            ..TrainArgs::default()
        };
        let made_with = |polarity, ignore: Option<&PathBuf>| {
            let input = InputRecord {
                scene: scene.clone(),
                masks: Some(masks.clone()),
                polarity,
                ignore: ignore.cloned(),
                out: run.clone(),
                demo: false,
                imported_from: None,
                photos: None,
                click: None,
                object_box: None,
            };
            let config = Plan::new(&command).unwrap().config;
            let text = RunRecord::new(config, input).to_toml().unwrap();
            fs::write(run.join("config.toml"), text).unwrap();
        };
        let says = || check(&command).map_err(|error| error.to_string());

        made_with(None, None);
        assert_eq!(says(), Ok(()));
        let black = check(&TrainArgs {
            polarity: Some(MaskPolarity::Black),
            ..command.clone()
        });
        let black = black.unwrap_err().to_string();
        let expected = "it was made without --polarity, not with --polarity black; choose";
        assert!(black.contains(expected), "{black}");
        made_with(Some(MaskPolarity::White), None);
        let white = says().unwrap_err();
        assert!(
            white.contains("made with --polarity white, not without --polarity;"),
            "{white}"
        );

        // The folder is taken where there is one, which the run did not know.
        made_with(None, None);
        fs::create_dir(&ignore).unwrap();
        let added = says().unwrap_err();
        let expected = format!(
            "made without ignore pictures, not with the ignore pictures in {};",
            ignore.display()
        );
        assert!(added.contains(&expected), "{added}");
        made_with(None, Some(&ignore));
        assert_eq!(says(), Ok(()));
        fs::remove_dir(&ignore).unwrap();
        let gone = says().unwrap_err();
        assert!(gone.contains(", not without ignore pictures;"), "{gone}");
    }
}
