//! A run that goes on: whether it is the one that was meant, and of this version.

use super::input::Plan;
use super::program;
use crate::config::{InputRecord, RunRecord, Versions};
use crate::error::InputError;
use crate::prepare::error::PrepareError;
use crate::run_folder::RunFolder;
use crate::train::checkpoint::step_of;
use io_colmap::Model;
use scene_export::quoted;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// What a run goes on from.
#[derive(Debug, Clone)]
pub(super) struct Resumed {
    /// The text of its record.
    pub(super) record: String,
    /// The step of its checkpoint.
    pub(super) step: u32,
}

/// What the run in `out` was given, where SCENE is stated beside `--resume`: it must be what the run was made from.
/// One that has moved is taken from where it is stated to be; its photos are compared later.
///
/// # Errors
/// [`InputError`] where SCENE is another one.
pub(super) fn going_on(
    input: InputRecord,
    stated: &Path,
    out: &Path,
) -> Result<InputRecord, InputError> {
    let own = input.owns_scene().then(|| RunFolder::scene_in(out));
    let recorded = input.imported_from.as_ref().unwrap_or(&input.scene);
    let given = resolved(stated);
    let is_given = |path: &PathBuf| resolved(path) == given;
    if is_given(recorded) || is_given(&input.scene) || own.as_ref().is_some_and(is_given) {
        return Ok(input);
    }
    if !input.owns_scene() && !recorded.exists() {
        return Ok(moved(&input, &given));
    }
    let made_from = if input.demo {
        "the built-in demo".to_owned()
    } else {
        recorded.display().to_string()
    };
    Err(InputError::new(
        out,
        format!("it is a run of {made_from}, not of {}", stated.display()),
        "leave SCENE out to go on with it, or choose another folder with --out",
    ))
}

/// An error where a run at `step` has done more than the `steps` that it is to have, by the command line if they are
/// `stated` there, else by its record.
pub(super) fn check_steps(
    steps: u32,
    step: u32,
    stated: bool,
    out: &Path,
) -> Result<(), InputError> {
    if steps >= step {
        return Ok(());
    }
    let by = if stated {
        "the command line says"
    } else {
        "its config.toml has steps ="
    };
    Err(InputError::new(
        out,
        format!("this run is at step {step} already, and {by} {steps}"),
        format!("make it {step} to have its results drawn again, or more to train on"),
    ))
}

/// An error where what a run was made from has gone.
pub(super) fn still_there(input: &InputRecord, out: &Path) -> Result<(), InputError> {
    if input.demo || input.scene.exists() {
        return Ok(());
    }
    let remedy = if input.owns_scene() {
        "put it back, or start again with SCENE and --force".to_owned()
    } else {
        format!(
            "put it back, or say where it is now: {} train SCENE --resume --out {}",
            program(),
            quoted(out)
        )
    };
    let what = "the scene of this run is not there";
    Err(InputError::new(&input.scene, what, remedy))
}

/// What a run was given, with the scene that it imported where that is now: in the run's own folder, which may have
/// been moved or copied. `config` is the file that says it, `out` the folder that is to be trained into.
pub(super) fn at_home(input: InputRecord, config: &Path, out: &Path) -> InputRecord {
    let Some(run) = config.parent().filter(|_| input.imported_from.is_some()) else {
        return input;
    };
    let own = RunFolder::scene_in(run);
    let (is_here, is_gone) = (own.is_dir(), !input.scene.exists());
    // A file may be a copy in some other folder, beside a scene that it is not about.
    let is_of_out = resolved_folder(run) == resolved_folder(out);
    let mut found = if is_of_out && (is_here || is_gone) || is_here && is_gone {
        moved(&input, &own)
    } else {
        input
    };
    found.ignore = found.ignore_beside(&found.scene);
    found
}

/// Whether `scene` is the one in the folder of the run at `out`.
pub(super) fn is_own_scene(scene: &Path, out: &Path) -> bool {
    resolved(scene) == resolved(&RunFolder::scene_in(out))
}

