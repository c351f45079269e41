//! Writes the demo scene into a folder.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use clap::Parser;
use demo_scene::{DemoConfig, generate};

/// Generate the demo scene: photos of a watering can with exact ground truth.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Folder to create.
    out: PathBuf,
    /// Number of views.
    #[arg(long)]
    views: Option<usize>,
    /// Image width in pixels.
    #[arg(long)]
    width: Option<u32>,
    /// Image height in pixels.
    #[arg(long)]
    height: Option<u32>,
    /// Seed of cameras, noise and mask flaws.
    #[arg(long)]
    seed: Option<u64>,
    /// Start from the miniature instead of the full demo.
    #[arg(long)]
    tiny: bool,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let base = if arguments.tiny {
        DemoConfig::tiny()
    } else {
        DemoConfig::default()
    };
    let config = DemoConfig {
        views: arguments.views.unwrap_or(base.views),
        width: arguments.width.unwrap_or(base.width),
        height: arguments.height.unwrap_or(base.height),
        seed: arguments.seed.unwrap_or(base.seed),
        ..base
    };
    let start = Instant::now();
    let scene = generate(&config);
    scene
        .write(&arguments.out)
        .context("the scene was not written")?;
    println!(
        "{}: {} views, {} points, mean coarse IoU {:.3}, {:.1} s",
        arguments.out.display(),
        scene.views.len(),
        scene.points.len(),
        scene.mean_coarse_iou(),
        start.elapsed().as_secs_f64()
    );
    Ok(())
}
