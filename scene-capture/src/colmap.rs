//! The program COLMAP: found, asked for its options, run step by step.

use crate::error::CaptureError;
use crate::matching::Matcher;
use crate::program::Program;
use crate::progress_lines::{Damaged, Lines};
use crate::watch::{Progress, Stage, Watch};
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// How to get it.
const GET: &str = "install COLMAP: apt install colmap (Debian, Ubuntu), brew install colmap \
    (macOS), conda install -c conda-forge colmap, pip install pycolmap, or the zip of its GitHub \
    releases (Windows), with the folder of colmap on the PATH";
/// Answers in COLMAP's stead where only its Python module is there.
const BY_PYTHON: &str = include_str!("colmap_by_python.py");
const PYTHONS: [&str; 2] = ["python3", "python"];

/// Photos are scaled down to that many pixels on their longer side before features are looked for,
/// and that many features are kept: COLMAP's own "medium quality". Its defaults are made for GPUs:
/// a CPU would need many times the time and gigabytes of memory per thread.
const LONGER_SIDE: u32 = 1600;
const FEATURES: u32 = 4096;
/// COLMAP's default of 0 lets every adjustment run to its last iteration.
const FUNCTION_TOLERANCE: &str = "0.000001";
/// What COLMAP takes for a pose otherwise is made for many large photos: the matches of the first pair and their angle,
/// and the matches of every other photo. A few small photos of a smooth thing have fewer, and poses by them are no worse.
const FEWER_MATCHES: [(&str, &str); 4] = [
    ("Mapper.init_min_num_inliers", "30"),
    ("Mapper.init_min_tri_angle", "4"),
    ("Mapper.abs_pose_min_num_inliers", "15"),
    ("Mapper.abs_pose_min_inlier_ratio", "0.15"),
];
/// As many photos determine a lens of eight parameters well enough.
const OPENCV_FROM: usize = 30;

/// COLMAP on this machine.
#[derive(Debug, Clone)]
pub struct Colmap {
    program: Program,
    version: String,
}

/// What one command of COLMAP can be told. Names differ between versions: what is `use_gpu` of
/// `FeatureExtraction` today was `SiftExtraction`'s before; so the program is asked.
#[derive(Debug, Default)]
pub(crate) struct Options(BTreeSet<String>);

/// Photos that share a camera, and where to write what is found in them.
#[derive(Debug)]
pub(crate) struct FeatureJob<'a> {
    pub(crate) images: &'a Path,
    pub(crate) database: &'a Path,
    /// A file that lists the photos' names.
    pub(crate) list: &'a Path,
    pub(crate) photos: usize,
    pub(crate) masks: Option<&'a Path>,
}

/// How many matches a pose needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Evidence {
    /// As many as COLMAP wants.
    Usual,
    /// Half as many.
    Less,
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
        PYTHONS
            .iter()
            .filter_map(|name| Program::find(name, GET).ok())
            .find_map(|python| Self::by_python(&python.path).ok())
            .ok_or(missing)
    }

    /// The module `pycolmap` (4.0 or newer) of the Python interpreter at a path.
    ///
    /// # Errors
    /// As [`Colmap::at`].
    pub fn by_python(python: &Path) -> Result<Self, CaptureError> {
        Self::known(Program::script(python, vec!["-c", BY_PYTHON]))
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
        let help = self.program.ask(&[command, "-h"])?;
        let options = Options::in_help(&help);
        if options.0.contains("database_path") {
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
        (evidence, total): (Evidence, usize),
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
}

/// The version in what `colmap help` prints: `COLMAP 3.8 -- Structure-from-Motion …`,
/// `COLMAP 4.1.1 (Commit …)`.
fn version_in(help: &str) -> Option<String> {
    let (_, rest) = help.split_once("COLMAP ")?;
    let word = rest.split_whitespace().next()?;
    word.starts_with(|c: char| c.is_ascii_digit())
        .then(|| word.to_owned())
}

impl Options {
    /// Those in what `colmap COMMAND -h` prints, one a line: `  --Mapper.num_threads arg (=-1)`.
    fn in_help(help: &str) -> Self {
        let name = |line: &str| {
            let rest = line.trim_start().strip_prefix("--")?;
            let end = rest
                .find(|c: char| c.is_whitespace() || c == '=')
                .unwrap_or(rest.len());
            Some(rest[..end].to_owned())
        };
        Self(help.lines().filter_map(name).collect())
    }
}

/// A command line that grows.
struct Arguments<'a> {
    options: &'a Options,
    words: Vec<OsString>,
}

