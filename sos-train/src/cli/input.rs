//! Finding what a run is to work on: scene, masks, folder, configuration.

use super::TrainArgs;
use super::answer::Voice;
use super::resumed::{
    Resumed, at_home, check_steps, explain, going_on, is_own_scene, other_version, photos_of,
    still_there,
};
use crate::config::{InputRecord, MaskPolarity, RunRecord, TrainConfig};
use crate::device::built_in;
use crate::discover::hint::{Click, WorldBox};
use crate::error::InputError;
use crate::run_folder::{RunError, RunFolder};
use crate::train::checkpoint::step_of;
use crate::train::schedule::keep_carving;
use anyhow::Context as _;
use demo_scene::{DemoConfig, DemoError, DemoScene, check_vacant, generate};
use draft_folder::Occupant;
use io_colmap::{IGNORE_FOLDER, MaskFiles, Scene};
use scene_import::MaskSource;
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Given for `--masks`, it means that there are to be none.
pub(super) const NO_MASKS: &str = "none";
/// Given for `--masks`, it means the photos' alpha channels.
const ALPHA: &str = "alpha";

/// What a run is to do, before any of it is opened.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) config: TrainConfig,
    pub(super) source: Source,
    pub(super) masks: MaskSource,
    pub(super) label: Option<u32>,
    pub(super) polarity: Option<MaskPolarity>,
    /// What the scene was made from, if it lies in the run's own folder because the run imported it, or the one that
    /// is gone on with or replaced did.
    pub(super) imported_from: Option<PathBuf>,
    pub(super) click: Option<Click>,
    pub(super) object_box: Option<WorldBox>,
    /// Where photos are not to be learned from.
    pub(super) ignore: Option<PathBuf>,
    /// What the photos of a run that goes on must be, as its record has it.
    pub(super) photos: Option<String>,
    pub(super) out: PathBuf,
    /// What a user should know about the file that the settings are of.
    pub(super) note: Option<String>,
    /// What a run that goes on goes on from.
    pub(super) resumed: Option<Resumed>,
}

/// Where the photos come from.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The demo, which the run generates.
    Demo,
    /// A folder.
    Folder(PathBuf),
}

/// What `--masks` says.
pub(super) fn mask_source(stated: Option<&Path>) -> MaskSource {
    match stated {
        None => MaskSource::Look,
        Some(word) if word.as_os_str() == NO_MASKS => MaskSource::None,
        Some(word) if word.as_os_str() == ALPHA => MaskSource::Alpha,
        Some(path) => MaskSource::Path(path.to_path_buf()),
    }
}

