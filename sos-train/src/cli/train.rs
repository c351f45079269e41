//! `sos train`.

use super::answer::Voice;
use super::capture::{capture_for_run, source_without_poses};
use super::import::{Imported, import_for_run, is_ready};
use super::input::{Plan, Source, generate_demo, mask_folder, owns_scene, record_input};
use super::resumed::{check_photos, explain_resumed};
use super::{TrainArgs, evaluate, program};
use crate::audit::Metrics;
use crate::config::{MaskPolarity, RunRecord, TrainConfig};
use crate::device::{DeviceKind, choose};
use crate::discover::Hint;
use crate::doctor::room;
use crate::error::{EXIT_INTERRUPTED, EXIT_OK, InputError};
use crate::export::{check_names, read_log};
use crate::job::{Checks, TrainJob, TrainOutcome};
use crate::live::{Live, LiveError, LiveServer};
use crate::prepare::view::find_ignored;
use crate::progress::{AtInterrupt, Progress, watch_interrupt};
use crate::run_folder::{Existing, RunError, RunFolder};
use io_colmap::{MaskSet, Scene};
use scene_export::quoted;
use serde::Serialize;
use serde_json::{Map, Value};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Trains, and says where everything is.
pub(super) fn train(args: &TrainArgs) -> anyhow::Result<u8> {
    let (code, run) = train_run(args)?;
    let finished = code == EXIT_OK;
    let voice = Voice::of(args.json, args.quiet);
    // How to go on has been said where it was stopped.
    if finished || voice == Voice::Json {
        let sentence = format!("everything is in {}; start with report.html", run.display());
        voice.answer(&Trained::at(&run, finished), &sentence)?;
    }
    Ok(code)
}

/// What a run came to.
#[derive(Serialize)]
struct Trained {
    run: PathBuf,
    finished: bool,
    /// Only of a run that has finished, as what follows.
    report: Option<PathBuf>,
    seconds: Option<f64>,
    metrics: Option<Metrics>,
}

impl Trained {
    fn at(path: &Path, finished: bool) -> Self {
        let folder = RunFolder::open_existing(path).ok().filter(|_| finished);
        Self {
            run: path.to_path_buf(),
            finished,
            report: folder.as_ref().map(RunFolder::report_path),
            seconds: folder.as_ref().and_then(whole_seconds),
            metrics: folder.as_ref().map(Metrics::read),
        }
    }
}

/// How long a run took with all its pictures, by its log.
pub(super) fn whole_seconds(run: &RunFolder) -> Option<f64> {
    let log = read_log(run).ok()?;
    let ends = |line: &&Map<String, Value>| line.get("event").is_some_and(|event| event == "end");
    let end = log.iter().rev().find(ends)?;
    end.get("seconds").and_then(Value::as_f64)
}

/// Trains; gives the exit code and the run's folder.
pub(super) fn train_run(args: &TrainArgs) -> anyhow::Result<(u8, PathBuf)> {
    let plan = Plan::new(args)?;
    let screen = Progress::new(args.quiet, 0);
    // Before poses are found, which may take an hour.
    if let Some(port) = args.view.filter(|port| *port > 0) {
        LiveServer::check(port)?;
    }
    if let Some(note) = &plan.note {
        screen.note(note);
    }
    let resumed = plan.resumed.clone();
    let demo = plan.source == Source::Demo;
    let site = match &plan.source {
        Source::Demo => Site::made_in(prepare_demo(args, &plan, &screen)?),
        Source::Folder(scene) => match source_without_poses(scene) {
            Some(photos) => Site::imported(capture_for_run(args, &plan, &photos, &screen)?),
            None if is_ready(scene, &plan.masks, plan.label)? => Site::there(scene),
            None => Site::imported(import_for_run(args, &plan, scene, &screen)?),
        },
    };
    // A scene that was made for this run goes with it; one to go on with stays.
    let made = site.run.clone();
    let captured = site.imported.as_ref().is_some_and(|scene| scene.captured);
    let owns_scene = made.is_some() && !args.resume && !captured;
    let ready = open(args, &plan, site, &screen).inspect_err(|_| {
        if let Some(run) = made.filter(|_| !demo && !args.resume) {
            // The error that is on its way says more than one from tidying up.
            let _ = run.abandon(owns_scene);
            say_kept(&run, captured);
        }
    })?;
    let run = ready.run.clone();
    let device = stated_device(&ready.config.device);
    match start(args, plan, ready, &screen) {
        Ok(TrainOutcome::Finished) => {
            finish(&run, demo, &screen)?;
            Ok((EXIT_OK, run.root().to_path_buf()))
        }
        Ok(TrainOutcome::NotBegun) => {
            if !args.resume {
                run.abandon(owns_scene)?;
            }
            let _ = writeln!(
                std::io::stderr(),
                "stopped while looking for the object; nothing is left to go on from"
            );
            say_kept(&run, captured);
            Ok((EXIT_INTERRUPTED, run.root().to_path_buf()))
        }
        Ok(TrainOutcome::Interrupted { step }) => {
            let _ = writeln!(
                std::io::stderr(),
                "stopped at step {step} with a checkpoint saved; go on with: {} train --resume --out {}{device}",
                program(),
                quoted(run.root())
            );
            Ok((EXIT_INTERRUPTED, run.root().to_path_buf()))
        }
        Err(error) => {
            // Input that cannot be used leaves nothing behind; a run that got somewhere does. A checkpoint that is there before a
            // run has begun is an earlier one's.
            let got_somewhere = run.has_begun() && run.has_checkpoint();
            if !args.resume && !got_somewhere {
                // The error that is on its way says more than one from tidying up.
                let _ = run.abandon(owns_scene);
                say_kept(&run, captured);
            }
            Err(match &resumed {
                Some(from) => explain_resumed(&run, from, error),
                None => error,
            })
        }
    }
}

