//! The program COLMAP: found, asked for its options, run step by step.

use crate::error::CaptureError;
use crate::matching::Matcher;
use crate::program::{Ended, Program};
use crate::progress_lines::{Damaged, Lines};
use crate::watch::{Progress, Stage, Watch};
use std::path::{Path, PathBuf};

mod command_lines;

pub(crate) use command_lines::{Evidence, FeatureJob};
use command_lines::{
    Options, adjuster_arguments, completer_arguments, feature_arguments, mapper_arguments,
    matcher_arguments, merger_arguments,
};

/// COLMAP's names of what merges models, adjusts them, and finds their points.
const MERGER: &str = "model_merger";
const ADJUSTER: &str = "bundle_adjuster";
const COMPLETER: &str = "point_triangulator";

/// How to get it.
const GET: &str = "install COLMAP: apt install colmap (Debian, Ubuntu), brew install colmap \
    (macOS), conda install -c conda-forge colmap, pip install pycolmap, or the zip of its GitHub \
    releases (Windows), with the folder of colmap on the PATH";
/// The first release of the Python module, by its major version, that does what is asked of it.
const OLDEST_MODULE: u32 = 4;
/// Answers in COLMAP's stead where only that module is there.
const BY_PYTHON: &str = include_str!("colmap_by_python.py");
const PYTHONS: [&str; 2] = ["python3", "python"];

/// COLMAP on this machine.
#[derive(Debug, Clone)]
pub struct Colmap {
    program: Program,
    version: String,
}

/// Whether poses were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mapped {
    Some,
    None,
}

impl Colmap {
    /// The `colmap` on the PATH, or else the module `pycolmap` of the Python there.
    ///
    /// # Errors
    /// [`CaptureError::Missing`] with how to install it.
    pub fn find() -> Result<Self, CaptureError> {
        let missing = match Program::find("colmap", GET) {
            Ok(program) => return Self::known(program),
            Err(missing) => missing,
        };
        let mut too_old = None;
        for name in PYTHONS {
            let Ok(python) = Program::find(name, GET) else {
                continue;
            };
            match Self::by_python(&python.path) {
                Ok(found) => return Ok(found),
                // Said rather than that there is none.
                Err(error @ CaptureError::TooOld { .. }) => too_old = Some(error),
                // Most often a Python without the module.
                Err(_) => {}
            }
        }
        Err(too_old.unwrap_or(missing))
    }

    /// The module `pycolmap` (4.0 or newer) of the Python interpreter at a path.
    ///
    /// # Errors
    /// As [`Colmap::at`], and [`CaptureError::TooOld`].
    pub fn by_python(python: &Path) -> Result<Self, CaptureError> {
        let found = Self::known(Program::script(python, vec!["-c", BY_PYTHON]))?;
        // Those before lack classes that are used here, or take another camera model than they are asked for.
        let major = found.version.split('.').next().map(str::parse::<u32>);
        match major {
            Some(Ok(major)) if major < OLDEST_MODULE => Err(CaptureError::TooOld {
                version: found.version,
                python: python.to_path_buf(),
            }),
            _ => Ok(found),
        }
    }

    /// The program at a path.
    ///
    /// # Errors
    /// [`CaptureError::Io`] if it cannot be started, [`CaptureError::Missing`] if it is something
    /// else.
    pub fn at(path: &Path) -> Result<Self, CaptureError> {
        Self::known(Program::at(path))
    }

    fn known(program: Program) -> Result<Self, CaptureError> {
        // Without a display, Qt would stop the program before it does anything.
        let program = program.with_environment("QT_QPA_PLATFORM", "offscreen");
        let help = program.ask(&["help"])?;
        let Some(version) = version_in(&help) else {
            return Err(CaptureError::Missing {
                what: format!("{} does not answer like COLMAP", program.path.display()),
                remedy: GET,
            });
        };
        Ok(Self { program, version })
    }

