//! A whole run: prepare, train, export.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::Result;
use io_colmap::{MaskSet, Polarity};
use rayon::prelude::*;

use super::Trainer;
use super::checkpoint::frame_of;
use super::found_masks;
use super::probes::Probes;
use crate::device;
use crate::discover::{Hint, Searching, find_object};
use crate::doctor::admission::{Admission, admit};
use crate::export::{LogRecord, TrainLog, read_log, write_cameras, write_mesh, write_view};
use crate::job::{Checks, TrainJob, TrainOutcome};
use crate::live::{LiveView, Wish, attend};
use crate::prepare::error::PrepareError;
use crate::prepare::view::{all_downscaled, load_ignored, load_views};
use crate::prepare::{KnownScene, MaskConsensus, Prepared, Sights, TrainView, prepare_with};
use crate::progress::{AtInterrupt, Progress, ProgressState};
use crate::render::survey::Survey;
use crate::render::view::render_view;
use crate::render::{mesh, preview};

/// Steps between two lines of the log.
const LOG_EVERY: u32 = 50;
/// Steps without a single sample before the run is given up.
const EMPTY_LIMIT: u32 = 200;
/// How often a diverged run is set back before it is given up.
const RESTORE_LIMIT: u32 = 4;
/// Views rendered at once: while one is compressed the other keeps the cores busy, and no more than
/// two need room. Of large ones a single one does: each takes some 100 bytes a pixel.
const VIEWS_AT_ONCE: usize = 2;
const LARGE_PIXELS: u64 = 4_000_000;

/// Trains and exports; see [`TrainJob`].
///
/// # Errors
/// When the input does not work, the run folder cannot be written, or training diverges.
pub fn run(job: &TrainJob) -> Result<TrainOutcome> {
    anyhow::ensure!(
        job.config.steps > 0,
        "the job has no number of steps; TrainConfig::settled finds one"
    );
    let started = Instant::now();
    let progress = Progress::new(job.quiet, job.config.steps).shown_on(job.live.clone());
    let mut log = None;
    for note in job
        .scene
        .notes
        .iter()
        .chain(job.masks.iter().flat_map(|m| &m.notes))
    {
        progress.note(note);
    }
    if let Some(ignored) = &job.ignored {
        let some = ignored.paths.iter().flatten().count();
        let photos = if some == 1 { "photo" } else { "photos" };
        progress.note(&format!("parts of {some} {photos} are not learned from"));
    }
    let Some(MaskedViews {
        views,
        are_found,
        consensus,
        notes: found,
    }) = masked_views(job, &progress)?
    else {
        return Ok(TrainOutcome::NotBegun);
    };
    AtInterrupt::SaveCheckpoint.announce();
    let (points, sizes) = (&job.scene.model.points, &job.config.prepare);
    let band = job.config.loss.ignore_band;
    let frame = match job.resume {
        true => frame_of(&job.run)?,
        false => None,
    };
    let known = KnownScene { consensus, frame };
    let mut data = prepare_with(views, known, points, sizes, band)?;
    if job.config.loss.sight > 0.0 {
        data.sights = Sights::of_points(&job.scene.model);
        if data.sights.is_empty() {
            data.notes.push("loss.sight does nothing: the scene does not say which of its sparse points a view sees".to_owned());
        }
    }
    for note in &data.notes {
        progress.note(note);
    }
    let mut trainer = Trainer::new(&job.config, &data)?;
    if are_found {
        trainer.take_masks_for_rough(data.views.len());
    }
    let remark = device::remark(&job.config.device);
    progress.note(&format!("computing on {}{remark}", trainer.device_name()));
    let mut earlier_seconds = 0.0;
    if job.resume {
        earlier_seconds = trainer.load(&job.run)?;
        trainer.place_cameras(&mut data);
        data.correct_masks(trainer.mask_faults(), sizes, band)?;
        log = Some(TrainLog::resume(&job.run, trainer.step_number())?);
    }
    let mut log = match log {
        Some(log) => log,
        None => {
            let mut log = TrainLog::create(&job.run)?;
            let device = trainer.device_name();
            log.event(0, "start", [("device", device.into())])?;
            let notes = job
                .scene
                .notes
                .iter()
                .chain(&found)
                .chain(&data.notes)
                .map(String::as_str);
            for note in notes {
                log.note(0, note)?;
            }
            log
        }
    };

    if let Some(live) = &job.live {
        let view = |view: &TrainView| LiveView {
            name: view.name.clone(),
            width: view.width(),
            height: view.height(),
            masked: view.mask.is_some(),
        };
        let views = data.views.iter().map(view).collect();
        live.introduce(views, job.config.steps, read_log(&job.run)?);
    }
    let outcome = train(
        job,
        &mut trainer,
        &mut data,
        &mut log,
        &progress,
        earlier_seconds,
    )?;
    if outcome != TrainOutcome::Finished {
        return Ok(outcome);
    }
    let trained = started.elapsed().as_secs_f64() + earlier_seconds;
    if let Some(note) = job.run.forget_verdicts()? {
        progress.note(&note);
    }
    let mut data = at_full_size(data, job)?;
    trainer.place_cameras(&mut data);
    let moved = trainer.has_moved_cameras().then_some(&*data.views);
    write_cameras(&job.run, &job.scene.model, moved)?;
    if !export(job, &trainer, &data, &progress, &mut log)? {
        // The last checkpoint has everything: a resumed run goes straight to the pictures.
        let step = trainer.step_number();
        return Ok(TrainOutcome::Interrupted { step });
    }
    let total = started.elapsed().as_secs_f64() + earlier_seconds;
    log.event(
        trainer.step_number(),
        "end",
        [
            ("seconds", total.into()),
            ("training_seconds", trained.into()),
        ],
    )?;
    Ok(TrainOutcome::Finished)
}

