//! `sos doctor`: the checks of a scene, before anything is trained.

use super::answer::Voice;
use super::capture::source_without_poses;
use super::import::is_ready;
use super::input::{coarse_masks_hint, ignore_folder, mask_folder, mask_source};
use super::train::refuse_hints;
use super::{DoctorArgs, program, whole_program};
use crate::config::{Preset, TrainConfig};
use crate::discover::Hint;
use crate::doctor::{Location, estimate};
use crate::error::{EXIT_FAILED_CHECK, EXIT_OK, InputError, sentence};
use crate::prepare::view::{find_ignored, load_ignored, load_views};
use crate::prepare::{KnownScene, TrainView, prepare_with};
use crate::run_folder::{RunError, write_whole};
use io_colmap::{ColmapError, MaskSet, Scene};
use scene_doctor::{
    Consensus, Cost, Drawing, Files, Masks, Missing, Status, cost, examine, page,
    photos_without_pose,
};
use scene_export::quoted;
use scene_import::{Dropped, MaskOptions, MaskSource, detect};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Makes all checks and prints them; the exit code tells whether one failed.
pub(super) fn doctor(args: &DoctorArgs) -> anyhow::Result<u8> {
    let config = TrainConfig::preset(args.preset.unwrap_or_default());
    let patient = Patient::open(args)?;
    let mut views = load_views(&patient.scene, patient.masks.as_ref())?;
    if let Some(dir) = args.ignore.clone().or_else(|| ignore_folder(&args.scene)) {
        load_ignored(&mut views, &find_ignored(&dir, &patient.scene)?)?;
    }
    let points = &patient.scene.model.points;
    let hint = Hint::stated(args.click.clone(), args.object_box);
    let location = Location::find(&views, points, &hint, &config.prepare);
    let agreed = location.mask_consensus(config.prepare.object_threshold);
    let masks = patient.masks_found(agreed);
    let exam = location.exam(&views, &patient.scene);
    let name = args.scene.display().to_string();
    let mut report = examine(&name, &exam, &patient.files, &masks);
    let drawing = Drawing::new(&exam, &report);
    drop(exam);
    // What will not be trained has no cost.
    if report.verdict != Status::Fail
        && let Some(estimate) = measure(views, location, &patient.scene, &config)
    {
        report.push(cost(&estimate));
    }
    if let Some(path) = &args.html {
        write_whole(path, page(&report, &drawing).as_bytes())?;
    }
    let mut table = report.to_string().trim_end().to_owned();
    if report.verdict != Status::Fail {
        // Writing to a string cannot fail.
        let _ = write!(table, "\n\ntrain on it with: {}", train_command(args));
    }
    Voice::of(args.json, false).answer(&report, &table)?;
    Ok(match report.verdict {
        Status::Fail => EXIT_FAILED_CHECK,
        Status::Warn | Status::Pass => EXIT_OK,
    })
}

/// A scene as training would open it, with what is wrong kept for the report.
struct Patient {
    scene: Scene,
    masks: Option<MaskSet>,
    /// What the report says about masks if they cannot be used, or are none.
    without: Masks,
    polarity: String,
    files: Files,
    /// Where an imported scene lies until it has been looked at.
    _folder: Option<TempDir>,
}

impl Patient {
    fn open(args: &DoctorArgs) -> anyhow::Result<Self> {
        if source_without_poses(&args.scene).is_some() {
            return Err(InputError::new(
                &args.scene,
                "there are no camera poses to check yet",
                format!(
                    "make a scene of it first: {} capture {} --out FOLDER",
                    whole_program(),
                    quoted(&args.scene)
                ),
            )
            .into());
        }
        let source = mask_source(args.masks.as_deref());
        if let MaskSource::Path(path) = &source
            && !path.exists()
        {
            return Err(InputError::new(
                path,
                "there is no such folder or file",
                "give the masks, or --masks none to do without",
            )
            .into());
        }
        if is_ready(&args.scene, &source, args.label)? {
            Self::of_colmap(args, &source)
        } else {
            Self::of_import(args, source)
        }
    }

    fn of_colmap(args: &DoctorArgs, source: &MaskSource) -> anyhow::Result<Self> {
        let (scene, missing) = Scene::open_present(&args.scene)?;
        let (folder, _) = mask_folder(source, &args.scene, false);
        if let Some(dir) = &folder {
            refuse_hints(args.click.is_some(), args.object_box.is_some(), dir)?;
        }
        let found = folder
            .as_deref()
            .map(|dir| MaskSet::find(dir, &scene, args.polarity.map(Into::into)))
            .transpose();
        let (masks, without) = match found {
            Ok(masks) => (masks, none(source, &args.scene)),
            Err(ColmapError::Mask { path, what, remedy }) => {
                let what = format!("{}: {what}", path.display());
                (None, Masks::Refused { what, remedy })
            }
            Err(error) => return Err(error.into()),
        };
        let paths: Vec<PathBuf> = scene
            .model
            .views
            .iter()
            .map(|v| scene.image_path(v))
            .collect();
        // As found, or as stated in spite of that.
        let polarity = masks
            .as_ref()
            .and_then(|masks| masks.notes.get(1).cloned())
            .unwrap_or_default();
        Ok(Self {
            files: Files {
                missing,
                missing_are: Missing::Refused,
                left_out: Vec::new(),
                unposed: photos_without_pose(
                    &paths,
                    masks.iter().flat_map(|masks| &masks.paths).flatten(),
                ),
            },
            scene,
            masks,
            without,
            polarity,
            _folder: None,
        })
    }