/// The same of the folder that a file is in, which is nothing where the file's path is its name alone.
fn resolved_folder(folder: &Path) -> PathBuf {
    if folder.as_os_str().is_empty() {
        resolved(Path::new("."))
    } else {
        resolved(folder)
    }
}

fn resolved(path: &Path) -> PathBuf {
    let full = fs::canonicalize(path).or_else(|_| std::path::absolute(path));
    full.unwrap_or_else(|_| path.to_path_buf())
}

/// What was given, with the scene in `place`, and with it what lay in the scene.
fn moved(input: &InputRecord, place: &Path) -> InputRecord {
    let follow = |path: &PathBuf| match path.strip_prefix(&input.scene) {
        Ok(below) => place.join(below),
        Err(_) => path.clone(),
    };
    InputRecord {
        scene: place.to_path_buf(),
        masks: input.masks.as_ref().map(follow),
        ignore: input.ignore.as_ref().map(follow),
        ..input.clone()
    }
}

/// What is recorded of a scene's photos.
pub(super) fn photos_of(model: &Model) -> String {
    let names = || model.views.iter().map(|view| view.name.as_str());
    format!(
        "{}, {} to {}",
        names().count(),
        names().min().unwrap_or_default(),
        names().max().unwrap_or_default()
    )
}

/// An error where the run was made from other photos than those in `scene`.
pub(super) fn check_photos(plan: &Plan, scene: &Path, model: &Model) -> Result<(), InputError> {
    let found = photos_of(model);
    match &plan.photos {
        Some(photos) if *photos != found => Err(InputError::new(
            scene,
            format!(
                "its photos ({found}) are not those of the run in {} ({photos})",
                plan.out.display()
            ),
            "give the scene that the run was made from, or start again with --force",
        )),
        _ => Ok(()),
    }
}

/// What to say of settings in the file at `path` with this text, if another version wrote it.
pub(super) fn other_version(path: &Path, text: &str) -> Option<String> {
    let written_by = Versions::other_in(text)?;
    let open = RunRecord::left_open(text);
    let open = match open.len() {
        0 => "its settings may mean something else".to_owned(),
        _ => format!(
            "what it does not state is as this version has it: {}",
            open.join(", ")
        ),
    };
    Some(format!(
        "{} was written by sos {written_by}, and this is sos {}; {open}",
        path.display(),
        Versions::current().sos
    ))
}

/// Names the version that made a run, if it is another one, with an error about the run's checkpoint.
pub(super) fn explain(run: &RunFolder, error: anyhow::Error) -> anyhow::Error {
    if !is_of_checkpoint(&error) {
        return error;
    }
    let text = fs::read_to_string(run.config_path()).unwrap_or_default();
    match Versions::other_in(&text) {
        Some(made_by) => error.context(format!(
            "the run was made by sos {made_by} and this is sos {}, so go on with that version",
            Versions::current().sos
        )),
        None => error,
    }
}

/// The same for a run that was to go on. Its record is put back first unless it has gone on: it is still what the checkpoint
/// is of, and the new one may name a device that is not there.
pub(super) fn explain_resumed(
    run: &RunFolder,
    from: &Resumed,
    error: anyhow::Error,
) -> anyhow::Error {
    if is_of_checkpoint(&error) || step_of(run).is_ok_and(|step| step == from.step) {
        let record = from.record.as_bytes();
        // The error that is on its way says more than one from this.
        let _ = run.write_durably(&run.config_path(), |out| out.write_all(record));
    }
    explain(run, error)
}