impl Plan {
    /// Merges preset or saved configuration and command line.
    pub(super) fn new(args: &TrainArgs) -> anyhow::Result<Self> {
        // What a run goes on with is in its folder; what it was once made from may be gone.
        if let Some(scene) = args.scene.as_ref().filter(|_| !args.resume)
            && !scene.exists()
        {
            return Err(no_scene(scene).into());
        }
        let paths = [&args.scene, &args.masks, &args.ignore, &args.out];
        for path in paths.into_iter().flatten() {
            check_unicode(path)?;
        }
        let repeated = args.config.as_deref().map(Kept::read).transpose()?;
        let named = repeated
            .as_ref()
            .and_then(|kept| kept.record.input.as_ref());
        let out = run_path(args, named)?;
        let saved = if args.resume {
            let run = RunFolder::open_existing(&out)?;
            if !run.has_checkpoint() {
                return Err(RunError::NoCheckpoint { path: out }.into());
            }
            Some(Kept::read(&run.config_path())?)
        } else {
            repeated
        };
        let mut config = match &saved {
            Some(kept) => kept.record.config.clone(),
            None => TrainConfig::preset(args.preset.unwrap_or_default()),
        };
        if let Some(steps) = args.settings.steps {
            config.steps = steps;
        }
        if let Some(seed) = args.settings.seed {
            config.seed = seed;
        }
        if let Some(device) = &args.settings.device {
            config.device.clone_from(device);
        }
        if let Some(downscale) = args.settings.downscale {
            config.prepare.downscale = downscale;
        }
        for assignment in &args.settings.set {
            config.apply_override(assignment)?;
        }
        config.validate()?;
        built_in(&config.device)?;
        let mut resumed = None;
        if let (true, Some(Kept { record, text, .. })) = (args.resume, &saved) {
            config.check_resumes(&record.config)?;
            // Its record would say that it had fewer.
            let run = RunFolder::open_existing(&out)?;
            let step = step_of(&run).map_err(|error| explain(&run, error))?;
            let stated = config.steps != record.config.steps;
            check_steps(config.steps, step, stated, &out)?;
            keep_carving(&mut config, &record.config, step);
            let record = text.clone();
            resumed = Some(Resumed { record, step });
        }

        let note = saved.as_ref().and_then(|kept| kept.note.clone());
        let input = saved.and_then(|kept| kept.record.input);
        // Masks belong to a scene: those of the record only go with its own.
        let recorded = match (input, &args.scene) {
            (Some(input), Some(scene)) if args.resume => Some(going_on(input, scene, &out)?),
            (input, None) => input,
            (_, Some(_)) => None,
        };
        let file = match &args.config {
            Some(file) => file.clone(),
            None => out.join("config.toml"),
        };
        let recorded = recorded.map(|input| at_home(input, &file, &out));
        if let (true, Some(input)) = (args.resume, &recorded) {
            still_there(input, &out)?;
        }
        // A run that goes on does so with what its record says.
        let is_known = args.resume && recorded.is_some();
        let stated = args.scene.as_ref().filter(|_| !is_known);
        let source = match (stated, &recorded) {
            (Some(scene), _) => Source::Folder(scene.clone()),
            (None, Some(input)) if !input.demo => Source::Folder(input.scene.clone()),
            (None, _) => Source::Demo,
        };
        let of_record = recorded.as_ref();
        let imported_from = match &source {
            Source::Folder(scene) if is_own_scene(scene, &out) => of_record
                .and_then(|input| input.imported_from.clone())
                .or_else(|| made_from(&out)),
            Source::Folder(_) | Source::Demo => None,
        };
        let keeps_masks = args.resume && imported_from.is_some();
        let masks = match (&args.masks, &recorded) {
            // Imported masks are in the run's own folder, whatever they were made of.
            _ if keeps_masks => MaskSource::Look,
            (Some(path), _) => mask_source(Some(path)),
            (None, Some(input)) if !input.demo => match &input.masks {
                Some(dir) => MaskSource::Path(dir.clone()),
                None => MaskSource::None,
            },
            (None, _) => MaskSource::Look,
        };
        let ignore = match (&args.ignore, &recorded, &source) {
            (Some(dir), ..) => Some(dir.clone()),
            (None, Some(input), _) => input.ignore.clone(),
            (None, None, Source::Folder(scene)) => ignore_folder(scene),
            (None, None, Source::Demo) => None,
        };
        let hints = recorded
            .as_ref()
            .filter(|_| args.click.is_none() && args.object_box.is_none())
            .map(|input| (input.click.clone(), input.object_box))
            .unwrap_or((args.click.clone(), args.object_box));
        let polarity = args.polarity.or(of_record.and_then(|input| input.polarity));
        let photos = recorded
            .filter(|_| args.resume)
            .and_then(|input| input.photos);
        Ok(Self {
            config,
            source,
            masks,
            label: args.label.filter(|_| !keeps_masks),
            polarity,
            imported_from,
            click: hints.0,
            object_box: hints.1,
            ignore,
            photos,
            out,
            note,
            resumed,
        })
    }
}

/// A `config.toml` that a plan is made of.
struct Kept {
    record: RunRecord,
    text: String,
    /// What to say where another version wrote it.
    note: Option<String>,
}

impl Kept {
    fn read(path: &Path) -> anyhow::Result<Self> {
        let (record, text) = read_record(path)?;
        let note = other_version(path, &text);
        Ok(Self { record, text, note })
    }
}

/// An error if `config.toml`, which is text, could not hold the path in full.
fn check_unicode(path: &Path) -> Result<(), InputError> {
    let full = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    match full.to_str() {
        Some(_) => Ok(()),
        None => Err(InputError::new(
            &full,
            "this path has letters that are not Unicode, so a run's config.toml could not name it",
            "rename the file or folder",
        )),
    }
}

/// Where a scene says what is not to be learned from, if it does.
pub(super) fn ignore_folder(scene: &Path) -> Option<PathBuf> {
    let root = match scene.is_file() {
        // What lies beside a video is about other photos than its frames.
        true if scene_capture::detect(scene).is_some() => return None,
        // The file with the poses stands for its folder.
        true => scene.parent()?,
        false => scene,
    };
    Some(root.join(IGNORE_FOLDER)).filter(|dir| dir.is_dir())
}

