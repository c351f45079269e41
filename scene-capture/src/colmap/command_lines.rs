//! What COLMAP is called with, in the dialect of its version.

use crate::matching::Matcher;
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::path::Path;

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
    /// Those of [`FEWER_MATCHES`].
    Less,
}

impl Options {
    /// Those in what `colmap COMMAND -h` prints, one a line: `  --Mapper.num_threads arg (=-1)`.
    pub(super) fn in_help(help: &str) -> Self {
        let name = |line: &str| {
            let rest = line.trim_start().strip_prefix("--")?;
            let end = rest
                .find(|c: char| c.is_whitespace() || c == '=')
                .unwrap_or(rest.len());
            Some(rest[..end].to_owned())
        };
        Self(help.lines().filter_map(name).collect())
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.0.contains(name)
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
        match names.iter().find(|name| self.options.has(name)) {
            Some(name) => self.with(name, value),
            None => self,
        }
    }
}

pub(super) fn feature_arguments(options: &Options, job: &FeatureJob<'_>) -> Vec<OsString> {
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

pub(super) fn matcher_arguments(
    options: &Options,
    matcher: Matcher,
    database: &Path,
) -> Vec<OsString> {
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

pub(super) fn mapper_arguments(
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

pub(super) fn merger_arguments(
    options: &Options,
    first: &Path,
    second: &Path,
    out: &Path,
) -> Vec<OsString> {
    Arguments::of(super::MERGER, options)
        .with("input_path1", first)
        .with("input_path2", second)
        .with("output_path", out)
        .words
}

pub(super) fn adjuster_arguments(options: &Options, model: &Path, out: &Path) -> Vec<OsString> {
    Arguments::of(super::ADJUSTER, options)
        .with("input_path", model)
        .with("output_path", out)
        .with_first(
            &[
                "BundleAdjustmentCeres.function_tolerance",
                "BundleAdjustment.function_tolerance",
            ],
            FUNCTION_TOLERANCE,
        )
        .words
}

pub(super) fn completer_arguments(
    options: &Options,
    images: &Path,
    database: &Path,
    model: &Path,
    out: &Path,
) -> Vec<OsString> {
    Arguments::of(super::COMPLETER, options)
        .with("database_path", database)
        .with("image_path", images)
        .with("input_path", model)
        .with("output_path", out)
        .words
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
