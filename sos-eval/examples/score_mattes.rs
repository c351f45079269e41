//! Scores a folder of any tool's mattes against the truth:
//! `cargo run --release -p sos-eval --example score_mattes MATTES TRUTH`.

use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut folders = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(mattes), Some(truth)) = (folders.next(), folders.next()) else {
        eprintln!("usage: score_mattes MATTES TRUTH");
        return ExitCode::from(2);
    };
    match sos_eval::compare_folders(&mattes, &truth, None) {
        Ok(report) => {
            // The means over all views, and the three worst.
            print!("{}", report.table(3));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
