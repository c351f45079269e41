//! What a training will take, from a few of its steps.

use super::room;
use crate::config::TrainConfig;
use crate::prepare::error::PrepareError;
use crate::prepare::{MAP_RESOLUTION, Outline, Prepared, TrainView};
use crate::train::Trainer;
use hashgrid::{GridLayout, MomentPrecision};
use scene_doctor::Cost;
use std::time::Instant;

/// Steps before the clock starts, at most: memory is fetched and the occupancy grids are filled.
const WARM_UP: u32 = 4;
/// Steps that are timed, at most.
const TIMED: u32 = 24;
/// Seconds after which no further step begins, in either of them.
const PATIENCE: f64 = 3.0;
/// The mean step of a whole run over one of its first, least and most, on the scenes of
/// docs/results.md: levels are added, then there are two fields.
const GROWTH: [f64; 2] = [1.2, 1.8];
/// Time for a pixel's pictures at the end over that of a first step, least and most; hair costs more.
const PIXEL_PER_STEP: [f64; 2] = [1.4e-4, 3e-4];
/// Bytes of all pictures of a run for each pixel, and of the report for each view.
const PICTURES: u64 = 4;
const REPORT: u64 = 120_000;
/// Bytes of a mesh of 256 cells a side; it grows with their square.
const MESH: u64 = 5_000_000;
/// Bytes in a checkpoint for each entry of a hash table: its two values, and two moments of each.
const ENTRY_ON_DISK: u64 = 2 * 4 * 3;
/// Maps of the object's probability in a checkpoint.
const MAPS_ON_DISK: u64 = 3 * 4 * (MAP_RESOLUTION as u64).pow(3);
/// The program, maps of space, and what a step and the pictures at the end need beside them.
const REST_IN_MEMORY: u64 = 450_000_000;

/// Times the first steps of a training and counts what it keeps.
///
/// # Errors
/// When the device does not exist, or cannot hold the model.
pub fn measured(config: &TrainConfig, data: &Prepared) -> Result<Cost, PrepareError> {
    let mut trainer = Trainer::new(config, data)?;
    let mut seconds_of = |most: u32| {
        let (begun, mut done) = (Instant::now(), 0);
        while done < most && begun.elapsed().as_secs_f64() < PATIENCE {
            trainer.step(data);
            done += 1;
        }
        (begun.elapsed().as_secs_f64(), done)
    };
    seconds_of(WARM_UP);
    let (seconds, timed) = seconds_of(TIMED);
    let step = seconds / f64::from(timed);
    let pixels = pixels(data);
    let minutes = [0, 1].map(|i| {
        let training = GROWTH[i] * f64::from(config.steps) * step;
        let pictures = PIXEL_PER_STEP[i] * pixels as f64 * step;
        (training + pictures) / 60.0
    });
    Ok(Cost {
        minutes: Some(minutes),
        basis: format!(
            "time estimated from {timed} steps of {:.0} ms on {}, the rest counted",
            1e3 * step,
            trainer.device_name()
        ),
        ..counted(config, data)
    })
}

/// Memory and disk, counted from the sizes of photos and tables.
#[must_use]
pub fn counted(config: &TrainConfig, data: &Prepared) -> Cost {
    let sizes = crate::train::setup::scene_config(config, data);
    let entries: u64 = [&sizes.object_grid, &sizes.background_grid]
        .map(|grid| GridLayout::new(grid).entries() as u64)
        .iter()
        .sum();
    let (pixels, views) = (pixels(data), data.views.len() as u64);
    let in_views = data.views.iter().map(TrainView::in_memory);
    let in_labels = data.outlines.iter().map(Outline::in_memory);
    let in_memory: usize = in_views.chain(in_labels).sum();
    let cells = u64::from(config.export.mesh_resolution);
    let occupancy = 2 * 4 * u64::from(config.sampling.occupancy_resolution).pow(3);
    Cost {
        steps: config.steps,
        minutes: None,
        memory: entries * entry_in_memory(config) + in_memory as u64 + REST_IN_MEMORY,
        memory_left: room::left(),
        disk: entries * ENTRY_ON_DISK
            + MAPS_ON_DISK
            + occupancy
            + pixels * PICTURES
            + views * REPORT
            + MESH * cells * cells / (256 * 256),
        basis: "counted from the sizes of photos and tables".to_owned(),
    }
}

/// Bytes in memory for each entry of a hash table: its two values, and two moments of each. A gradient
/// there is of one level at a time.
pub(super) fn entry_in_memory(config: &TrainConfig) -> u64 {
    let moment = match config.schedule.moments {
        MomentPrecision::Single => 4,
        MomentPrecision::Half => 2,
    };
    2 * (4 + 2 * moment)
}

fn pixels(data: &Prepared) -> u64 {
    data.views
        .iter()
        .map(|view| u64::from(view.width()) * u64::from(view.height()))
        .sum()
}
