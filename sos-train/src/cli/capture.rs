//! `sos capture`, and the capture that `sos train` makes of photos without poses or a video.

use super::answer::Voice;
use super::import::{Imported, free_scene_dir, write_into_run};
use super::input::{Plan, owns_scene};
use super::train::{folder, say_kept};
use super::{CaptureArgs, TrainArgs, program};
use crate::error::InputError;
use crate::export::check_names;
use crate::progress::{self, AtInterrupt, Progress, watch_interrupt};
use crate::run_folder::{RunError, RunFolder};
use anyhow::Context as _;
use scene_capture::{CaptureOptions, Existing, RECORD, Source, Stage, Tools, Watch};
use scene_export::quoted;
use scene_import::{MaskOptions, MaskSource};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// What a scene has to be captured from before anything else: photos without poses, or a video.
pub(super) fn source_without_poses(path: &Path) -> Option<Source> {
    // The pictures in a run are results.
    let is_run = RunFolder::open_existing(path).is_ok();
    scene_capture::detect(path).filter(|_| !is_run)
}

/// Makes a COLMAP scene of photos or a video.
pub(super) fn capture(args: &CaptureArgs) -> anyhow::Result<()> {
    let Some(source) = source_without_poses(&args.source) else {
        return Err(nothing_to_capture(&args.source));
    };
    let progress = Progress::new(args.quiet, 0);
    let screen = Screen::new(&progress);
    let mut options = CaptureOptions {
        masks: args.masks.clone(),
        existing: if args.force {
            Existing::Replace
        } else {
            Existing::Keep
        },
        ..CaptureOptions::default()
    };
    if let Some(frames) = args.frames {
        options.frames.count = frames as usize;
    }
    let tools = Tools::find_for(&source)?;
    let captured = scene_capture::capture(&source, &args.out, &tools, &options, &screen)?;
    screen.end_stage();
    if let Some(warning) = &captured.warning {
        progress.warn(warning);
    }
    let result = json!({
        "scene": args.out,
        "photos": captured.photos,
        "registered": captured.registered,
        "warning": captured.warning,
    });
    let sentence = format!(
        "{}: {} of {} photos have poses; train on it with: {} train {}",
        args.out.display(),
        captured.registered,
        captured.photos,
        program(),
        quoted(&args.out)
    );
    Voice::of(args.json, args.quiet).answer(&result, &sentence)
}

fn nothing_to_capture(path: &Path) -> anyhow::Error {
    if let Err(error) = refuse_one_photo(path) {
        return error.into();
    }
    let (what, remedy) = if !path.exists() {
        (
            "there is no such file or folder",
            "give a folder of photos or a video file",
        )
    } else if path.is_file() {
        (
            "it is no video that is known by its ending",
            "give a folder of photos or a video such as .mp4 or .mov",
        )
    } else if scene_import::detect(path, None).is_ok() {
        (
            "it has camera poses already",
            "train on it as it is, or give just its folder of photos",
        )
    } else {
        (
            "it holds no photos (JPEG, PNG, WebP or TIFF)",
            "convert others to JPEG first, such as a phone's HEIC files",
        )
    };
    InputError::new(path, what, remedy).into()
}

/// An error for a photo where a scene is wanted.
pub(super) fn refuse_one_photo(path: &Path) -> Result<(), InputError> {
    if path.is_file() && image::ImageFormat::from_path(path).is_ok() {
        let remedy = "give the folder with all photos of the object";
        return Err(InputError::new(path, "it is one photo", remedy));
    }
    Ok(())
}

