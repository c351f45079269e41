//! The command line.

mod scoring;

pub use scoring::{
    AblateArgs, CompareArgs, DegradeArgs, EvalArgs, HullArgs, ResultsArgs, TableArgs,
};

use crate::config::{MaskPolarity, Preset};
use crate::discover::hint::{Click, WorldBox};
use clap::{ArgAction, ArgGroup, Args, Parser, Subcommand};
use clap_complete::Shell;
use std::path::PathBuf;

/// Commands first; the options fit into a line of their own.
const TEMPLATE: &str = "\
{about-with-newline}
{usage-heading} {usage}

Commands:
{subcommands}{after-help}";

const EXAMPLES: &str = "\
Each explains itself with --help; --version tells the version. For shells: completions, man. For tests: degrade, hull.
Examples:
  sos train                                  the built-in demo, into runs/demo
  sos train photos/cat --masks photos/masks  photos with a COLMAP model and rough masks
  sos eval runs/cat --gt photos/alpha_gt     score the mattes against the truth";

/// From posed photos and rough masks to mattes, cut-outs, background plates and a mesh.
#[derive(Debug, Parser)]
#[command(
    name = "sos",
    version,
    help_template = TEMPLATE,
    after_help = EXAMPLES,
    max_term_width = 120,
    disable_help_flag = true,
    disable_help_subcommand = true
)]
pub struct Sos {
    /// Print help.
    // The long form of clap's help spreads each option over three lines.
    #[arg(short, long, action = ArgAction::HelpShort, global = true)]
    help: Option<bool>,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What `sos` can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train on a scene and write all results into a run folder.
    Train(Box<TrainArgs>),
    /// Turn photos with camera poses of another tool into a COLMAP scene.
    Import(ImportArgs),
    /// Turn photos without poses, or a video, into a COLMAP scene, by running COLMAP.
    Capture(CaptureArgs),
    /// Check a scene before training: coverage, parallax, blur, exposure, masks, expected cost.
    Doctor(DoctorArgs),
    /// Turn a run's results into what other tools read: EXR layers, OBJ, GLB, COCO, masks, videos.
    Export(ExportArgs),
    /// Draw a run's object all around, or its scene along the photos: frames and videos.
    Render(RenderArgs),
    /// Score a run against ground truth and print a table.
    Eval(EvalArgs),
    /// Score several runs, or folders of any system's masks, against the same truth.
    Compare(CompareArgs),
    /// Write the classical answer: the masks' soft visual hull, seen from every view.
    #[command(hide = true)]
    Hull(HullArgs),
    /// Write masks with the faults of rough segmenters, made from true ones, to start a test from.
    #[command(hide = true)]
    Degrade(DegradeArgs),
    /// Train and score the rows of the paper's ablation, and rivals, on one scene.
    Ablate(Box<AblateArgs>),
    /// Train and score scenes with ground truth from several kinds of masks, and without any.
    Results(Box<ResultsArgs>),
    /// Make a run's report.html again.
    Report(ReportArgs),
    /// List what this build can compute on.
    Devices {
        /// Print one JSON object instead of a table.
        #[arg(long)]
        json: bool,
    },
    /// Write the built-in demo scene with its ground truth into a folder.
    DemoScene {
        /// Folder to create.
        out: PathBuf,
        /// Print one JSON object instead of a sentence.
        #[arg(long)]
        json: bool,
    },
    /// Print a script that completes commands and options in a shell.
    #[command(hide = true)]
    Completions {
        /// The shell: bash, zsh, fish, elvish or powershell.
        #[arg(value_name = "SHELL")]
        shell: Shell,
    },
    /// Print the manual page, or write one for each command.
    #[command(hide = true)]
    Man {
        /// Folder for the pages of all commands, such as /usr/local/share/man/man1 [default: print the first].
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// `sos train`.
#[derive(Debug, Clone, Default, Args)]
pub struct TrainArgs {
    /// Folder of photos, best with camera poses of any tool, or a video [default: the built-in demo scene].
    pub scene: Option<PathBuf>,
    /// Folder with a rough mask per photo, COCO JSON file, "alpha" or "none" [default: SCENE/masks if there].
    #[arg(long, value_name = "PATH")]
    pub masks: Option<PathBuf>,
    /// Folder of pictures, white where a photo is not to be learned from: passers-by [default: SCENE/ignore if there].
    #[arg(long, value_name = "DIR")]
    pub ignore: Option<PathBuf>,
    /// The object's number in masks that hold several [default: plain masks].
    #[arg(long, value_name = "N")]
    pub label: Option<u32>,
    /// Colour of the object in the masks: white or black [default: detected].
    #[arg(long, value_enum, value_name = "COLOUR", hide_possible_values = true)]
    pub polarity: Option<MaskPolarity>,
    /// Without masks: a pixel of a photo that shows the object, VIEW:X,Y [default: what the cameras look at].
    #[arg(long, value_name = "VIEW:X,Y", conflicts_with = "object_box")]
    pub click: Option<Click>,
    /// Without masks: a box around the object in the scene's frame, X0,Y0,Z0,X1,Y1,Z1 [default: found].
    #[arg(long = "box", value_name = "BOX", allow_hyphen_values = true)]
    pub object_box: Option<WorldBox>,
    /// Folder for the results [default: runs/NAME_OF_SCENE; runs/demo without SCENE].
    #[arg(long, value_name = "RUN")]
    pub out: Option<PathBuf>,
    /// Settings to start from: quick, default or paper [default: default].
    #[arg(
        long,
        value_enum,
        value_name = "NAME",
        hide_possible_values = true,
        conflicts_with_all = ["config", "resume"]
    )]
    pub preset: Option<Preset>,
    /// The config.toml of a run to repeat, instead of a preset [default: none].
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    pub config: Option<PathBuf>,
    /// Over the preset.
    #[command(flatten)]
    pub settings: SettingArgs,
    /// Go on with the run in RUN from its last checkpoint.
    #[arg(long, conflicts_with = "force")]
    pub resume: bool,
    /// Replace the run in RUN.
    #[arg(long)]
    pub force: bool,
    /// Train even where a check of the scene fails (sos doctor shows them).
    #[arg(long)]
    pub skip_checks: bool,
    /// Show the run on a page of this machine, at any port or this one, with buttons to pause and stop it [default: none].
    #[arg(
        long,
        value_name = "PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "0"
    )]
    pub view: Option<u16>,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

