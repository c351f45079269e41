//! `sos results`: scenes with ground truth, each from several kinds of masks, in one table.

use super::answer::Voice;
use super::hull::write_hull;
use super::input::{NO_MASKS, Plan, generate_demo};
use super::kept_run::{self, Made, State, rough_masks_beside, words_of};
use super::train::whole_seconds;
use super::{RenderArgs, ResultsArgs, TrainArgs, render};
use crate::error::{EXIT_OK, InputError};
use crate::results::{Results, Row, Run, Start};
use crate::run_folder::{RunFolder, write_whole};
use io_colmap::Scene;
use sos_eval::{AlphaScore, EvalError, Fault, compare_folders, degrade_folder, run_eval};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Size of a fault, and the seed of what is left to chance in it: as `sos degrade` has them.
const FAULT: (f64, u64) = (0.2, 1);

/// Names of the table's files.
const TABLE_FILES: [&str; 2] = ["results.md", "results.json"];

/// Trains what is not there yet, scores everything, writes the table.
pub(super) fn results(args: &ResultsArgs) -> anyhow::Result<u8> {
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| Path::new("runs").join("results"));
    kept_run::check_place(&out, TABLE_FILES[1], is_place)?;
    let places = Place::all(args, &out)?;
    let cases = Case::all(args, &places, &out)?;
    let seeds = seeds(args)?;
    let runs: Vec<(&Case<'_>, u64)> = cases
        .iter()
        .flat_map(|case| seeds.iter().map(move |&seed| (case, seed)))
        .collect();
    // All that is there must belong to this table, before hours are spent on what is not.
    for (case, seed) in &runs {
        kept_run::check(&case.command(args, *seed))?;
    }
    if !args.table.quiet {
        let there =
            |(case, seed): &&(&Case<'_>, u64)| State::of(&case.run(*seed)) == State::Finished;
        let there = runs.iter().filter(there).count();
        let _ = writeln!(
            std::io::stderr(),
            "{} runs are to be made, {there} are there",
            runs.len() - there
        );
    }
    let name = |(case, seed): &(&Case<'_>, u64)| (case.title(*seed), case.run(*seed));
    let tried = match kept_run::make_all(&runs, name, |(case, seed)| case.make(args, *seed)) {
        Made::Stopped(code) => return Ok(code),
        Made::Tried(tried) => tried,
    };
    let rows = cases.iter().map(|case| case.row(&seeds));
    let rows = rows.collect::<Result<Vec<_>, _>>()?;
    let results = Results::new(
        words_of(args.table.preset, &args.table.settings),
        rows.into_iter()
            .filter(|row| !row.runs.is_empty())
            .collect(),
    );
    // First: it may not be printed, and is what took the time.
    let [markdown, json] = TABLE_FILES.map(|name| out.join(name));
    write_whole(&markdown, results.markdown().as_bytes())?;
    write_whole(&json, serde_json::to_string_pretty(&results)?.as_bytes())?;
    Voice::of(args.table.json, false).answer(&results, &results.table())?;
    if !args.table.quiet {
        let _ = writeln!(std::io::stderr(), "the table is in {}", markdown.display());
    }
    tried.map(|()| EXIT_OK)
}

/// Whether a folder is what a table's runs of a scene are in.
fn is_place(folder: &Path) -> bool {
    let starts = Start::every().map(|start| start.name());
    // The demo's own scene is made before its first run.
    let mut own = starts.chain(["scene".to_owned()]);
    let begun = |mut entries: fs::ReadDir| {
        entries.all(|entry| {
            let name = entry.map(|entry| entry.file_name()).unwrap_or_default();
            name.to_string_lossy().starts_with(draft_folder::PREFIX)
        })
    };
    own.any(|name| folder.join(name).is_dir()) || fs::read_dir(folder).is_ok_and(begun)
}

/// The settings' seed and those after it.
fn seeds(args: &ResultsArgs) -> anyhow::Result<Vec<u64>> {
    let plain = TrainArgs {
        preset: args.table.preset,
        settings: args.table.settings.clone(),
        ..TrainArgs::default()
    };
    let first = Plan::new(&plain)?.config.seed;
    Ok((0..u64::from(args.table.seeds))
        .map(|i| first.wrapping_add(i))
        .collect())
}

/// A scene with truth.
struct Place {
    name: String,
    scene: PathBuf,
    /// Where its photos are.
    photos: PathBuf,
    /// The rough masks that came with it.
    own: Option<PathBuf>,
}

impl Place {
    /// The scenes that were named, or the demo.
    fn all(args: &ResultsArgs, out: &Path) -> anyhow::Result<Vec<Self>> {
        if args.scenes.is_empty() {
            let demo = out.join("demo").join("scene");
            // Renamed when complete.
            if !demo.is_dir() {
                generate_demo(&demo)?;
            }
            return Ok(vec![Self::find(&demo, "demo".to_owned())?]);
        }
        let mut places: Vec<Self> = Vec::new();
        for scene in &args.scenes {
            let full = fs::canonicalize(scene).unwrap_or_else(|_| scene.clone());
            let name = full.file_name().unwrap_or("scene".as_ref());
            let name = name.to_string_lossy().into_owned();
            if places.iter().any(|other| other.name == name) {
                let wrong = format!("two of the scenes are called {name}");
                return Err(InputError::new(scene, wrong, "rename one of them").into());
            }
            places.push(Self::find(scene, name)?);
        }
        Ok(places)
    }

    fn find(scene: &Path, name: String) -> anyhow::Result<Self> {
        let photos = Scene::open(scene)?.image_dir;
        if !scene.join("alpha_gt").is_dir() {
            let wrong = "there is no alpha_gt/ to score against";
            let remedy = "put the true mattes there, a picture per photo";
            return Err(InputError::new(scene, wrong, remedy).into());
        }
        Ok(Self {
            name,
            photos,
            own: rough_masks_beside(scene),
            scene: scene.to_path_buf(),
        })
    }
}

/// A scene with what its runs begin with.
struct Case<'a> {
    place: &'a Place,
    start: Start,
    /// Where all of it goes.
    dir: PathBuf,
    masks: Option<PathBuf>,
}

impl<'a> Case<'a> {
    /// Every scene with every start that was asked for, and that it has.
    fn all(args: &ResultsArgs, places: &'a [Place], out: &Path) -> Result<Vec<Self>, InputError> {
        let starts: Vec<Start> = if args.start.is_empty() {
            Start::every().collect()
        } else {
            args.start.clone()
        };
        let mut cases = Vec::new();
        for place in places {
            for &start in &starts {
                let dir = out.join(&place.name).join(start.name());
                let masks = match start {
                    Start::Nothing => None,
                    Start::Fault(_) => Some(dir.join("masks")),
                    Start::Own if place.own.is_some() => place.own.clone(),
                    // Of a whole table that row is left out.
                    Start::Own if args.start.is_empty() => continue,
                    Start::Own => {
                        let wrong = "the scene has no masks of its own";
                        let remedy = "put them into its folder masks/, or leave out --start own";
                        return Err(InputError::new(&place.scene, wrong, remedy));
                    }
                };
                cases.push(Self {
                    place,
                    start,
                    dir,
                    masks,
                });
            }
        }
        Ok(cases)
    }

    fn title(&self, seed: u64) -> String {
        format!("{}, {}, seed {seed}", self.place.name, self.start.title())
    }

    /// The run's folder.
    fn run(&self, seed: u64) -> PathBuf {
        self.dir.join(format!("seed{seed}"))
    }

    fn hull(&self) -> PathBuf {
        self.dir.join("hull")
    }

    /// What `sos train` would be asked for a run.
    fn command(&self, args: &ResultsArgs, seed: u64) -> TrainArgs {
        let mut settings = args.table.settings.clone();
        // Last of all: it is to hold whatever the user's settings say of the first one.
        settings.set.push(format!("seed={seed}"));
        TrainArgs {
            scene: Some(self.place.scene.clone()),
            masks: Some(self.masks.clone().unwrap_or_else(|| NO_MASKS.into())),
            out: Some(self.run(seed)),
            preset: args.table.preset,
            settings,
            skip_checks: args.table.skip_checks,
            quiet: args.table.quiet,
            ..TrainArgs::default()
        }
    }

    /// Makes masks, hull, run and held-out views that are missing; gives the exit code.
    fn make(&self, args: &ResultsArgs, seed: u64) -> anyhow::Result<u8> {
        let say = |what: &str| {
            if !args.table.quiet {
                let _ = writeln!(std::io::stderr(), "== {}: {what}", self.title(seed));
            }
        };
        let Place { scene, photos, .. } = self.place;
        if let Some(masks) = &self.masks {
            // Both appear when they are complete.
            if let Start::Fault(fault) = self.start
                && !masks.is_dir()
            {
                self.degrade(fault, photos, masks)?;
            }
            if !self.hull().is_dir() {
                write_hull(scene, masks, None, &self.hull())?;
            }
        }
        let run = self.run(seed);
        if State::of(&run) == State::Finished {
            say("is there");
        } else {
            say("training");
            let code = kept_run::complete(self.command(args, seed))?;
            if code != EXIT_OK {
                return Ok(code);
            }
        }
        let views = scene.join("heldout");
        if heldout_truth(scene).is_dir() && !heldout(&run).is_dir() {
            return render::render(&RenderArgs {
                views: Some(views),
                out: Some(heldout(&run)),
                quiet: true,
                ..RenderArgs::of(run)
            });
        }
        Ok(EXIT_OK)
    }

    fn degrade(&self, fault: Fault, photos: &Path, masks: &Path) -> anyhow::Result<()> {
        let truth = self.place.scene.join("alpha_gt");
        let (share, seed) = FAULT;
        let made = degrade_folder(&truth, photos, fault, share, seed, masks)?;
        for note in made.notes {
            let _ = writeln!(std::io::stderr(), "{note}");
        }
        Ok(())
    }

    /// Scores what is there.
    fn row(&self, seeds: &[u64]) -> anyhow::Result<Row> {
        let truth = self.place.scene.join("alpha_gt");
        let score = |dir: &Path| mean_score(dir, &truth);
        let runs = seeds.iter().map(|&seed| (seed, self.run(seed)));
        let finished = runs.filter(|(_, run)| State::of(run) == State::Finished);
        let scored = finished.map(|(seed, dir)| {
            let found = dir.join("found_masks");
            let seen = heldout(&dir).join("object");
            anyhow::Ok(Run {
                seed,
                seconds: RunFolder::open_existing(&dir)
                    .ok()
                    .and_then(|run| whole_seconds(&run)),
                found: if self.masks.is_none() {
                    score(&found)?
                } else {
                    None
                },
                report: run_eval(&dir, &self.place.scene, None)?,
                heldout: mean_score(&seen, &heldout_truth(&self.place.scene))?,
                folder: dir.display().to_string(),
            })
        });
        Ok(Row {
            scene: self.place.name.clone(),
            start: self.start,
            runs: scored.collect::<Result<_, _>>()?,
            masks: self.masks.as_deref().map_or(Ok(None), score)?,
            hull: score(&self.hull())?,
        })
    }
}

/// True mattes of views that no run is given.
fn heldout_truth(scene: &Path) -> PathBuf {
    scene.join("heldout").join("alpha_gt")
}

/// What a run makes of those views.
fn heldout(run: &Path) -> PathBuf {
    run.join("render").join("heldout")
}

/// Scores of a folder of mattes; none where there is no such folder.
fn mean_score(dir: &Path, truth: &Path) -> Result<Option<AlphaScore>, EvalError> {
    if !dir.is_dir() {
        return Ok(None);
    }
    Ok(Some(compare_folders(dir, truth, None)?.mean))
}