/// What a command line says of a GPU. `config.toml` has it too, but what builds the program only sees
/// the line.
pub(super) fn stated_device(name: &str) -> String {
    match name {
        "wgpu" | "cuda" => format!(" --device {name}"),
        _ => String::new(),
    }
}

/// Says where a scene is that outlives its run: COLMAP's work is not thrown away.
pub(super) fn say_kept(run: &RunFolder, captured: bool) {
    if captured {
        let scene = quoted(&run.scene_dir());
        let _ = writeln!(
            std::io::stderr(),
            "the poses that were found are kept in {scene}; go on with: {} train {scene} --out {}",
            program(),
            quoted(run.root())
        );
    }
}

/// Where the scene is.
struct Site {
    scene_dir: PathBuf,
    /// The run in whose folder it was made.
    run: Option<RunFolder>,
    /// What it was made from, if not by the demo.
    imported: Option<Imported>,
}

impl Site {
    fn there(scene: &Path) -> Self {
        Self {
            scene_dir: scene.to_path_buf(),
            run: None,
            imported: None,
        }
    }

    fn made_in(run: RunFolder) -> Self {
        Self {
            scene_dir: run.scene_dir(),
            run: Some(run),
            imported: None,
        }
    }

    fn imported((run, imported): (RunFolder, Imported)) -> Self {
        Self {
            imported: Some(imported),
            ..Self::made_in(run)
        }
    }
}

/// Everything opened and checked.
struct Ready {
    /// With its steps settled.
    config: TrainConfig,
    scene_dir: PathBuf,
    scene: Scene,
    masks: Option<MaskSet>,
    ignored: Option<MaskSet>,
    run: RunFolder,
}

/// Opens scene, masks and run folder, in this order: no folder is made for a bad scene.
fn open(args: &TrainArgs, plan: &Plan, site: Site, screen: &Progress) -> anyhow::Result<Ready> {
    let Site {
        scene_dir,
        run,
        imported,
    } = site;
    let demo = plan.source == Source::Demo;
    let scene = Scene::open(&scene_dir)?;
    let names = scene.model.views.iter().map(|view| view.name.as_str());
    check_names(&scene_dir, names)?;
    check_photos(plan, &scene_dir, &scene.model)?;
    let config = plan.config.settled(&scene.model);
    // Where memory suffices, no driver is asked: that takes its time, and some drivers talk on standard error.
    if let Some(memory) = room::of_machine()
        && let Err(error) = room::check(&config, &scene.model, memory)
        && is_on_processor(&config.device)
    {
        return Err(error.into());
    }
    let (masks_dir, hint) = match &imported {
        Some(imported) => (imported.masks_dir.clone(), None),
        None => mask_folder(&plan.masks, &scene_dir, demo),
    };
    // Imported masks are white on black, whatever they were before.
    let polarity = match &imported {
        Some(_) => Some(MaskPolarity::White),
        None => plan.polarity,
    };
    let masks = masks_dir
        .as_deref()
        .map(|dir| MaskSet::find(dir, &scene, polarity.map(Into::into)))
        .transpose()?;
    if let Some(dir) = &masks_dir {
        refuse_hints(args.click.is_some(), args.object_box.is_some(), dir)?;
    }
    let ignored = plan.ignore.as_deref();
    let ignored = ignored.map(|dir| find_ignored(dir, &scene)).transpose()?;
    // Notes on scene and masks are left to training, which has more of them.
    if let Some(hint) = hint {
        screen.note(&hint);
    }
    let run = match run {
        Some(run) => run,
        None => folder(args, &plan.out)?,
    };
    // A scene that is imported once more, for other masks, was once made from something else.
    let imported_from = plan
        .imported_from
        .clone()
        .or_else(|| imported.map(|imported| imported.from));
    let input = record_input(
        plan,
        &scene,
        masks_dir.as_deref(),
        polarity,
        imported_from.as_deref(),
    );
    let record = RunRecord::new(config.clone(), input).to_toml()?;
    if run.has_begun() {
        run.write_durably(&run.config_path(), |out| out.write_all(record.as_bytes()))?;
    } else {
        run.set_config(record);
    }
    Ok(Ready {
        config,
        scene_dir,
        scene,
        masks,
        ignored,
        run,
    })
}

