//! How fast training is, and how fast it could be: one run measures the machine's peaks, the fused
//! ops against their rooflines, whole training steps with their phases, and, where it is asked for, PyTorch's step.
//!
//! - `peaks.rs`: arithmetic and memory at best;
//! - `fields.rs`: the fused ops, and what they would take at those peaks;
//! - `equal.rs`: a step at the paper's sizes, sample for sample that of PyTorch;
//! - `steps.rs`: steps of the default preset as a run does them, on the demo scene;
//! - `phases.rs`: where a step's time goes;
//! - `pictures.rs`: a finished run's mattes and plates;
//! - `on_device.rs`: ops and steps on a GPU against what it does at best;
//! - `predict.rs`: the least time of that step on a device that is not at hand, and of training with it;
//! - `torch.rs`, `torch_step.py`: the same step in PyTorch;
//! - `report.rs`: all of it as a table or as JSON.

mod equal;
mod fields;
#[cfg(feature = "gpu")]
mod on_device;
mod peaks;
mod phases;
mod pictures;
mod predict;
mod report;
mod scene;
mod steps;
mod torch;

use std::fmt::Display;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use serde::Serialize;
use sos_train::config::Preset;
use sos_train::device::choose;

use equal::Sizes;
use predict::{Prediction, Rates};
use report::{Comparison, Report};

// As in `sos`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Measures training against this machine's peaks.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench")]
struct Options {
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Compare with the same step in PyTorch, where python3 has torch.
    #[arg(long)]
    against_torch: bool,
    /// The Python to ask.
    #[arg(long, default_value = "python3", value_name = "PROGRAM")]
    python: PathBuf,
    /// Where to compute: auto, cpu, ndarray, flex, or in builds for it wgpu or cuda.
    #[arg(long, default_value = "cpu", value_name = "NAME")]
    device: String,
    /// Measured steps at the paper's sizes.
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    steps: usize,
    /// Steps of a preset; 0 leaves them out.
    #[arg(
        long,
        default_value_t = 400,
        value_name = "N",
        visible_alias = "preset-steps"
    )]
    default_steps: u32,
    /// Which preset: quick, default or paper.
    #[arg(long, value_enum, default_value_t = Preset::Default, value_name = "NAME", hide_possible_values = true)]
    preset: Preset,
    /// Measure nothing: say what a device of these rates could reach at best, as in 67000,4800, and with the cores
    /// of the processor beside it, as in 67000,4800,16, how fast it would train.
    #[arg(long, value_name = "GFLOPS,GBS[,CORES]")]
    predict: Option<Rates>,
    /// Measure only this: how long the pictures of a finished run take.
    #[arg(long, value_name = "RUN", conflicts_with = "predict")]
    pictures: Option<PathBuf>,
}

/// Rays of a step at the paper's sizes, and samples on each.
const RAYS: usize = 1024;
const SAMPLES: usize = 64;
/// Ours and PyTorch's step are measured in turn, so often.
const ROUNDS: usize = 2;

fn main() -> ExitCode {
    sos_train::memory::keep_freed_memory();
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(options: &Options) -> Result<()> {
    if let Some(rates) = options.predict {
        return answer(options, &Prediction::new(rates, RAYS * SAMPLES));
    }
    if let Some(folder) = &options.pictures {
        return answer(options, &pictures::measure(folder)?);
    }
    let threads = rayon::current_num_threads();
    let sizes = Sizes {
        rays: RAYS,
        samples: SAMPLES,
        steps: options.steps,
    };
    let chosen = choose(&options.device)?;
    let say = |what: &str| eprintln!("measuring {what} …");
    #[cfg(feature = "gpu")]
    if chosen.kind != sos_train::device::DeviceKind::Processor {
        anyhow::ensure!(
            !options.against_torch,
            "--against-torch compares steps on the CPU; leave out --device, or --against-torch"
        );
        say(&chosen.name);
        let steps = (options.preset, options.default_steps);
        let report = on_device::measure(&chosen, &options.device, sizes, steps)?;
        return answer(options, &report);
    }
    let device = chosen.device;
    say("the machine's peaks");
    let peaks = peaks::Peaks::measure(threads);
    say("the fused ops");
    let ops = fields::measure(&peaks, &device)?;
    let python = options.against_torch.then_some(options.python.as_path());
    let python = python.filter(|python| {
        let found = torch::is_installed(python);
        if !found {
            eprintln!(
                "{} has no torch, so there is no comparison; `pip install torch` makes one",
                python.display()
            );
        }
        found
    });
    let mut ours = Vec::new();
    let mut comparisons = Vec::new();
    for _ in 0..if python.is_some() { ROUNDS } else { 1 } {
        say("a step at the paper's sizes");
        let figures = equal::measure(sizes, &options.device)?;
        if let Some(python) = python {
            say("PyTorch's step");
            let torch = torch::measure(python, sizes, threads)?;
            comparisons.push(Comparison {
                ratio: figures.trained_samples_per_s / torch.samples_per_s,
                ours_samples_per_s: figures.trained_samples_per_s,
                torch,
            });
        }
        ours.push(figures);
    }
    let preset_steps = if options.default_steps > 0 {
        say(&format!("steps of the {} preset", options.preset));
        Some(steps::measure(
            options.preset,
            options.default_steps,
            &options.device,
        )?)
    } else {
        None
    };
    let report = Report::new(threads, peaks, ops, ours, comparisons, preset_steps);
    answer(options, &report)
}

/// Prints figures as was asked.
fn answer(options: &Options, figures: &(impl Serialize + Display)) -> Result<()> {
    if options.json {
        println!("{}", serde_json::to_string(figures)?);
    } else {
        println!("{figures}");
    }
    Ok(())
}