/// The folder to take masks from for a COLMAP scene, and what to tell the user about the choice.
pub(super) fn mask_folder(
    source: &MaskSource,
    scene: &Path,
    demo: bool,
) -> (Option<PathBuf>, Option<String>) {
    match source {
        // Alpha channels and files are imported, after which there is a folder.
        MaskSource::None | MaskSource::Alpha => (None, None),
        MaskSource::Path(dir) => (Some(dir.clone()), None),
        MaskSource::Look if demo => (Some(scene.join("coarse_masks")), None),
        MaskSource::Look => {
            let masks = scene.join("masks");
            if MaskFiles::are_in(&masks) {
                let note = format!(
                    "masks are taken from {} (--masks none to do without)",
                    masks.display()
                );
                (Some(masks), Some(note))
            } else {
                (None, coarse_masks_hint(scene))
            }
        }
    }
}

/// Masks of that name are offered, not taken.
pub(super) fn coarse_masks_hint(scene: &Path) -> Option<String> {
    let coarse = scene.join("coarse_masks");
    coarse.is_dir().then(|| {
        format!(
            "no masks are used; to use those in {0}, add --masks {0}",
            coarse.display()
        )
    })
}

/// Where a run goes unless stated: `runs/demo` or `runs/NAME_OF_SCENE`, also of the scene that a run to be
/// repeated had.
fn run_path(args: &TrainArgs, repeated: Option<&InputRecord>) -> anyhow::Result<PathBuf> {
    if let Some(out) = &args.out {
        return Ok(out.clone());
    }
    let mut full = match (&args.scene, repeated) {
        // Resolved, so that "." and ".." have a name.
        (Some(scene), _) => fs::canonicalize(scene).map_err(|_| no_scene(scene))?,
        // An imported scene lies in its run's folder, under a name that all of them have.
        (None, Some(input)) if !input.demo => {
            let scene = input.imported_from.as_ref().unwrap_or(&input.scene);
            scene.clone()
        }
        (None, _) => return Ok(Path::new("runs").join("demo")),
    };
    if let Some(scene_capture::Source::Video(_)) = scene_capture::detect(&full) {
        full.set_extension("");
    } else if full.is_file() {
        // The file with the poses stands for its folder.
        full.pop();
    }
    Ok(Path::new("runs").join(full.file_name().unwrap_or("scene".as_ref())))
}

fn no_scene(scene: &Path) -> InputError {
    InputError::new(
        scene,
        "there is no such file or folder",
        "give a folder of photos, with camera poses or without, or a video",
    )
}

pub(super) fn read_record(path: &Path) -> anyhow::Result<(RunRecord, String)> {
    let text = fs::read_to_string(path).map_err(|source| RunError::Io {
        action: "read",
        path: path.to_path_buf(),
        source,
    })?;
    let record = RunRecord::from_toml(&text).with_context(|| path.display().to_string())?;
    Ok((record, text))
}

/// What `config.toml` says about the input. Paths are absolute, so that they hold from anywhere.
pub(super) fn record_input(
    plan: &Plan,
    scene: &Scene,
    masks: Option<&Path>,
    polarity: Option<MaskPolarity>,
    imported_from: Option<&Path>,
) -> InputRecord {
    let full = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    InputRecord {
        scene: full(&scene.root),
        masks: masks.map(full),
        polarity,
        ignore: plan.ignore.as_deref().map(full),
        out: full(&plan.out),
        demo: plan.source == Source::Demo,
        imported_from: imported_from.map(full),
        photos: Some(photos_of(&scene.model)),
        click: plan.click.clone(),
        object_box: plan.object_box,
    }
}

/// Whether the run at `out` made the scene in its folder.
pub(super) fn owns_scene(out: &Path) -> bool {
    input_of(out).is_some_and(|input| input.owns_scene())
}

/// What the run at `out` imported the scene in its folder from.
fn made_from(out: &Path) -> Option<PathBuf> {
    input_of(out)?.imported_from
}

fn input_of(out: &Path) -> Option<InputRecord> {
    let (record, _) = read_record(&out.join("config.toml")).ok()?;
    record.input
}