    /// Imports the scene into a temporary folder, as training does into its run.
    fn of_import(args: &DoctorArgs, source: MaskSource) -> anyhow::Result<Self> {
        let detected = detect(&args.scene, None)?;
        let imported = scene_import::read(&detected, None)?;
        let folder = tempfile::tempdir()
            .map_err(|source| RunError::outside("create", &std::env::temp_dir(), source))?;
        let options = MaskOptions {
            source,
            label: args.label,
            polarity: args.polarity.map(Into::into),
            ignore: args.ignore.clone(),
        };
        let (dir, bare) = (folder.path().join("scene"), folder.path().join("bare"));
        let (dir, written, mut without) = match imported.write(&dir, &options) {
            Ok(written) => (dir, written, none(&options.source, &detected.root)),
            // If it can be written without masks, those are what is wrong.
            Err(error) => match imported.write(&bare, &without_masks(args)) {
                Ok(written) => {
                    let text = sentence(&error.into());
                    let (what, remedy) = text
                        .rsplit_once("; ")
                        .unwrap_or((&text, "export them again"));
                    let refused = Masks::Refused {
                        what: what.to_owned(),
                        remedy: remedy.to_owned(),
                    };
                    (bare, written, refused)
                }
                Err(_) => return Err(error.into()),
            },
        };
        let scene = Scene::open(&dir)?;
        let masks = (written.masks > 0)
            .then(|| {
                let white = Some(io_colmap::Polarity::WhiteIsObject);
                MaskSet::find(&dir.join("masks"), &scene, white)
            })
            .transpose()?;
        if masks.is_some() {
            let dir = &detected.root;
            refuse_hints(args.click.is_some(), args.object_box.is_some(), dir)?;
            without = Masks::None { offered: None };
        }
        let polarity = written.notes.iter().find(|note| note.contains(" = object"));
        Ok(Self {
            files: Files {
                missing: imported
                    .dropped
                    .iter()
                    .filter(|view| view.is_missing())
                    .map(|view| view.name.clone())
                    .collect(),
                missing_are: Missing::LeftOut,
                left_out: Dropped::sentences(
                    imported.dropped.iter().filter(|view| !view.is_missing()),
                ),
                unposed: photos_without_pose(&imported.photos, imported.masks.iter().flatten()),
            },
            scene,
            masks,
            without,
            polarity: polarity
                .cloned()
                .unwrap_or_else(|| "white = object".to_owned()),
            _folder: Some(folder),
        })
    }

    fn masks_found(&self, consensus: Option<Consensus>) -> Masks {
        match &self.masks {
            Some(_) => Masks::Found {
                polarity: self.polarity.clone(),
                consensus,
            },
            None => self.without.clone(),
        }
    }
}

fn without_masks(args: &DoctorArgs) -> MaskOptions {
    MaskOptions {
        source: MaskSource::None,
        ignore: args.ignore.clone(),
        ..MaskOptions::default()
    }
}

fn none(source: &MaskSource, scene: &Path) -> Masks {
    let looked = *source == MaskSource::Look;
    Masks::None {
        offered: looked.then(|| coarse_masks_hint(scene)).flatten(),
    }
}

/// What training will take; none where it cannot be prepared, which has then been said.
fn measure(
    mut views: Vec<TrainView>,
    location: Location,
    scene: &Scene,
    config: &TrainConfig,
) -> Option<Cost> {
    let (points, band) = (&scene.model.points, config.loss.ignore_band);
    if location.consensus.is_none() {
        // The object will be looked for, few masks or none.
        views.iter_mut().for_each(|view| view.mask = None);
    }
    let known = KnownScene {
        consensus: location.consensus,
        frame: None,
    };
    let data = prepare_with(views, known, points, &config.prepare, band).ok()?;
    estimate::measured(&config.settled(&scene.model), &data).ok()
}

/// How to go on, with what was said about masks and object.
fn train_command(args: &DoctorArgs) -> String {
    let mut words = format!("{} train {}", program(), quoted(&args.scene));
    let mut add = |option: &str, value: String| words.push_str(&format!(" {option} {value}"));
    if let Some(preset) = args.preset.filter(|preset| *preset != Preset::Default) {
        add("--preset", preset.to_string());
    }
    if let Some(masks) = &args.masks {
        add("--masks", quoted(masks));
    }
    if let Some(ignore) = &args.ignore {
        add("--ignore", quoted(ignore));
    }
    if let Some(label) = args.label {
        add("--label", label.to_string());
    }
    if let Some(polarity) = args.polarity {
        let word = format!("{polarity:?}").to_lowercase();
        add("--polarity", word);
    }
    if let Some(click) = &args.click {
        let place = format!("{}:{},{}", click.view, click.x, click.y);
        add("--click", quoted(Path::new(&place)));
    }
    if let Some(object_box) = &args.object_box {
        let numbers = [object_box.low, object_box.high].concat();
        let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
        add("--box", numbers.join(","));
    }
    words
}