/// Photos with the rough masks that a run begins with.
struct MaskedViews {
    views: Vec<TrainView>,
    /// Whether the run found the masks itself.
    are_found: bool,
    /// What the masks say together, where it is known already.
    consensus: Option<MaskConsensus>,
    /// What a user should know, a sentence each.
    notes: Vec<String>,
}

/// The photos with rough masks: those given, or where these are few or none, those that the search for
/// the object came up with. `None` when it was interrupted.
fn masked_views(job: &TrainJob, progress: &Progress) -> Result<Option<MaskedViews>> {
    if job.resume && job.run.has_found_masks() {
        let found = job.run.found_masks_dir();
        let masks = MaskSet::find(&found, &job.scene, Some(Polarity::WhiteIsObject))?;
        return Ok(Some(MaskedViews {
            views: downscaled(photos(job, Some(&masks))?, job)?,
            are_found: true,
            consensus: None,
            notes: Vec::new(),
        }));
    }
    let mut views = photos(job, job.masks.as_ref())?;
    let Admission {
        mut warnings,
        mut consensus,
    } = match job.checks {
        Checks::Make => admit(job, &views, progress)?,
        Checks::Skip => Admission::default(),
    };
    let is_masked = views.iter().any(|view| view.mask.is_some());
    if consensus.is_none() && is_masked && Hint::of_few_masks(&views).is_none() {
        // Of the photos as they are, as the checks have it.
        let found = MaskConsensus::of(&views, &job.scene.model.points, &job.config.prepare)?;
        if let Some(note) = found.note(&views) {
            progress.note(&note);
            warnings.push(note);
        }
        consensus = Some(found);
    }
    let sizes: Vec<(u32, u32)> = views.iter().map(|v| (v.width(), v.height())).collect();
    views = downscaled(views, job)?;
    let hint = match Hint::of_few_masks(&views) {
        Some(hint) => hint,
        None if !is_masked => job.hint.downscaled(job.config.prepare.downscale),
        None => {
            return Ok(Some(MaskedViews {
                views,
                are_found: false,
                consensus,
                notes: warnings,
            }));
        }
    };
    let (mut stage, mut regions) = (None, 0);
    let discovery = find_object(
        &views,
        &job.scene.model.points,
        &Sights::of_points(&job.scene.model),
        &hint,
        &job.config,
        &job.interrupt,
        |searching, done, all| {
            if done == 1 {
                regions += u32::from(searching == Searching::Region);
                let label = match regions {
                    0 => "looking for the object: what photos agree on",
                    1 => "looking for the object",
                    // It goes on beyond the one before.
                    _ => "looking for the object in a larger region",
                };
                stage = Some(progress.stage(label, all as usize));
            }
            stage.iter_mut().for_each(|stage| stage.advance());
        },
    )?;
    drop(stage);
    let Some(discovery) = discovery else {
        return Ok(None);
    };
    for note in &discovery.notes {
        progress.note(note);
    }
    found_masks::keep(&job.run, &mut views, &sizes, &discovery.masks)?;
    Ok(Some(MaskedViews {
        views,
        are_found: true,
        consensus: None,
        notes: [warnings, discovery.notes].concat(),
    }))
}

