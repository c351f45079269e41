//! The command line.

use crate::config::{MaskPolarity, Preset};
use clap::{ArgAction, Args, Parser, Subcommand};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  sos train                                  the built-in demo, into runs/demo
  sos train photos/cat --masks photos/masks  photos with a COLMAP model and rough masks
  sos eval runs/cat --gt photos/alpha_gt     score the mattes against the truth";

/// From posed photos and rough masks to mattes, cut-outs, background plates and a mesh.
#[derive(Debug, Parser)]
#[command(
    name = "sos",
    version,
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
    /// Score a run against ground truth and print a table.
    Eval(EvalArgs),
    /// Make a run's report.html again.
    Report(ReportArgs),
    /// List what this build can compute on.
    Devices,
    /// Write the built-in demo scene with its ground truth into a folder.
    DemoScene {
        /// Folder to create.
        out: PathBuf,
    },
}

/// `sos train`.
#[derive(Debug, Clone, Default, Args)]
pub struct TrainArgs {
    /// Folder with photos and their COLMAP model [default: the built-in demo scene].
    pub scene: Option<PathBuf>,
    /// Folder with a rough mask per photo, or "none" [default: SCENE/masks if there].
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Colour of the object in the masks: white or black [default: detected].
    #[arg(long, value_enum, value_name = "COLOUR", hide_possible_values = true)]
    pub polarity: Option<MaskPolarity>,
    /// Folder for the results [default: runs/NAME_OF_SCENE].
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
    /// The config.toml of a run to repeat, instead of a preset.
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    pub config: Option<PathBuf>,
    /// Training steps in all [default: the preset's].
    #[arg(long, value_name = "N")]
    pub steps: Option<u32>,
    /// Where to compute: auto, cpu, ndarray, flex or wgpu [default: auto].
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Seed of all random draws [default: 1].
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Change any setting of config.toml, as in loss.mask=0.2; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Go on with the run in RUN from its last checkpoint.
    #[arg(long, conflicts_with = "force")]
    pub resume: bool,
    /// Replace the run in RUN.
    #[arg(long)]
    pub force: bool,
    /// Print nothing but errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
}

/// `sos eval`.
#[derive(Debug, Clone, Args)]
pub struct EvalArgs {
    /// Run folder; its alpha/ is scored, and its plates and mesh where the truth has them.
    pub run: PathBuf,
    /// Folder of true mattes, or a scene folder with alpha_gt/ in it.
    #[arg(long, value_name = "DIR")]
    pub gt: PathBuf,
    /// Folder of the masks the run started from, to be scored beside it.
    #[arg(long, value_name = "DIR")]
    pub start: Option<PathBuf>,
    /// Print all scores as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `sos report`.
#[derive(Debug, Clone, Args)]
pub struct ReportArgs {
    /// Run folder.
    pub run: PathBuf,
    /// Folder of reference mattes, shown beside the run's own.
    #[arg(long, value_name = "DIR")]
    pub gt: Option<PathBuf>,
}
