//! Arguments of what scores results, and of what they are scored beside.

use super::SettingArgs;
use crate::ablation::Row;
use crate::config::{MaskPolarity, Preset};
use crate::results::Start;
use crate::words::did_you_mean;
use clap::Args;
use sos_eval::Fault;
use std::path::PathBuf;

/// `sos eval`.
#[derive(Debug, Clone, Args)]
pub struct EvalArgs {
    /// Run folder; its alpha/ is scored, and its plates and mesh where the truth has them.
    pub run: PathBuf,
    /// Folder of true mattes, or a scene folder with alpha_gt/ in it.
    #[arg(long, value_name = "DIR")]
    pub gt: PathBuf,
    /// Folder of the masks the run started from, to be scored beside it [default: none].
    #[arg(long, value_name = "DIR")]
    pub start: Option<PathBuf>,
    /// Print all scores as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `sos compare`.
#[derive(Debug, Clone, Args)]
pub struct CompareArgs {
    /// Run folders, or NAME=DIR for any folder of mattes or masks.
    #[arg(required = true, value_name = "RUN|NAME=DIR")]
    pub contenders: Vec<String>,
    /// Folder of true mattes, or a scene folder with alpha_gt/ in it.
    #[arg(long, value_name = "DIR")]
    pub gt: PathBuf,
    /// Also write a page with every view's mattes side by side [default: none].
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// Print all scores as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `sos hull`.
#[derive(Debug, Clone, Args)]
pub struct HullArgs {
    /// Folder with photos and their COLMAP model.
    pub scene: PathBuf,
    /// Folder with a rough mask per photo.
    #[arg(long, value_name = "DIR")]
    pub masks: PathBuf,
    /// Colour of the object in the masks: white or black [default: detected].
    #[arg(long, value_enum, value_name = "COLOUR", hide_possible_values = true)]
    pub polarity: Option<MaskPolarity>,
    /// Folder for the mattes, a PNG per view; it must be empty or not exist yet.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

/// `sos degrade`.
#[derive(Debug, Clone, Args)]
pub struct DegradeArgs {
    /// Folder of true mattes, a picture per view.
    #[arg(long, value_name = "DIR")]
    pub gt: PathBuf,
    /// Folder of the photos of the same views.
    #[arg(long, value_name = "DIR")]
    pub photos: PathBuf,
    /// What is wrong with the masks.
    #[arg(long, value_enum, value_name = "FAULT")]
    pub fault: Fault,
    /// Size of the fault: the share of the object, or of the views, that is wrong.
    #[arg(long, value_name = "SHARE", default_value_t = 0.2, value_parser = share)]
    pub share: f64,
    /// Decides what is left to chance.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Folder for the masks, a PNG per view; it must be empty or not exist yet.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..0.9).contains(&share) => Ok(share),
        _ => Err("it is a number from 0 to 0.9".to_owned()),
    }
}

/// What a table of runs is made with.
#[derive(Debug, Clone, Args)]
pub struct TableArgs {
    /// Runs of each row, with seeds one after another; the table has their mean and spread [default: 1].
    #[arg(long, value_name = "N", default_value_t = 1, hide_default_value = true, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub seeds: u32,
    /// Settings all rows start from: quick, default or paper [default: default].
    #[arg(long, value_enum, value_name = "NAME", hide_possible_values = true)]
    pub preset: Option<Preset>,
    /// Over the preset.
    #[command(flatten)]
    pub settings: SettingArgs,
    /// Train even where a check of a scene fails (sos doctor shows them).
    #[arg(long)]
    pub skip_checks: bool,
    /// Print nothing but the table, errors and warnings.
    #[arg(short, long)]
    pub quiet: bool,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `sos ablate`.
#[derive(Debug, Clone, Args)]
pub struct AblateArgs {
    /// Folder with photos, their COLMAP model and ground truth (alpha_gt/).
    pub scene: PathBuf,
    /// Folder with a rough mask per photo [default: SCENE/masks or SCENE/coarse_masks].
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Colour of the object in the masks: white or black [default: detected].
    #[arg(long, value_enum, value_name = "COLOUR", hide_possible_values = true)]
    pub polarity: Option<MaskPolarity>,
    /// Folder of true mattes, or a scene folder with alpha_gt/ in it [default: SCENE].
    #[arg(long, value_name = "DIR")]
    pub gt: Option<PathBuf>,
    /// Folder for the runs, a folder each, and the table [default: runs/NAME_OF_SCENE-ablation].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Rivals too: the soft visual hull, a radiance field for FoCoR, a semantic field.
    #[arg(long)]
    pub rivals: bool,
    /// Instead of the paper's rows, the method with another choice for one setting at a time.
    #[arg(long)]
    pub decisions: bool,
    /// Only this row, as its folder is called; may be repeated [default: all of the table].
    #[arg(long, value_name = "ROW", conflicts_with_all = ["rivals", "decisions"], value_parser = row)]
    pub only: Vec<Row>,
    /// Of all its runs.
    #[command(flatten)]
    pub table: TableArgs,
}

/// A row of the ablation by its name.
fn row(name: &str) -> Result<Row, String> {
    let row = Row::named(name);
    row.ok_or_else(|| {
        let names = Row::names();
        let near = did_you_mean(name, names.iter().copied());
        format!("the rows are {}{near}", names.join(", "))
    })
}

/// `sos results`.
#[derive(Debug, Clone, Args)]
pub struct ResultsArgs {
    /// Folders with photos, their COLMAP model and ground truth (alpha_gt/) [default: the built-in demo scene].
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    /// What runs begin with: own for SCENE/masks or SCENE/coarse_masks, none, or true masks with a fault of
    /// sos degrade; may be repeated [default: all].
    #[arg(long, value_name = "START", value_parser = start)]
    pub start: Vec<Start>,
    /// Folder for masks, runs and the table [default: runs/results].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Of all its runs.
    #[command(flatten)]
    pub table: TableArgs,
}

/// What a run begins with, by its name.
fn start(name: &str) -> Result<Start, String> {
    Start::named(name).ok_or_else(|| {
        let names: Vec<String> = Start::every().map(Start::name).collect();
        let near = did_you_mean(name, names.iter().map(String::as_str));
        format!("the starts are {}{near}", names.join(", "))
    })
}
