//! Makes a COLMAP scene of a folder with poses of any known tool:
//! `cargo run -p scene-import --example convert SCENE OUT`.

use scene_import::{ImportError, MaskOptions, detect, read};
use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(scene), Some(out)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: convert SCENE OUT");
        return ExitCode::from(2);
    };
    match convert(&scene, &out) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn convert(scene: &std::path::Path, out: &std::path::Path) -> Result<(), ImportError> {
    let detected = detect(scene, None)?;
    println!("{}", detected.sentence());
    let imported = read(&detected, None)?;
    for sentence in imported.dropped_sentences() {
        println!("{sentence}");
    }
    let written = imported.write(out, &MaskOptions::default())?;
    for note in &written.notes {
        println!("{note}");
    }
    println!("{} photos, {} masks", written.photos, written.masks);
    Ok(())
}