/// Captures a scene and puts it into the folder of a run, with the masks that training is to use.
pub(super) fn capture_for_run(
    args: &TrainArgs,
    plan: &Plan,
    source: &Source,
    screen: &Progress,
) -> anyhow::Result<(RunFolder, Imported)> {
    let masks = masks_beside(source, &plan.masks)?;
    let without = || {
        let path = source.path().display();
        match source {
            Source::Photos(_) => format!("{path} has photos but no camera poses"),
            Source::Video(_) => format!("{path} is a video"),
        }
    };
    // Found out before anything takes its time.
    let tools = Tools::find_for(source).with_context(without)?;
    let may_replace = owns_scene(&plan.out);
    let run = folder(args, &plan.out)?;
    let made = free_scene_dir(&run, may_replace).and_then(|()| {
        screen.note(&format!("{}: poses are found by COLMAP", without()));
        let watch = Screen::new(screen);
        let beside = tempfile::Builder::new()
            .prefix(".sos-partial-capture-")
            .tempdir_in(run.root())
            .map_err(|source| RunError::Io {
                action: "write to the folder",
                path: run.root().to_path_buf(),
                source,
            })?;
        let scene = beside.path().join("scene");
        let options = CaptureOptions::default();
        let captured = scene_capture::capture(source, &scene, &tools, &options, &watch)?;
        watch.end_stage();
        if let Some(warning) = &captured.warning {
            screen.warn(warning);
        }
        let imported = scene_import::read(&scene_import::detect(&scene, None)?, None)?;
        let names = imported.model.views.iter().map(|view| view.name.as_str());
        let written = check_names(source.path(), names)
            .map_err(anyhow::Error::from)
            .and_then(|()| write_into_run(&imported, &run, plan, masks, screen));
        // Poses that took an hour are kept whatever becomes of the run, without masks if these are of no use, and results of
        // other ones are not beside them.
        if written.is_err() {
            let bare = run.fresh_scene_dir()?;
            let no_masks = MaskOptions {
                source: MaskSource::None,
                ..MaskOptions::default()
            };
            imported.write(&bare, &no_masks)?;
            run.take_scene(&bare)?;
        }
        // A record of what has been said; the scene is whole without it.
        let _ = std::fs::copy(scene.join(RECORD), run.scene_dir().join(RECORD));
        run.begin()?;
        if written.is_err() {
            say_kept(&run, true);
        }
        written
    });
    let masks_dir = made.inspect_err(|_| {
        // The error that is on its way says more than one from tidying up.
        let _ = run.abandon(false);
    })?;
    let imported = Imported {
        from: source.path().to_path_buf(),
        masks_dir,
        captured: true,
    };
    Ok((run, imported))
}

/// The masks to train with: those stated, or those beside the photos.
fn masks_beside(source: &Source, stated: &MaskSource) -> anyhow::Result<MaskSource> {
    match (source, stated) {
        (Source::Video(video), MaskSource::Path(_)) => Err(InputError::new(
            video,
            "masks are matched to photos by name, and frames of a video have none yet",
            "make a scene with sos capture first, mask the frames in its images/, and train on that",
        )
        .into()),
        (_, MaskSource::Path(path)) if !path.exists() => Err(InputError::new(
            path,
            "there is no such folder or file",
            "give the masks, or --masks none to do without",
        )
        .into()),
        (Source::Photos(photos), MaskSource::Look) if photos.join("masks").is_dir() => {
            Ok(MaskSource::Path(photos.join("masks")))
        }
        _ => Ok(stated.clone()),
    }
}

/// Shows a capture on the screen, and passes Ctrl-C on.
struct Screen<'a> {
    progress: &'a Progress,
    stage: Mutex<Option<(Stage, usize, progress::Stage)>>,
    interrupt: Arc<AtomicBool>,
}

impl<'a> Screen<'a> {
    fn new(progress: &'a Progress) -> Self {
        // Without a handler, Ctrl-C ends all programs of the terminal as it always does.
        let interrupt = watch_interrupt(AtInterrupt::LeaveNothing).unwrap_or_default();
        Self {
            progress,
            stage: Mutex::new(None),
            interrupt,
        }
    }

    fn end_stage(&self) {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

impl Watch for Screen<'_> {
    fn progress(&self, progress: scene_capture::Progress) {
        let scene_capture::Progress { stage, done, total } = progress;
        let mut shown = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        let same = matches!(&*shown, Some((known, parts, _)) if (*known, *parts) == (stage, total));
        if !same {
            // The line of the stage before, first.
            *shown = None;
            *shown = Some((stage, total, self.progress.stage(&stage.to_string(), total)));
        }
        if let Some((_, _, meter)) = &*shown {
            meter.reach(done);
        }
    }

    fn note(&self, sentence: &str) {
        self.end_stage();
        self.progress.note(sentence);
    }

    fn interrupted(&self) -> bool {
        self.interrupt.load(Ordering::SeqCst)
    }
}