fn is_of_checkpoint(error: &anyhow::Error) -> bool {
    let mut causes = error.chain();
    causes.any(|cause| matches!(cause.downcast_ref(), Some(PrepareError::Checkpoint { .. })))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::TrainArgs;
    use super::super::input::Source;
    use super::*;
    use crate::config::TrainConfig;
    use crate::run_folder::Existing;
    use scene_import::MaskSource;

    fn input(scene: &Path) -> InputRecord {
        InputRecord {
            scene: scene.to_path_buf(),
            masks: Some(scene.join("masks")),
            polarity: None,
            ignore: None,
            out: "/runs/cat".into(),
            demo: false,
            imported_from: None,
            photos: None,
            click: None,
            object_box: None,
        }
    }

    #[test]
    fn a_run_goes_on_with_its_own_scene_alone() {
        let dir = tempfile::tempdir().unwrap();
        let [cat, dog, gone] = ["cat", "dog", "gone"].map(|name| dir.path().join(name));
        fs::create_dir(&cat).unwrap();
        fs::create_dir(&dog).unwrap();
        let out = dir.path().join("run");
        let recorded = input(&cat);
        let stated = dir.path().join("dog/../cat");
        assert_eq!(
            going_on(recorded.clone(), &stated, &out),
            Ok(recorded.clone())
        );
        let says = going_on(recorded, &dog, &out).unwrap_err().to_string();
        for part in ["run: it is a run of", "cat, not of", "leave SCENE out"] {
            assert!(says.contains(part), "{says}");
        }

        // A scene that has moved is found where it is stated to be, with the masks in it.
        let found = going_on(input(&gone), &dog, &out).unwrap();
        let dog = fs::canonicalize(&dog).unwrap();
        assert_eq!(found.masks, Some(dog.join("masks")));
        assert_eq!(found.scene, dog);

        // What was imported is in the run's own folder: nothing else would be read.
        let imported = InputRecord {
            imported_from: Some(gone.clone()),
            ..input(&out.join("scene"))
        };
        assert!(going_on(imported.clone(), &dog, &out).is_err());
        assert!(going_on(imported.clone(), &gone, &out).is_ok());
        assert!(going_on(imported, &out.join("scene"), &out).is_ok());
    }

    #[test]
    fn a_run_says_what_keeps_it_from_going_on() {
        let out = Path::new("runs/cat");
        assert!(check_steps(40, 40, false, out).is_ok());
        for (stated, says) in [
            (true, "the command line says 3"),
            (false, "config.toml has steps = 3"),
        ] {
            let said = check_steps(3, 40, stated, out).unwrap_err().to_string();
            assert!(said.contains(says) && said.contains("make it 40"), "{said}");
        }
        let dir = tempfile::tempdir().unwrap();
        assert!(still_there(&input(dir.path()), out).is_ok());
        let gone = input(&dir.path().join("gone"));
        let said = still_there(&gone, out).unwrap_err().to_string();
        assert!(
            said.ends_with("train SCENE --resume --out runs/cat"),
            "{said}"
        );
    }

    #[test]
    fn a_scene_that_a_run_imported_is_found_with_the_run() {
        let dir = tempfile::tempdir().unwrap();
        let [old, run, other] = ["old", "run", "other"].map(|name| dir.path().join(name));
        let imported = InputRecord {
            ignore: Some("/photos/ignore".into()),
            imported_from: Some("/photos".into()),
            ..input(&old.join("scene"))
        };
        let found = |file: &Path, out: &Path| at_home(imported.clone(), file, out);
        let file = run.join("config.toml");
        fs::create_dir_all(run.join("scene/ignore")).unwrap();
        // Moved with its run, whatever comes of it.
        for out in [&run, &other] {
            let found = found(&file, out);
            assert_eq!(found.scene, run.join("scene"));
            assert_eq!(found.masks, Some(run.join("scene/masks")));
            // What was copied from is gone.
            assert_eq!(found.ignore, Some(run.join("scene/ignore")));
        }
        // Of a copied run there are two.
        fs::create_dir_all(old.join("scene")).unwrap();
        assert_eq!(found(&file, &run).scene, run.join("scene"));
        assert_eq!(found(&file, &other), imported);
        // A copied file alone says nothing about what lies beside it.
        fs::create_dir_all(other.join("scene")).unwrap();
        assert_eq!(found(&other.join("mine.toml"), &run), imported);
        // What was not imported lies where it was.
        let plain = input(&dir.path().join("gone"));
        assert_eq!(at_home(plain.clone(), &file, &run), plain);
    }

    #[test]
    fn a_run_that_is_repeated_in_its_place_still_owns_its_scene() {
        let dir = tempfile::tempdir().unwrap();
        let [run, other] = ["run", "other"].map(|name| dir.path().join(name));
        let scene = run.join("scene");
        fs::create_dir_all(scene.join("masks")).unwrap();
        let record = InputRecord {
            imported_from: Some("/photos".into()),
            ..input(&scene)
        };
        let text = RunRecord::new(TrainConfig::default(), record).to_toml();
        let file = run.join("config.toml");
        fs::write(&file, text.unwrap()).unwrap();
        let plan = |out: &Path, scene: Option<&Path>, more: TrainArgs| {
            let config = scene.is_none().then(|| file.clone());
            let args = TrainArgs {
                scene: scene.map(Path::to_path_buf),
                config,
                out: Some(out.to_path_buf()),
                force: true,
                ..more
            };
            Plan::new(&args).unwrap()
        };
        let made_from = Some(PathBuf::from("/photos"));
        let again = plan(&run, None, TrainArgs::default());
        assert_eq!(again.source, Source::Folder(scene.clone()));
        assert_eq!(again.masks, MaskSource::Path(scene.join("masks")));
        assert_eq!(again.imported_from, made_from);
        // Without masks this time.
        let without = TrainArgs {
            masks: Some("none".into()),
            ..TrainArgs::default()
        };
        let without = plan(&run, None, without);
        assert_eq!(without.masks, MaskSource::None);
        assert_eq!(without.imported_from, made_from);
        // The same said by its path.
        let stated = plan(&run, Some(&scene), TrainArgs::default());
        assert_eq!(stated.imported_from, made_from);

        // Another run uses the scene and does not own it.
        for elsewhere in [
            plan(&other, None, TrainArgs::default()),
            plan(&other, Some(&scene), TrainArgs::default()),
        ] {
            assert_eq!(elsewhere.source, Source::Folder(scene.clone()));
            assert_eq!(elsewhere.imported_from, None);
        }
        // Nor is another scene the run's own.
        let photos = plan(&run, Some(dir.path()), TrainArgs::default());
        assert_eq!(photos.imported_from, None);
    }

    #[test]
    fn another_version_is_named_with_the_settings_it_did_not_know() {
        let text = RunRecord::new(TrainConfig::default(), input(Path::new("/cat")));
        let text = text.to_toml().unwrap();
        let path = Path::new("run/config.toml");
        assert_eq!(other_version(path, &text), None);
        let older = text
            .replace(
                &format!("sos = \"{}\"", Versions::current().sos),
                "sos = \"0.0.1\"",
            )
            .replace("huber_delta = ", "# ");
        let says = other_version(path, &older).unwrap();
        for part in ["run/config.toml", "sos 0.0.1", "has it: loss.huber_delta"] {
            assert!(says.contains(part), "{says}");
        }
    }

    #[test]
    fn a_checkpoint_of_another_version_is_told_and_its_record_kept() {
        let dir = tempfile::tempdir().unwrap();
        let run = RunFolder::create(&dir.path().join("run"), Existing::Keep).unwrap();
        run.begin().unwrap();
        fs::write(run.config_path(), "steps = 1\n").unwrap();
        let record = "[versions]\nsos = \"9.9.9\"\nplatform = \"x\"\n";
        let from = Resumed {
            record: record.to_owned(),
            step: 0,
        };
        let broken = || PrepareError::Checkpoint {
            path: "fields.bpk".into(),
            what: "another format".to_owned(),
        };
        let error = explain_resumed(&run, &from, broken().into());
        let says = crate::error::sentence(&error);
        assert!(
            says.contains("made by sos 9.9.9") && says.contains("fields.bpk"),
            "{says}"
        );
        assert_eq!(
            crate::error::exit_code(&error),
            crate::error::EXIT_BAD_INPUT
        );
        assert_eq!(fs::read_to_string(run.config_path()).unwrap(), record);

        // What is no fault of the checkpoint has nothing to do with versions.
        let error = explain(&run, PrepareError::Empty(3).into());
        assert!(!crate::error::sentence(&error).contains("9.9.9"));
    }
}
