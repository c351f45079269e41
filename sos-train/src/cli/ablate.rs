//! `sos ablate`: the rows of the paper's table on one scene, each a run of its own.

use super::answer::Voice;
use super::hull::{write_hull, write_masks};
use super::input::{Plan, mask_source};
use super::kept_run::{self, Made, State, rough_masks_beside, words_of};
use super::train::whole_seconds;
use super::{AblateArgs, SettingArgs, TrainArgs, program};
use crate::ablation::{Ablation, DECISIONS, Kind, RIVALS, Row, Scored, Start, TABLE, Trial};
use crate::error::{EXIT_OK, InputError};
use crate::report::comparison_page;
use crate::run_folder::{RunError, RunFolder, write_whole};
use io_colmap::{MaskSet, Scene};
use scene_import::MaskSource;
use sos_eval::{Contender, compare_contenders, mattes_by_view};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Names of the table's files.
const TABLE_FILES: [&str; 3] = ["ablation.md", "ablation.json", "ablation.html"];

/// Trains what is not there yet, scores everything, writes the table.
pub(super) fn ablate(args: &AblateArgs) -> anyhow::Result<u8> {
    let place = Place::find(args)?;
    let rows = place.trials(args, wanted(args))?;
    // All that is there must belong to this table, before hours are spent on what is not.
    for trial in &rows {
        place.check(args, trial)?;
    }
    // What takes no time first: it also shows whether the truth fits.
    let (quick, slow): (Vec<Trial>, Vec<Trial>) = rows
        .iter()
        .partition(|trial| !matches!(trial.row.kind, Kind::Run { .. }));
    for trial in &quick {
        place.make(args, trial)?;
    }
    let name = |trial: &Trial| {
        let title = format!("the row {:?}", trial.title());
        (title, place.out.join(trial.folder()))
    };
    // That a part of the method does not do alone is a result as well.
    match kept_run::make_all(&slow, name, |trial| place.make(args, trial)) {
        Made::Stopped(code) => Ok(code),
        Made::Tried(tried) => {
            place.summarise(args)?;
            tried.map(|()| EXIT_OK)
        }
    }
}

/// The rows that were asked for.
fn wanted(args: &AblateArgs) -> Vec<Row> {
    if !args.only.is_empty() {
        return args.only.clone();
    }
    let mut rows = if args.decisions {
        // What they are to be compared with.
        Row::named("all").into_iter().collect()
    } else {
        TABLE.to_vec()
    };
    if args.rivals {
        rows.extend(RIVALS);
    }
    if args.decisions {
        rows.extend(DECISIONS);
    }
    rows
}

/// Where everything is.
struct Place {
    masks: PathBuf,
    gt: PathBuf,
    out: PathBuf,
}

impl Place {
    /// Finds scene, masks and truth, and opens them.
    fn find(args: &AblateArgs) -> anyhow::Result<Self> {
        let scene = Scene::open(&args.scene)?;
        let masks = match mask_source(args.masks.as_deref()) {
            MaskSource::Path(path) if !path.is_file() => Some(path),
            MaskSource::Look => rough_masks_beside(&args.scene),
            MaskSource::Path(_) | MaskSource::Alpha | MaskSource::None => None,
        };
        let masks = masks.ok_or_else(|| {
            InputError::new(
                &args.scene,
                "the table's rows need a folder of rough masks",
                "give it with --masks; sos import makes one of other kinds of masks",
            )
        })?;
        let found = MaskSet::find(&masks, &scene, args.polarity.map(Into::into))?;
        if !args.table.quiet {
            for note in &found.notes {
                let _ = writeln!(std::io::stderr(), "{note}");
            }
        }
        let gt = args.gt.clone().unwrap_or_else(|| args.scene.clone());
        if args.gt.is_none() && !gt.join("alpha_gt").is_dir() {
            return Err(InputError::new(
                &gt,
                "there is no alpha_gt/ to score against",
                "say with --gt where the true mattes are",
            )
            .into());
        }
        mattes_by_view(&[], &gt)?;
        let out = match &args.out {
            Some(out) => out.clone(),
            None => {
                let full = fs::canonicalize(&args.scene).unwrap_or_else(|_| args.scene.clone());
                let name = full.file_name().unwrap_or("scene".as_ref());
                Path::new("runs").join(format!("{}-ablation", name.to_string_lossy()))
            }
        };
        let is_row = |path: &Path| {
            let name = path.file_name().and_then(|name| name.to_str());
            path.is_dir() && name.is_some_and(|name| Trial::of_folder(name).is_some())
        };
        kept_run::check_place(&out, TABLE_FILES[1], is_row)?;
        Ok(Self { masks, gt, out })
    }

    /// Each of `rows` with every seed that is asked for.
    fn trials(
        &self,
        args: &AblateArgs,
        rows: impl IntoIterator<Item = Row>,
    ) -> anyhow::Result<Vec<Trial>> {
        let plain = TrainArgs {
            scene: Some(args.scene.clone()),
            preset: args.table.preset,
            settings: args.table.settings.clone(),
            ..TrainArgs::default()
        };
        let first = Plan::new(&plain)?.config.seed;
        let rows = rows.into_iter();
        Ok(rows
            .flat_map(|row| Trial::of(row, first, args.table.seeds))
            .collect())
    }