impl<'a> Arguments<'a> {
    fn of(command: &str, options: &'a Options) -> Self {
        Self {
            options,
            words: vec![command.into()],
        }
    }

    /// An option that every version has.
    fn with(mut self, name: &str, value: impl AsRef<OsStr>) -> Self {
        self.words.push(format!("--{name}").into());
        self.words.push(value.as_ref().to_os_string());
        self
    }

    /// The first of these names that the program knows; nothing if it knows none.
    fn with_first(self, names: &[&str], value: impl AsRef<OsStr>) -> Self {
        match names.iter().find(|name| self.options.0.contains(**name)) {
            Some(name) => self.with(name, value),
            None => self,
        }
    }
}

fn feature_arguments(options: &Options, job: &FeatureJob<'_>) -> Vec<OsString> {
    let model = if job.photos >= OPENCV_FROM {
        "OPENCV"
    } else {
        "SIMPLE_RADIAL"
    };
    let arguments = Arguments::of("feature_extractor", options)
        .with("database_path", job.database)
        .with("image_path", job.images)
        .with("image_list_path", job.list)
        .with("ImageReader.camera_model", model)
        .with("ImageReader.single_camera", "1")
        .with_first(
            &["FeatureExtraction.use_gpu", "SiftExtraction.use_gpu"],
            "0",
        )
        .with_first(
            &[
                "FeatureExtraction.max_image_size",
                "SiftExtraction.max_image_size",
            ],
            LONGER_SIDE.to_string(),
        )
        .with_first(&["SiftExtraction.max_num_features"], FEATURES.to_string());
    match job.masks {
        Some(masks) => arguments.with("ImageReader.mask_path", masks).words,
        None => arguments.words,
    }
}

fn matcher_arguments(options: &Options, matcher: Matcher, database: &Path) -> Vec<OsString> {
    let arguments = Arguments::of(matcher.command(), options)
        .with("database_path", database)
        .with_first(&["FeatureMatching.use_gpu", "SiftMatching.use_gpu"], "0");
    match matcher {
        Matcher::Exhaustive { block } => {
            arguments.with_first(&["ExhaustiveMatching.block_size"], block.to_string())
        }
        Matcher::Sequential { overlap } => {
            arguments.with_first(&["SequentialMatching.overlap"], overlap.to_string())
        }
        Matcher::Spatial => arguments,
    }
    .words
}