/// The views at their full size.
fn photos(job: &TrainJob, masks: Option<&MaskSet>) -> Result<Vec<TrainView>, PrepareError> {
    let mut views = load_views(&job.scene, masks)?;
    if let Some(ignored) = &job.ignored {
        load_ignored(&mut views, ignored)?;
    }
    Ok(views)
}

/// The views at the size that is trained on.
fn downscaled(views: Vec<TrainView>, job: &TrainJob) -> Result<Vec<TrainView>, PrepareError> {
    match job.config.prepare.downscale {
        0 | 1 => Ok(views),
        factor => all_downscaled(views, factor),
    }
}

/// The scene with its photos as they are, which the pictures are drawn from. Labels are of the size
/// that was trained on, and no longer asked for.
fn at_full_size(mut data: Prepared, job: &TrainJob) -> Result<Prepared, PrepareError> {
    if job.config.prepare.downscale > 1 {
        // Given back first: both together might be too much for the memory.
        data.views.clear();
        data.given_masks.clear();
        data.outlines.clear();
        data.views = photos(job, None)?;
    }
    Ok(data)
}

fn train(
    job: &TrainJob,
    trainer: &mut Trainer,
    data: &mut Prepared,
    log: &mut TrainLog,
    progress: &Progress,
    earlier_seconds: f64,
) -> Result<TrainOutcome> {
    let config = &job.config;
    let started = Instant::now();
    let mut probes = Probes::new(data, config);
    let (mut since, mut samples, mut mse, mut steps) = (Instant::now(), 0usize, 0.0, 0u32);
    let mut restores = 0;
    // Time in which the run was paused.
    let mut paused = Duration::ZERO;
    let elapsed = |paused: Duration| earlier_seconds + (started.elapsed() - paused).as_secs_f64();
    if trainer.step_number() < config.steps {
        progress.begin(trainer.step_number());
    }
    while trainer.step_number() < config.steps {
        let faults = match trainer.correct_masks(data) {
            Ok(faults) => faults,
            Err(error) => {
                // A run goes on from here once there is room again.
                trainer.save(&job.run, elapsed(paused))?;
                return Err(error.into());
            }
        };
        trainer.find_alike(data);
        let edges = trainer.contrast_note(data);
        for note in faults
            .into_iter()
            .chain(trainer.refine_cameras(data)?)
            .chain(trainer.majority_note())
            .chain(trainer.contested_note(data))
            .chain(edges)
        {
            progress.note(&note);
            log.note(trainer.step_number(), &note)?;
        }
        let report = trainer.step(data);
        let step = trainer.step_number();
        if trainer.empty_batches() > EMPTY_LIMIT {
            return Err(PrepareError::Empty(EMPTY_LIMIT).into());
        }
        if !report.is_finite() {
            restores += 1;
            if restores > RESTORE_LIMIT {
                return Err(PrepareError::Diverged(step).into());
            }
            trainer.recover(&job.run, data)?;
            // Steps that are done again would be there twice.
            log.go_back(&job.run, trainer.step_number())?;
            let text = format!(
                "step {step} gave a loss that is no number; back to step {} at half the learning \
                 rates",
                trainer.step_number()
            );
            progress.note(&text);
            log.note(trainer.step_number(), &text)?;
            continue;
        }
        samples += report.object_samples + report.background_samples;
        mse += report.losses.mse;
        steps += 1;
        progress.tick(step);
        let mut finish = false;
        if let Some(live) = &job.live {
            let (waited, wish) = attend(live, trainer, data);
            paused += waited;
            since += waited;
            finish = wish == Wish::Finish;
        }
        let interrupted = job.interrupt.load(Ordering::Relaxed);
        if step.is_multiple_of(LOG_EVERY) || step == config.steps {
            let seconds = since.elapsed().as_secs_f64();
            let psnr = -10.0 * (mse / steps as f32).max(1e-10).log10();
            let alpha_change = step
                .is_multiple_of(4 * LOG_EVERY)
                .then(|| probes.change(trainer))
                .flatten();
            let rate = (samples as f64 / seconds) as f32;
            let [b, b_background] = trainer.sharpness();
            let record = LogRecord {
                step,
                seconds: elapsed(paused),
                psnr,
                sharpness: b,
                sharpness_background: Some(b_background),
                samples_per_second: rate,
                rays: report.rays as u32,
                levels: report.active_levels as u32,
                learning_rate: trainer.learning_rate(),
                occupied: Some(trainer.grids().object_share()),
                alpha_change,
                losses: report
                    .losses
                    .named()
                    .map(|(name, value)| (name.to_owned(), value))
                    .into(),
            };
            log.record(&record)?;
            if let Some(live) = &job.live {
                live.record(&record);
            }
            progress.update(&ProgressState {
                step,
                psnr,
                alpha_change,
                samples_per_second: rate,
            });
            (since, samples, mse, steps) = (Instant::now(), 0, 0.0, 0);
        }
        if step.is_multiple_of(config.export.preview_every) && step < config.steps {
            preview::write(&job.run, &trainer.freeze(), data)?;
        }
        let seconds = elapsed(paused);
        if interrupted {
            // The checkpoint that is there is better than one of fields that are no numbers.
            if trainer.settle().is_finite() {
                trainer.save(&job.run, seconds)?;
            }
            return Ok(TrainOutcome::Interrupted { step });
        }
        if step.is_multiple_of(config.export.checkpoint_every) || step == config.steps {
            trainer.save(&job.run, seconds)?;
        } else if finish && trainer.settle().is_finite() {
            trainer.save(&job.run, seconds)?;
            let text = format!(
                "ended early, at step {step} of {}; --resume goes on from there",
                config.steps
            );
            progress.note(&text);
            log.note(step, &text)?;
            break;
        }
    }
    Ok(TrainOutcome::Finished)
}

