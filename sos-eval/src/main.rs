//! `sos-eval PRED_DIR GT_DIR [--start DIR] [--filled] [--json FILE]`: scores a folder of alpha mattes.

use clap::Parser;
use draft_folder::Durability;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
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
        Ok(table) => match io::stdout().write_all(table.as_bytes()) {
            // A reader that has seen enough, as `head` has, is no failure.
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => refuse(&format!(
                "the table cannot be printed ({error}): check where the output leads"
            )),
            _ => ExitCode::SUCCESS,
        },
        Err(sentence) => refuse(&sentence),
    }
}

fn refuse(sentence: &str) -> ExitCode {
    eprintln!("{sentence}.");
    ExitCode::from(2)
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
        let json = serde_json::to_string_pretty(&report).map_err(|e| e.to_string())?;
        let write = |out: &mut BufWriter<File>| writeln!(out, "{json}");
        draft_folder::write_file(path, Durability::Program, write).map_err(|e| e.to_string())?;
    }
    Ok(report.table(args.worst))
}