    /// Such as "3.8" or "4.1.1".
    #[must_use]
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Where the program is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.program.path
    }

    /// The same, with COLMAP's own log files in that folder, not among the system's.
    pub(crate) fn logging_to(&self, folder: &Path) -> Self {
        Self {
            program: self
                .program
                .clone()
                .with_environment("GOOGLE_LOG_DIR", folder),
            version: self.version.clone(),
        }
    }

    pub(crate) fn options(&self, command: &str) -> Result<Options, CaptureError> {
        let options = self.help_of(command)?;
        if options.has("database_path") || options.has("output_path") {
            Ok(options)
        } else {
            Err(CaptureError::Missing {
                what: format!(
                    "{} (COLMAP {}) does not know the command {command}",
                    self.program.path.display(),
                    self.version
                ),
                remedy: GET,
            })
        }
    }

    /// What a command can be told; nothing where it is not known.
    fn help_of(&self, command: &str) -> Result<Options, CaptureError> {
        let help = self.program.ask(&[command, "-h"])?;
        Ok(Options::in_help(&help))
    }

    /// Finds features in photos that share a camera. `before` of `total` photos are done already.
    pub(crate) fn features(
        &self,
        options: &Options,
        job: &FeatureJob<'_>,
        (before, total): (usize, usize),
        watch: &dyn Watch,
    ) -> Result<Vec<Damaged>, CaptureError> {
        let mut lines = Lines::default();
        let ended = self
            .program
            .run(&feature_arguments(options, job), watch, |line| {
                if let Some((done, _)) = lines.features(line) {
                    watch.progress(Progress {
                        stage: Stage::Features,
                        done: (before + done).min(total),
                        total,
                    });
                }
            })?;
        if !ended.status.success() {
            let remedy = "if memory ran out, use fewer or smaller photos; else run colmap \
                feature_extractor by hand to see more";
            return Err(self.program.failed("finding features", &ended, remedy));
        }
        Ok(lines.damaged)
    }

    /// Compares photos with each other.
    pub(crate) fn compare(
        &self,
        matcher: Matcher,
        database: &Path,
        watch: &dyn Watch,
    ) -> Result<(), CaptureError> {
        let options = self.options(matcher.command())?;
        let arguments = matcher_arguments(&options, matcher, database);
        let mut lines = Lines::default();
        let ended = self.program.run(&arguments, watch, |line| {
            if let Some((done, total)) = lines.matches(line) {
                watch.progress(Progress {
                    stage: Stage::Matches,
                    done,
                    total,
                });
            }
        })?;
        if !ended.status.success() {
            let remedy =
                "use fewer photos if memory ran out; else run the matcher by hand to see more";
            return Err(self.program.failed("comparing photos", &ended, remedy));
        }
        Ok(())
    }

    /// Finds poses; models are written into the folders `0`, `1`, … of `out`, which exists.
    pub(crate) fn poses(
        &self,
        images: &Path,
        database: &Path,
        out: &Path,
        evidence: Evidence,
        total: usize,
        watch: &dyn Watch,
    ) -> Result<Mapped, CaptureError> {
        let options = self.options("mapper")?;
        let arguments = mapper_arguments(&options, images, database, out, evidence);
        let mut lines = Lines::default();
        let ended = self.program.run(&arguments, watch, |line| {
            if let Some(done) = lines.poses(line) {
                watch.progress(Progress {
                    stage: Stage::Poses,
                    done: done.min(total),
                    total,
                });
            }
        })?;
        if ended.status.success() {
            return Ok(Mapped::Some);
        }
        // How every version says that there is no error, just no model.
        let no_model = [
            "ailed to create sparse model",
            "ailed to create any sparse model",
        ];
        if no_model.iter().any(|text| ended.last.mention(text)) {
            return Ok(Mapped::None);
        }
        let remedy = "run colmap mapper by hand to see more";
        Err(self.program.failed("finding poses", &ended, remedy))
    }

    /// Whether it has a command that merges models; its Python module has none.
    pub(crate) fn can_merge(&self) -> Result<bool, CaptureError> {
        Ok(self.help_of(MERGER)?.has("input_path2"))
    }

    /// Brings two models that share photos into one, written into `out`; what is there afterwards says whether they fit.
    pub(crate) fn merge(
        &self,
        first: &Path,
        second: &Path,
        out: &Path,
        watch: &dyn Watch,
    ) -> Result<(), CaptureError> {
        let arguments = merger_arguments(&self.options(MERGER)?, first, second, out);
        // It may end as if it had failed where they do not fit.
        self.program.run(&arguments, watch, |_| {}).map(|_| ())
    }

    /// Adjusts poses, lenses and points of a model to each other.
    pub(crate) fn adjust(
        &self,
        model: &Path,
        out: &Path,
        watch: &dyn Watch,
    ) -> Result<(), CaptureError> {
        let arguments = adjuster_arguments(&self.options(ADJUSTER)?, model, out);
        let ended = self.program.run(&arguments, watch, |_| {})?;
        let remedy = "run colmap bundle_adjuster by hand to see more";
        self.ended_well("adjusting merged models", &ended, remedy)
    }

    /// Adds the points that a model's poses allow, and leaves out those that they do not.
    pub(crate) fn complete(
        &self,
        model: &Path,
        (images, database): (&Path, &Path),
        out: &Path,
        watch: &dyn Watch,
    ) -> Result<(), CaptureError> {
        let options = self.options(COMPLETER)?;
        let arguments = completer_arguments(&options, images, database, model, out);
        let ended = self.program.run(&arguments, watch, |_| {})?;
        let remedy = "run colmap point_triangulator by hand to see more";
        self.ended_well("finding points of merged models", &ended, remedy)
    }

    fn ended_well(
        &self,
        task: &'static str,
        ended: &Ended,
        remedy: &str,
    ) -> Result<(), CaptureError> {
        if ended.status.success() {
            return Ok(());
        }
        Err(self.program.failed(task, ended, remedy))
    }
}

/// The version in what `colmap help` prints: `COLMAP 3.8 -- Structure-from-Motion …`,
/// `COLMAP 4.1.1 (Commit …)`.
fn version_in(help: &str) -> Option<String> {
    let (_, rest) = help.split_once("COLMAP ")?;
    let word = rest.split_whitespace().next()?;
    word.starts_with(|c: char| c.is_ascii_digit())
        .then(|| word.to_owned())
}

/// A folder for the models, and what is in it afterwards.
pub(crate) fn model_folders(out: &Path) -> Result<Vec<PathBuf>, CaptureError> {
    let entries = std::fs::read_dir(out).map_err(|e| CaptureError::io("list", out, e))?;
    let mut folders: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.join("images.bin").is_file() || path.join("images.txt").is_file())
        .collect();
    folders.sort();
    Ok(folders)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_read_from_either_banner() {
        let three = "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo\n";
        let four = "COLMAP 4.1.1 (Commit 12ab on 2026-07-17 without GPU support)\nUsage:\n";
        let built = "\nCOLMAP 3.14.0.dev0 -- Structure\n";
        assert_eq!(version_in(three).as_deref(), Some("3.8"));
        assert_eq!(version_in(four).as_deref(), Some("4.1.1"));
        assert_eq!(version_in(built).as_deref(), Some("3.14.0.dev0"));
        assert_eq!(version_in("usage: something else"), None);
        assert_eq!(version_in("not COLMAP at all"), None);
    }
}
