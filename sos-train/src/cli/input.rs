//! Finding what a run is to work on: scene, masks, folder, configuration.

use super::{TrainArgs, answer};
use crate::config::{InputRecord, MaskPolarity, RunRecord, TrainConfig};
use crate::error::InputError;
use crate::run_folder::{RunError, RunFolder};
use anyhow::Context as _;
use demo_scene::{DemoConfig, DemoError, DemoScene, generate};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Given for `--masks`, it means that there are to be none.
const NO_MASKS: &str = "none";

/// What a run is to do, before any of it is opened.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) config: TrainConfig,
    pub(super) source: Source,
    pub(super) masks: Masks,
    pub(super) polarity: Option<MaskPolarity>,
    pub(super) out: PathBuf,
}

/// Where the photos come from.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The demo, which the run generates.
    Demo,
    /// A folder.
    Folder(PathBuf),
}

/// Where the masks come from.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Masks {
    /// Not stated: look beside the photos.
    Look,
    /// Stated that there are none.
    None,
    /// A folder.
    Folder(PathBuf),
}

impl Plan {
    /// Merges preset or saved configuration and command line.
    pub(super) fn new(args: &TrainArgs) -> anyhow::Result<Self> {
        let out = run_path(args)?;
        let saved = if args.resume {
            let run = RunFolder::open_existing(&out)?;
            if !run.has_checkpoint() {
                return Err(RunError::NoCheckpoint { path: out }.into());
            }
            Some(read_record(&run.config_path())?)
        } else {
            args.config.as_deref().map(read_record).transpose()?
        };
        let mut config = match &saved {
            Some(record) => record.config.clone(),
            None => TrainConfig::preset(args.preset.unwrap_or_default()),
        };
        if let Some(steps) = args.steps {
            config.steps = steps;
        }
        if let Some(seed) = args.seed {
            config.seed = seed;
        }
        if let Some(device) = &args.device {
            config.device.clone_from(device);
        }
        for assignment in &args.set {
            config.apply_override(assignment)?;
        }
        config.validate()?;
        if let (true, Some(record)) = (args.resume, &saved) {
            config.check_resumes(&record.config)?;
        }

        let input = saved.and_then(|record| record.input);
        // Masks belong to a scene: those of the record only go with its own.
        let same_scene = args.scene.is_none() || args.resume;
        let recorded = input.filter(|_| same_scene);
        let source = match (&args.scene, &recorded) {
            (Some(scene), _) => Source::Folder(scene.clone()),
            (None, Some(input)) if !input.demo => Source::Folder(input.scene.clone()),
            (None, _) => Source::Demo,
        };
        let masks = match (&args.masks, &recorded) {
            (Some(dir), _) if dir.as_os_str() == NO_MASKS => Masks::None,
            (Some(dir), _) => Masks::Folder(dir.clone()),
            // The demo's masks lie in the run's own folder, which may be another one now.
            (None, Some(input)) if !input.demo => match &input.masks {
                Some(dir) => Masks::Folder(dir.clone()),
                None => Masks::None,
            },
            (None, _) => Masks::Look,
        };
        let polarity = args.polarity.or(recorded.and_then(|input| input.polarity));
        Ok(Self {
            config,
            source,
            masks,
            polarity,
            out,
        })
    }
}

impl Masks {
    /// The folder to take masks from, and what to tell the user about the choice.
    pub(super) fn choose(&self, scene: &Path, demo: bool) -> (Option<PathBuf>, Option<String>) {
        match self {
            Masks::None => (None, None),
            Masks::Folder(dir) => (Some(dir.clone()), None),
            Masks::Look if demo => (Some(scene.join("coarse_masks")), None),
            Masks::Look => {
                let (masks, coarse) = (scene.join("masks"), scene.join("coarse_masks"));
                if masks.is_dir() {
                    let note = format!(
                        "masks are taken from {} (--masks none to do without)",
                        masks.display()
                    );
                    (Some(masks), Some(note))
                } else if coarse.is_dir() {
                    let note = format!(
                        "no masks are used; to use those in {0}, add --masks {0}",
                        coarse.display()
                    );
                    (None, Some(note))
                } else {
                    (None, None)
                }
            }
        }
    }
}

/// Where a run goes unless stated: `runs/demo` or `runs/NAME_OF_SCENE`.
fn run_path(args: &TrainArgs) -> anyhow::Result<PathBuf> {
    if let Some(out) = &args.out {
        return Ok(out.clone());
    }
    let Some(scene) = &args.scene else {
        return Ok(Path::new("runs").join("demo"));
    };
    // Resolved, so that "." and ".." have a name.
    let full = fs::canonicalize(scene).map_err(|_| no_scene(scene))?;
    Ok(Path::new("runs").join(full.file_name().unwrap_or("scene".as_ref())))
}

fn no_scene(scene: &Path) -> InputError {
    InputError::new(
        scene,
        "there is no such folder",
        "give the folder that holds images/ and sparse/",
    )
}

fn read_record(path: &Path) -> anyhow::Result<RunRecord> {
    let text = fs::read_to_string(path).map_err(|source| RunError::Io {
        action: "read",
        path: path.to_path_buf(),
        source,
    })?;
    RunRecord::from_toml(&text).with_context(|| path.display().to_string())
}

/// What `config.toml` says about the input. Paths are absolute, so that they hold from anywhere.
pub(super) fn record_input(
    scene: &Path,
    masks: Option<&Path>,
    polarity: Option<MaskPolarity>,
    out: &Path,
    demo: bool,
) -> InputRecord {
    let full = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    InputRecord {
        scene: full(scene),
        masks: masks.map(full),
        polarity,
        out: full(out),
        demo,
    }
}

/// Whether the run at `out` is one of the demo.
pub(super) fn is_demo_run(out: &Path) -> bool {
    read_record(&out.join("config.toml"))
        .ok()
        .and_then(|record| record.input)
        .is_some_and(|input| input.demo)
}

/// Generates the demo scene into `out`; says so before it takes its time if that cannot be.
pub(super) fn generate_demo(out: &Path) -> Result<DemoScene, DemoError> {
    if fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(DemoError::Occupied(out.to_path_buf()));
    }
    let scene = generate(&DemoConfig::default());
    scene.write(out)?;
    Ok(scene)
}

/// `sos demo-scene OUT`.
pub(super) fn write_demo(out: &Path) -> anyhow::Result<()> {
    let begun = Instant::now();
    let scene = generate_demo(out)?;
    answer(&format!(
        "{}: {} photos with ground truth and rough masks of mean IoU {:.2}, in {}",
        out.display(),
        scene.views.len(),
        scene.mean_coarse_iou(),
        crate::progress::duration(begun.elapsed())
    ));
    Ok(())
}