fn mapper_arguments(
    options: &Options,
    images: &Path,
    database: &Path,
    out: &Path,
    evidence: Evidence,
) -> Vec<OsString> {
    let arguments = Arguments::of("mapper", options)
        .with("database_path", database)
        .with("image_path", images)
        .with("output_path", out)
        .with_first(&["Mapper.ba_global_function_tolerance"], FUNCTION_TOLERANCE);
    match evidence {
        Evidence::Usual => arguments,
        Evidence::Less => FEWER_MATCHES.iter().fold(arguments, |all, (name, value)| {
            all.with_first(&[name], value)
        }),
    }
    .words
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

    const HELP_3: &str = "COLMAP 3.8 (Commit Unknown on Unknown without CUDA)

  -h [ --help ]
  --log_level arg (=2)
  --database_path arg
  --ImageReader.single_camera arg (=0)
  --SiftExtraction.use_gpu arg (=1)
  --SiftExtraction.max_image_size arg (=3200)
  --SiftExtraction.max_num_features arg (=8192)
";
    const HELP_4: &str = "  --database_path arg
  --FeatureExtraction.use_gpu arg (=1)
  --FeatureExtraction.max_image_size arg (=-1)
  --SiftExtraction.max_num_features arg (=8192)
";

    fn line(words: &[OsString]) -> String {
        let words: Vec<_> = words.iter().map(|word| word.to_string_lossy()).collect();
        words.join(" ")
    }

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

    #[test]
    fn features_are_asked_for_in_the_dialect_of_the_program() {
        let job = FeatureJob {
            images: Path::new("i"),
            database: Path::new("d.db"),
            list: Path::new("l.txt"),
            photos: 29,
            masks: None,
        };
        let paths = "--database_path d.db --image_path i --image_list_path l.txt";
        let camera = "--ImageReader.camera_model SIMPLE_RADIAL --ImageReader.single_camera 1";
        let old = feature_arguments(&Options::in_help(HELP_3), &job);
        assert_eq!(
            line(&old),
            format!(
                "feature_extractor {paths} {camera} --SiftExtraction.use_gpu 0 \
                 --SiftExtraction.max_image_size 1600 --SiftExtraction.max_num_features 4096"
            )
        );
        let new = feature_arguments(&Options::in_help(HELP_4), &job);
        assert_eq!(
            line(&new),
            format!(
                "feature_extractor {paths} {camera} --FeatureExtraction.use_gpu 0 \
                 --FeatureExtraction.max_image_size 1600 --SiftExtraction.max_num_features 4096"
            )
        );
        let many = FeatureJob {
            photos: 30,
            masks: Some(Path::new("m")),
            ..job
        };
        let words = line(&feature_arguments(&Options::default(), &many));
        assert!(words.contains("camera_model OPENCV "), "{words}");
        assert!(words.ends_with("--ImageReader.mask_path m"), "{words}");
        assert!(!words.contains("gpu"), "{words}");
    }

    #[test]
    fn matchers_are_called_in_the_dialect_of_the_program() {
        let of = |help: &str, matcher| {
            line(&matcher_arguments(
                &Options::in_help(help),
                matcher,
                Path::new("d.db"),
            ))
        };
        let old = "--SiftMatching.use_gpu arg (=1)\n--ExhaustiveMatching.block_size arg (=50)";
        assert_eq!(
            of(old, Matcher::Exhaustive { block: 10 }),
            "exhaustive_matcher --database_path d.db --SiftMatching.use_gpu 0 \
             --ExhaustiveMatching.block_size 10"
        );
        let new = "--FeatureMatching.use_gpu arg (=1)\n--SequentialMatching.overlap arg (=10)";
        assert_eq!(
            of(new, Matcher::Sequential { overlap: 20 }),
            "sequential_matcher --database_path d.db --FeatureMatching.use_gpu 0 \
             --SequentialMatching.overlap 20"
        );
        assert_eq!(
            of("", Matcher::Spatial),
            "spatial_matcher --database_path d.db"
        );
    }

    #[test]
    fn the_mapper_is_called_as_every_version_knows_it() {
        let words_for = |help: &str, evidence| {
            line(&mapper_arguments(
                &Options::in_help(help),
                Path::new("i"),
                Path::new("d.db"),
                Path::new("o"),
                evidence,
            ))
        };
        let words = |help: &str| words_for(help, Evidence::Usual);
        let plain = "mapper --database_path d.db --image_path i --output_path o";
        assert_eq!(words(""), plain);
        assert_eq!(
            words("  --Mapper.ba_global_function_tolerance arg (=0)"),
            format!("{plain} --Mapper.ba_global_function_tolerance 0.000001")
        );
        let inliers = "  --Mapper.abs_pose_min_num_inliers arg (=30)";
        assert_eq!(words(inliers), plain);
        assert_eq!(
            words_for(inliers, Evidence::Less),
            format!("{plain} --Mapper.abs_pose_min_num_inliers 15")
        );
    }
}
