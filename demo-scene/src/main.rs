//! Writes the demo scene into a folder.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, value_parser};
use demo_scene::{DemoConfig, SceneKind, check_vacant, generate};

/// What clap ends with too.
const BAD_INPUT: u8 = 2;
/// Pixels a side, at most: the pictures of all views are in memory together.
const MOST_PIXELS: i64 = 8192;

/// Generate the demo scene, photos of a watering can with exact ground truth, or one that is harder.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Folder to create.
    out: PathBuf,
    /// Number of views.
    #[arg(long, value_parser = value_parser!(u16).range(1..=1000))]
    views: Option<u16>,
    /// Image width in pixels.
    #[arg(long, value_parser = value_parser!(u32).range(1..=MOST_PIXELS))]
    width: Option<u32>,
    /// Image height in pixels.
    #[arg(long, value_parser = value_parser!(u32).range(1..=MOST_PIXELS))]
    height: Option<u32>,
    /// Seed of cameras, noise and mask flaws.
    #[arg(long)]
    seed: Option<u64>,
    /// Which scene.
    #[arg(long, value_enum, default_value_t)]
    kind: SceneKind,
    /// Start from the miniature instead of the full demo.
    #[arg(long)]
    tiny: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // Before any work is done for it.
    if let Err(error) = check_vacant(&arguments.out) {
        eprintln!("{error}.");
        return ExitCode::from(BAD_INPUT);
    }
    let base = if arguments.tiny {
        DemoConfig::tiny()
    } else {
        DemoConfig::default()
    };
    let config = DemoConfig {
        kind: arguments.kind,
        views: arguments.views.map_or(base.views, usize::from),
        width: arguments.width.unwrap_or(base.width),
        height: arguments.height.unwrap_or(base.height),
        seed: arguments.seed.unwrap_or(base.seed),
        ..base
    };
    let start = Instant::now();
    let scene = generate(&config);
    if let Err(error) = scene.write(&arguments.out) {
        eprintln!("{error}.");
        return ExitCode::FAILURE;
    }
    println!(
        "{}: {} views, {} points, mean coarse IoU {:.3}, {:.1} s",
        arguments.out.display(),
        scene.views.len(),
        scene.points.len(),
        scene.mean_coarse_iou(),
        start.elapsed().as_secs_f64()
    );
    ExitCode::SUCCESS
}