/// Whether tables and samples take this machine's own memory. What cannot be chosen is refused by training.
fn is_on_processor(device: &str) -> bool {
    choose(device).is_ok_and(|chosen| chosen.kind == DeviceKind::Processor)
}

pub(super) fn folder(args: &TrainArgs, path: &Path) -> Result<RunFolder, RunError> {
    if args.resume {
        RunFolder::go_on(path)
    } else {
        RunFolder::create(
            path,
            if args.force {
                Existing::Replace
            } else {
                Existing::Keep
            },
        )
    }
}

/// Masks say where the object is, and are asked first: a pixel or box beside them would go unheard.
pub(super) fn refuse_hints(click: bool, object_box: bool, masks: &Path) -> Result<(), InputError> {
    let option = match (click, object_box) {
        (true, _) => "--click",
        (_, true) => "--box",
        (false, false) => return Ok(()),
    };
    Err(InputError::new(
        masks,
        format!("these masks say where the object is already, so {option} would say nothing"),
        format!("leave {option} out, or add --masks none to do without the masks"),
    ))
}

/// The run's folder with the demo scene in it.
fn prepare_demo(args: &TrainArgs, plan: &Plan, screen: &Progress) -> anyhow::Result<RunFolder> {
    // Said before the scene is drawn.
    if let (Some(masks), _) = mask_folder(&plan.masks, &RunFolder::scene_in(&plan.out), true) {
        refuse_hints(args.click.is_some(), args.object_box.is_some(), &masks)?;
    }
    let was_ours = owns_scene(&plan.out);
    let run = folder(args, &plan.out)?;
    run.begin()?;
    let dir = run.scene_dir();
    if was_ours && args.force && dir.is_dir() {
        std::fs::remove_dir_all(&dir).map_err(|source| RunError::Io {
            action: "remove",
            path: dir.clone(),
            source,
        })?;
    }
    if !(args.resume && dir.is_dir()) {
        screen.note("the demo scene is generated");
        generate_demo(&dir)?;
    }
    Ok(run)
}

fn start(
    args: &TrainArgs,
    plan: Plan,
    ready: Ready,
    screen: &Progress,
) -> anyhow::Result<TrainOutcome> {
    // While an object is looked for there is nothing to save yet.
    let then = if args.resume || ready.masks.is_some() {
        AtInterrupt::SaveCheckpoint
    } else {
        AtInterrupt::LeaveNothing
    };
    let interrupt = watch_interrupt(then).unwrap_or_else(|error| {
        screen.warn(&format!(
            "Ctrl-C will stop the run without saving ({error})"
        ));
        Arc::new(AtomicBool::new(false))
    });
    let given = match plan.source {
        Source::Folder(scene) => scene,
        Source::Demo => ready.scene_dir,
    };
    let live = args.view.map(|port| show(port, &ready.run, &interrupt));
    let (live, _server) = live.transpose()?.unzip();
    crate::train::run(&TrainJob {
        config: ready.config,
        given,
        // A run that goes on was let in once.
        checks: if args.skip_checks || args.resume {
            Checks::Skip
        } else {
            Checks::Make
        },
        scene: ready.scene,
        masks: ready.masks,
        ignored: ready.ignored,
        hint: Hint::stated(plan.click, plan.object_box),
        run: ready.run,
        resume: args.resume,
        quiet: args.quiet,
        interrupt,
        live,
    })
}

/// Opens the page of a run, and says where; port 0 is any.
fn show(
    port: u16,
    run: &RunFolder,
    interrupt: &Arc<AtomicBool>,
) -> Result<(Arc<Live>, LiveServer), LiveError> {
    let live = Arc::new(Live::new(
        run.root().display().to_string(),
        Arc::clone(interrupt),
    ));
    let server = LiveServer::start(Arc::clone(&live), (port > 0).then_some(port))?;
    // Asked for, and so said even if all else is quiet.
    let _ = writeln!(
        std::io::stderr(),
        "the run is shown at {}",
        server.address()
    );
    Ok((live, server))
}

/// Scores a run of the demo, writes the report.
fn finish(run: &RunFolder, demo: bool, screen: &Progress) -> anyhow::Result<()> {
    if demo {
        let scene = run.scene_dir();
        let report = sos_eval::run_eval(run.root(), &scene, Some(&scene.join("coarse_masks")))?;
        screen.note(&report.to_string());
        let metrics = Metrics {
            scores: Some(report),
            audit: None,
        };
        metrics.write(run)?;
    }
    evaluate::make_report(run, None)?;
    Ok(())
}
