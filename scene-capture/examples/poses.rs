//! Makes a COLMAP scene of a folder of photos or a video:
//! `cargo run --release -p scene-capture --example poses PHOTOS_OR_VIDEO OUT`.

use scene_capture::{CaptureError, CaptureOptions, Progress, Tools, Watch, capture, detect};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(from), Some(out)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: poses PHOTOS_OR_VIDEO OUT");
        return ExitCode::from(2);
    };
    match poses(&from, &out) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn poses(from: &Path, out: &Path) -> Result<(), CaptureError> {
    let Some(source) = detect(from) else {
        println!("{}: no video, and no photos without poses", from.display());
        return Ok(());
    };
    let tools = Tools::find_for(&source)?;
    let screen = Screen::default();
    let captured = capture(&source, out, &tools, &CaptureOptions::default(), &screen)?;
    screen.end_stage();
    if let Some(warning) = captured.warning {
        println!("warning: {warning}");
    }
    Ok(())
}

/// Says what is decided as it is, and how long each stage took.
#[derive(Default)]
struct Screen(Mutex<Option<(Progress, Instant)>>);

impl Screen {
    fn end_stage(&self) {
        if let Ok(mut stage) = self.0.lock()
            && let Some((progress, begun)) = stage.take()
        {
            let seconds = begun.elapsed().as_secs_f64();
            println!("{}: {}, {seconds:.1} s", progress.stage, progress.done);
        }
    }
}

impl Watch for Screen {
    fn progress(&self, progress: Progress) {
        let same = |(known, _): &(Progress, Instant)| known.stage == progress.stage;
        if !self.0.lock().is_ok_and(|s| s.as_ref().is_some_and(same)) {
            self.end_stage();
        }
        if let Ok(mut stage) = self.0.lock() {
            let begun = stage.take().map_or_else(Instant::now, |(_, begun)| begun);
            *stage = Some((progress, begun));
        }
    }

    fn note(&self, sentence: &str) {
        self.end_stage();
        println!("{sentence}");
    }
}
