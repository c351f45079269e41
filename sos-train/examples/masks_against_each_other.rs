//! Where the masks of a scene say that the object is, and which of them contradict the others:
//! `cargo run --release -p sos-train --example masks_against_each_other SCENE MASKS`.

use io_colmap::{MaskSet, Scene};
use sos_train::config::TrainConfig;
use sos_train::prepare::{MaskConsensus, view::load_views};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(scene), Some(masks)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: masks_against_each_other SCENE MASKS");
        return ExitCode::from(2);
    };
    match compare(&scene, &masks) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn compare(scene: &Path, masks: &Path) -> anyhow::Result<()> {
    let scene = Scene::open(scene)?;
    let masks = MaskSet::find(masks, &scene, None)?;
    let views = load_views(&scene, Some(&masks))?;
    let config = TrainConfig::default().prepare;
    let found = MaskConsensus::of(&views, &scene.model.points, &config)?;
    println!(
        "the object is around {:.3}, in a box with sides of {:.3}",
        found.frame.centre,
        2.0 * found.frame.half_side
    );
    for (view, trust) in views.iter().zip(&found.trust.0) {
        match &view.mask {
            Some(_) if *trust < 0.5 => println!("{}: contradicts the others", view.name),
            Some(_) => println!("{}: believed", view.name),
            None => println!("{}: no mask", view.name),
        }
    }
    Ok(())
}