/// Settings of a run, over its preset.
#[derive(Debug, Clone, Default, Args)]
pub struct SettingArgs {
    /// Training steps in all [default: by the preset and the number of pixels].
    #[arg(long, value_name = "N")]
    pub steps: Option<u32>,
    /// Train on photos of 1/N of their width and height; results keep the photos' size [default: 1].
    #[arg(long, value_name = "N")]
    pub downscale: Option<u32>,
    /// Where to compute: auto, cpu, ndarray, flex, wgpu or cuda [default: auto].
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Seed of all random draws [default: 1].
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Change any setting of config.toml, as in loss.mask=0.2; may be repeated [default: none].
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// `sos import`.
#[derive(Debug, Clone, Args)]
pub struct ImportArgs {
    /// Folder with photos and camera poses, or the file with the poses.
    pub scene: PathBuf,
    /// Folder to create, with images/, sparse/0/ and masks/.
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Tool the poses are from: colmap, transforms, llff, neus, blendedmvs, co3d, tum, metashape or
    /// realitycapture [default: detected].
    #[arg(long, value_name = "NAME")]
    pub format: Option<scene_import::Format>,
    /// Folder with the photos [default: where the poses say].
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
    /// Folder of masks, COCO JSON file, "alpha" or "none" [default: what comes with the poses].
    #[arg(long, value_name = "PATH")]
    pub masks: Option<PathBuf>,
    /// The object's number in masks that hold several [default: plain masks].
    #[arg(long, value_name = "N")]
    pub label: Option<u32>,
    /// Colour of the object in the masks: white or black [default: detected].
    #[arg(long, value_enum, value_name = "COLOUR", hide_possible_values = true)]
    pub polarity: Option<MaskPolarity>,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

/// `sos capture`.
#[derive(Debug, Clone, Args)]
pub struct CaptureArgs {
    /// Folder of photos, or a video file.
    #[arg(value_name = "PHOTOS_OR_VIDEO")]
    pub source: PathBuf,
    /// Folder to create, with images/ and sparse/0/.
    #[arg(long, value_name = "SCENE")]
    pub out: PathBuf,
    /// About how many frames to take from a video; at most 4 a second [default: 120].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(3..))]
    pub frames: Option<u32>,
    /// Folder of masks that are black where COLMAP must not look, such as around a turntable [default: none].
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Replace a scene that was captured before.
    #[arg(long)]
    pub force: bool,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

/// `sos doctor`.
#[derive(Debug, Clone, Args)]
pub struct DoctorArgs {
    /// Folder of photos with camera poses of any tool.
    pub scene: PathBuf,
    /// Folder with a rough mask per photo, COCO JSON file, "alpha" or "none" [default: SCENE/masks if there].
    #[arg(long, value_name = "PATH")]
    pub masks: Option<PathBuf>,
    /// Folder of pictures, white where a photo is not to be learned from: passers-by [default: SCENE/ignore if there].
    #[arg(long, value_name = "DIR")]
    pub ignore: Option<PathBuf>,
    /// The object's number in masks that hold several [default: plain masks].
    #[arg(long, value_name = "N")]
    pub label: Option<u32>,
    /// Colour of the object in the masks: white or black [default: detected].
    #[arg(long, value_enum, value_name = "COLOUR", hide_possible_values = true)]
    pub polarity: Option<MaskPolarity>,
    /// Without masks: a pixel of a photo that shows the object, VIEW:X,Y [default: what the cameras look at].
    #[arg(long, value_name = "VIEW:X,Y", conflicts_with = "object_box")]
    pub click: Option<Click>,
    /// Without masks: a box around the object in the scene's frame, X0,Y0,Z0,X1,Y1,Z1 [default: found].
    #[arg(long = "box", value_name = "BOX", allow_hyphen_values = true)]
    pub object_box: Option<WorldBox>,
    /// Settings whose cost is estimated: quick, default or paper [default: default].
    #[arg(long, value_enum, value_name = "NAME", hide_possible_values = true)]
    pub preset: Option<Preset>,
    /// Also write a page with the scene in 3D and the checks [default: none].
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `sos export`.
#[derive(Debug, Clone, Args)]
#[group(skip)]
#[command(group = ArgGroup::new("product").required(true).args(["to", "masks_for"]))]
pub struct ExportArgs {
    /// Run folder.
    pub run: PathBuf,
    /// Format: exr, obj, glb, coco, colmap-scene, alpha8, premultiplied or video.
    #[arg(long, value_name = "FORMAT")]
    pub to: Option<scene_export::Target>,
    /// Masks in the conventions of colmap, nerfstudio, brush, instant-ngp, neus or spin-nerf.
    #[arg(long, value_name = "TOOL")]
    pub masks_for: Option<scene_export::MaskTool>,
    /// Folder to create [default: RUN/export/FORMAT].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The COLMAP scene the run was made from [default: what the run says].
    #[arg(long, value_name = "DIR")]
    pub scene: Option<PathBuf>,
    /// COCO's run lengths as plain numbers instead of packed text.
    #[arg(long)]
    pub plain_rle: bool,
    /// Frames a second of videos [default: 12].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=240))]
    pub fps: Option<u32>,
    /// Replace an earlier export.
    #[arg(long)]
    pub force: bool,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

/// Of rendered frames, unless stated: the longer side in pixels, and how many a second.
const FRAME_SIZE: u32 = 480;
const FRAME_RATE: u32 = 24;

/// `sos render`.
#[derive(Debug, Clone, Args)]
#[group(skip)]
#[command(group = ArgGroup::new("cameras").required(true).args(["turntable", "path", "views"]))]
pub struct RenderArgs {
    /// Run folder, with its checkpoint.
    pub run: PathBuf,
    /// The object alone, from N places all around it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub turntable: Option<u32>,
    /// The scene, and the scene without the object, from N places along the way of the photos.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub path: Option<u32>,
    /// The same from the cameras of another COLMAP model in the scene's frame, in their own sizes.
    #[arg(long, value_name = "SCENE")]
    pub views: Option<PathBuf>,
    /// Longer side of the pictures in pixels.
    #[arg(long, value_name = "PIXELS", conflicts_with = "views", default_value_t = FRAME_SIZE, value_parser = clap::value_parser!(u32).range(16..=8192))]
    pub size: u32,
    /// Frames a second of videos.
    #[arg(long, value_name = "N", conflicts_with = "views", default_value_t = FRAME_RATE, value_parser = clap::value_parser!(u32).range(1..=240))]
    pub fps: u32,
    /// Folder to create [default: RUN/render/turntable, path or views].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace earlier frames.
    #[arg(long)]
    pub force: bool,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

impl RenderArgs {
    /// Of `run`, as if nothing else were said; cameras are to be chosen yet.
    pub(super) fn of(run: PathBuf) -> Self {
        Self {
            run,
            turntable: None,
            path: None,
            views: None,
            size: FRAME_SIZE,
            fps: FRAME_RATE,
            out: None,
            force: false,
            quiet: false,
            json: false,
        }
    }
}

/// `sos report`.
#[derive(Debug, Clone, Args)]
pub struct ReportArgs {
    /// Run folder.
    pub run: PathBuf,
    /// Folder of reference mattes, shown beside the run's own [default: none; of the demo its own].
    #[arg(long, value_name = "DIR")]
    pub gt: Option<PathBuf>,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}