/// An error, before anything takes its time, unless there is nothing or an empty folder where a folder of results goes.
pub(super) fn check_free(out: &Path) -> Result<(), InputError> {
    let elsewhere = "choose a folder with --out that is empty or does not exist";
    match Occupant::of(out) {
        Ok(Some(occupant)) => Err(InputError::new(
            out,
            format!("there is something in it already, {occupant}"),
            occupant.remedy(elsewhere),
        )),
        Err(_) if out.is_file() => Err(InputError::new(out, "this is a file", elsewhere)),
        // What cannot be listed is refused by what is written there.
        Ok(None) | Err(_) => Ok(()),
    }
}

/// Generates the demo scene into `out`; says so before it takes its time if that cannot be.
pub(super) fn generate_demo(out: &Path) -> Result<DemoScene, DemoError> {
    check_vacant(out)?;
    let scene = generate(&DemoConfig::default());
    scene.write(out)?;
    Ok(scene)
}

/// `sos demo-scene OUT`.
pub(super) fn write_demo(out: &Path, json: bool) -> anyhow::Result<()> {
    let begun = Instant::now();
    let scene = generate_demo(out)?;
    let result = json!({
        "scene": out,
        "photos": scene.views.len(),
        "coarse_iou": scene.mean_coarse_iou(),
    });
    let sentence = format!(
        "{}: {} photos with ground truth and rough masks of mean IoU {:.2}, in {}",
        out.display(),
        scene.views.len(),
        scene.mean_coarse_iou(),
        crate::progress::duration(begun.elapsed())
    );
    Voice::of(json, false).answer(&result, &sentence)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::SettingArgs;
    use super::*;
    use crate::config::Preset;

    #[test]
    fn later_layers_win() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("mine.toml");
        let text = "preset = \"quick\"\nsteps = 777\nseed = 5\n[loss]\nmask = 0.3\neikonal = 0.3\n";
        fs::write(&file, text).unwrap();
        let plan = |args: TrainArgs| Plan::new(&args).unwrap().config;

        // Nothing said: the defaults; a preset in their place.
        assert_eq!(plan(TrainArgs::default()), TrainConfig::default());
        let preset = plan(TrainArgs {
            preset: Some(Preset::Quick),
            ..TrainArgs::default()
        });
        assert_eq!(preset, TrainConfig::preset(Preset::Quick));
        assert_ne!(preset.model.levels, TrainConfig::default().model.levels);

        let layered = plan(TrainArgs {
            config: Some(file),
            settings: SettingArgs {
                steps: Some(9),
                downscale: Some(2),
                set: vec![
                    "steps=10".into(),
                    "loss.eikonal=0.1".into(),
                    "loss.eikonal=0.2".into(),
                ],
                ..SettingArgs::default()
            },
            ..TrainArgs::default()
        });
        // The file over its preset, options over the file, --set over options, the last one over all.
        assert_eq!(layered.model, preset.model);
        assert_eq!((layered.seed, layered.loss.mask), (5, 0.3));
        assert_eq!((layered.steps, layered.loss.eikonal), (10, 0.2));
        assert_eq!(layered.prepare.downscale, 2);
    }

    #[test]
    fn the_file_with_the_poses_stands_for_its_folder() {
        let dir = tempfile::tempdir().unwrap();
        let [ignore, poses, video] =
            ["ignore", "a.json", "a.mp4"].map(|name| dir.path().join(name));
        fs::create_dir(&ignore).unwrap();
        fs::write(&poses, "").unwrap();
        fs::write(&video, "").unwrap();
        let found = [dir.path(), &poses, &video].map(ignore_folder);
        assert_eq!(found, [Some(ignore.clone()), Some(ignore), None]);
    }

    #[test]
    fn a_repeated_run_is_named_after_its_scene() {
        let input = InputRecord {
            scene: "/runs/old/scene".into(),
            masks: None,
            polarity: None,
            ignore: None,
            out: "/runs/old".into(),
            demo: false,
            imported_from: Some("/photos/cat".into()),
            photos: None,
            click: None,
            object_box: None,
        };
        let out = |input: Option<&InputRecord>| run_path(&TrainArgs::default(), input).unwrap();
        assert_eq!(out(None), Path::new("runs/demo"));
        assert_eq!(out(Some(&input)), Path::new("runs/cat"));
        let ready = InputRecord {
            scene: "/photos/dog".into(),
            imported_from: None,
            ..input.clone()
        };
        assert_eq!(out(Some(&ready)), Path::new("runs/dog"));
        let demo = InputRecord {
            demo: true,
            ..input.clone()
        };
        assert_eq!(out(Some(&demo)), Path::new("runs/demo"));
    }
}
