//! `sos-eval PRED_DIR GT_DIR [--start DIR] [--filled] [--json FILE]`: scores a folder of alpha mattes.

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Scores a folder of alpha mattes against a folder of true ones and prints a table.
#[derive(Parser)]
#[command(version)]
struct Args {
    /// Folder of mattes (PNG or JPEG, alpha channel or grey), one per view.
    pred_dir: PathBuf,
    /// Folder of true mattes; they define the views. Files match by name or trailing number.
    gt_dir: PathBuf,
    /// Folder of masks to compare with, such as those the run started from.
    #[arg(long, value_name = "DIR")]
    start: Option<PathBuf>,
    /// Fill holes of all mattes first, true ones too: score outer outlines alone.
    #[arg(long)]
    filled: bool,
    /// Also write all scores to this file as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// How many of the worst views to print.
    #[arg(long, value_name = "N", default_value_t = 5)]
    worst: usize,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(table) => {
            print!("{table}");
            ExitCode::SUCCESS
        }
        Err(sentence) => {
            eprintln!("{sentence}.");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> Result<String, String> {
    let compare = if args.filled {
        sos_eval::compare_silhouettes
    } else {
        sos_eval::compare_folders
    };
    let report =
        compare(&args.pred_dir, &args.gt_dir, args.start.as_deref()).map_err(|e| e.to_string())?;
    if let Some(path) = &args.json {
        let fail = |e: String| {
            format!(
                "the scores cannot be written to {} ({e}): choose another file",
                path.display()
            )
        };
        let json = serde_json::to_string_pretty(&report).map_err(|e| fail(e.to_string()))?;
        std::fs::write(path, json + "\n").map_err(|e| fail(e.to_string()))?;
    }
    Ok(report.table(args.worst))
}