/// Writes all pictures and the mesh; `false` when it was interrupted.
fn export(
    job: &TrainJob,
    trainer: &Trainer,
    data: &Prepared,
    progress: &Progress,
    log: &mut TrainLog,
) -> Result<bool> {
    let scene = trainer.freeze();
    let mut begun = Instant::now();
    let mut seconds = || {
        let seconds = begun.elapsed().as_secs_f64();
        begun = Instant::now();
        seconds
    };
    let stage = progress.stage("surveying the views", data.views.len());
    let survey = Survey::new(&scene, data, || stage.advance());
    drop(stage);
    let survey_seconds = seconds();
    let stage = progress.stage("rendering mattes and plates", data.views.len());
    let indices: Vec<usize> = (0..data.views.len()).collect();
    let pixels = |view: &TrainView| u64::from(view.width()) * u64::from(view.height());
    let large = data.views.iter().any(|view| pixels(view) > LARGE_PIXELS);
    for pair in indices.chunks(if large { 1 } else { VIEWS_AT_ONCE }) {
        if job.interrupt.load(Ordering::Relaxed) {
            return Ok(false);
        }
        pair.par_iter().try_for_each(|&index| {
            let view = render_view(&scene, data, &survey, index);
            if index == 0 {
                preview::write_finished(&job.run, &data.views[0].photo, &view)?;
            }
            write_view(&job.run, &view)
        })?;
        pair.iter().for_each(|_| stage.advance());
    }
    drop(stage);
    let views_seconds = seconds();
    match mesh::extract(&scene, &data.frame, job.config.export.mesh_resolution) {
        Ok(mesh) => write_mesh(&job.run, &mesh)?,
        Err(error) => {
            // One that is there is of an earlier end of this run.
            job.run.forget_mesh()?;
            progress.note(&format!("no mesh.ply: {error}"));
        }
    }
    log.event(
        trainer.step_number(),
        "export",
        [
            ("survey_seconds", survey_seconds.into()),
            ("views_seconds", views_seconds.into()),
            ("mesh_seconds", seconds().into()),
        ],
    )?;
    Ok(true)
}