    /// All trials that have a folder, in the table's order.
    fn found(&self) -> Result<Vec<Trial>, RunError> {
        let failed = |source| RunError::outside("list", &self.out, source);
        let mut found = Vec::new();
        // No row came as far as to make it.
        if !self.out.is_dir() {
            return Ok(found);
        }
        for entry in fs::read_dir(&self.out).map_err(failed)? {
            let name = entry.map_err(failed)?.file_name();
            found.extend(name.to_str().and_then(Trial::of_folder));
        }
        let names = Row::names();
        let place = |trial: &Trial| names.iter().position(|name| *name == trial.row.name);
        found.sort_by_key(|trial| (place(trial), trial.seed));
        Ok(found)
    }

    fn state(&self, trial: &Trial) -> State {
        let dir = self.out.join(trial.folder());
        match trial.row.kind {
            // Renamed when complete.
            Kind::Masks | Kind::Hull if dir.join("alpha").is_dir() => State::Finished,
            Kind::Masks | Kind::Hull => State::Nothing,
            Kind::Run { .. } => State::of(&dir),
        }
    }

    /// What `sos train` would be asked for a row; nothing for one that is no run.
    fn command(&self, args: &AblateArgs, trial: &Trial) -> Option<TrainArgs> {
        let Kind::Run { start, settings } = trial.row.kind else {
            return None;
        };
        let own = settings.iter().map(|setting| (*setting).to_owned());
        // Last of all: it is to hold whatever the user's settings say of the first one.
        let own = own.chain(trial.seed.map(|seed| format!("seed={seed}")));
        Some(TrainArgs {
            scene: Some(args.scene.clone()),
            masks: Some(match start {
                Start::Masks => self.masks.clone(),
                Start::Nothing => "none".into(),
            }),
            polarity: args.polarity.filter(|_| start == Start::Masks),
            out: Some(self.out.join(trial.folder())),
            preset: args.table.preset,
            settings: SettingArgs {
                set: args.table.settings.set.iter().cloned().chain(own).collect(),
                ..args.table.settings.clone()
            },
            skip_checks: args.table.skip_checks,
            quiet: args.table.quiet,
            ..TrainArgs::default()
        })
    }

    /// Whether what is there of a row was made with the settings of this table, and whether these make
    /// sense at all.
    fn check(&self, args: &AblateArgs, trial: &Trial) -> anyhow::Result<()> {
        self.command(args, trial)
            .map_or(Ok(()), |command| kept_run::check(&command))
    }

    /// Makes what is missing of a row; gives the exit code.
    fn make(&self, args: &AblateArgs, trial: &Trial) -> anyhow::Result<u8> {
        let state = self.state(trial);
        let is_run = matches!(trial.row.kind, Kind::Run { .. });
        let say = |what: &str| {
            if !args.table.quiet {
                let _ = writeln!(std::io::stderr(), "== {}: {what}", trial.title());
            }
        };
        if state == State::Finished && is_run {
            say("is there");
            return Ok(EXIT_OK);
        }
        say(&trial.definition());
        let alpha = self.out.join(trial.folder()).join("alpha");
        // Made in seconds, and nothing in it says of which masks it was made.
        if state == State::Finished {
            fs::remove_dir_all(&alpha).map_err(|e| RunError::outside("remove", &alpha, e))?;
        }
        match trial.row.kind {
            Kind::Masks => write_masks(&args.scene, &self.masks, args.polarity, &alpha)?,
            Kind::Hull => write_hull(&args.scene, &self.masks, args.polarity, &alpha)?,
            Kind::Run { .. } => {
                return self
                    .command(args, trial)
                    .map_or(Ok(EXIT_OK), kept_run::complete);
            }
        };
        Ok(EXIT_OK)
    }

    /// Scores all rows that are there, prints the table and writes it.
    fn summarise(&self, args: &AblateArgs) -> anyhow::Result<()> {
        // Those that were not asked for belong to the table only if they have its settings.
        let there = self.found()?.into_iter();
        let trials: Vec<Trial> = there
            .filter(|trial| self.state(trial) == State::Finished)
            .filter(|trial| self.check(args, trial).is_ok())
            .collect();
        let contender = |trial: &Trial| Contender {
            name: trial.title(),
            dir: self.out.join(trial.folder()),
        };
        let contenders: Vec<Contender> = trials.iter().map(contender).collect();
        let comparison = compare_contenders(&contenders, &self.gt)?;
        let page = comparison_page(&comparison, &contenders, &self.gt)?;
        let scored = trials.iter().zip(comparison.contenders);
        let rows = scored.map(|(trial, compared)| Scored {
            row: trial.row.name,
            title: trial.row.title,
            folder: trial.folder(),
            definition: trial.definition(),
            seconds: RunFolder::open_existing(&self.out.join(trial.folder()))
                .ok()
                .and_then(|run| whole_seconds(&run)),
            compared,
        });
        let scene = args.scene.display().to_string();
        let ablation = Ablation::new(
            scene,
            words_of(args.table.preset, &args.table.settings),
            rows.collect(),
        );
        // First: it may not be printed, and is what took the time.
        let [markdown, json, html] = TABLE_FILES.map(|name| self.out.join(name));
        write_whole(&markdown, ablation.markdown().as_bytes())?;
        write_whole(&json, serde_json::to_string_pretty(&ablation)?.as_bytes())?;
        write_whole(&html, page.as_bytes())?;
        // A table is the answer, however quiet all else is.
        Voice::of(args.table.json, false).answer(&ablation, &ablation.table())?;
        if !args.table.quiet {
            let _ = writeln!(
                std::io::stderr(),
                "the table is in {}, pictures in {}; {} compare puts other systems' masks beside them",
                markdown.display(),
                html.display(),
                program()
            );
        }
        Ok(())
    }
}
