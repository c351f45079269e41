//! Whether a training, or a picture, has room in this machine's memory at all: found out before any of it is taken,
//! which would end the program without a word.

use crate::config::{ConfigError, TrainConfig};
use crate::train::BACKGROUND_STRIDE;
use crate::train::setup::{FINEST, MOST_LEVELS};
use hashgrid::{GridConfig, GridLayout};
use io_colmap::Model;

use super::estimate::entry_in_memory;

/// Bytes of a sample, at the least: where it is, which way and how far the light goes, and what its field says of it.
const SAMPLE: u64 = 64;

/// Refuses settings whose tables or samples alone take more than `memory` bytes.
///
/// Both are known roughly only: tables as if the object filled a photo of `model`, samples from below.
///
/// # Errors
/// [`ConfigError::Value`] that names the settings to lower.
pub fn check(config: &TrainConfig, model: &Model, memory: u64) -> Result<(), ConfigError> {
    let (sizes, sampling) = (&config.model, &config.sampling);
    let tables = 2 * entry_in_memory(config) * entries(config, model);
    let of_ray = sampling.background_samples + sampling.object_steps / BACKGROUND_STRIDE;
    let samples = SAMPLE * u64::from(sampling.rays) * u64::from(of_ray);
    let table_size = ("model.log2_table_size", sizes.log2_table_size);
    let rays = ("sampling.rays", sampling.rays);
    let per_ray = ", sampling.background_samples or sampling.object_steps";
    for ((key, value), what, bytes, others) in [
        (table_size, "hash tables", tables, " or model.levels"),
        (rays, "samples of its first step", samples, per_ray),
    ] {
        if bytes > memory {
            let [bytes, memory] = [bytes, memory].map(|bytes| bytes as f64 / 1e9);
            return Err(ConfigError::Value {
                key: key.to_owned(),
                value: value.to_string(),
                reason: format!(
                    "the {what} take about {bytes:.1} GB, and this machine has {memory:.1} GB of memory; set it{others} \
                     lower"
                ),
            });
        }
    }
    Ok(())
}

/// Entries of one field's table, about.
fn entries(config: &TrainConfig, model: &Model) -> u64 {
    let sizes = &config.model;
    let sides = model
        .cameras
        .values()
        .map(|camera| camera.width.max(camera.height));
    let longest = sides.max().unwrap_or(0) / config.prepare.downscale.max(1);
    let finest = match sizes.finest_resolution {
        0 => longest.clamp(FINEST[0], FINEST[1]),
        fixed => fixed,
    };
    let grid = GridConfig {
        levels: match sizes.levels {
            0 => MOST_LEVELS,
            fixed => fixed as usize,
        },
        base_resolution: sizes.base_resolution,
        finest_resolution: finest.max(sizes.base_resolution),
        log2_table_size: sizes.log2_table_size,
        ..GridConfig::default()
    };
    // What makes no grid is refused elsewhere.
    GridLayout::try_new(&grid).map_or(0, |layout| layout.entries() as u64)
}

/// Bytes of memory that this machine has, with those that it keeps on a disk, where it says so.
#[must_use]
pub fn of_machine() -> Option<u64> {
    let swap = kilobytes("/proc/meminfo", "SwapTotal:").unwrap_or(0);
    Some(1024 * (kilobytes("/proc/meminfo", "MemTotal:")? + swap))
}

/// Bytes that the system can still give and what this program has already, where it says so.
#[must_use]
pub fn left() -> Option<u64> {
    // Without files that are mapped: what of them is in memory can be given back.
    let own = kilobytes("/proc/self/status", "RssAnon:").unwrap_or(0);
    Some(1024 * (kilobytes("/proc/meminfo", "MemAvailable:")? + own))
}

fn kilobytes(file: &str, key: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find(|line| line.starts_with(key))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    const GIGABYTE: u64 = 1_000_000_000;

    #[test]
    fn every_preset_has_room_in_two_gigabytes() {
        for preset in [Preset::Quick, Preset::Default, Preset::Paper] {
            let config = TrainConfig::preset(preset);
            assert_eq!(check(&config, &Model::default(), 2 * GIGABYTE), Ok(()));
        }
    }

    #[test]
    fn what_no_machine_holds_is_refused_with_the_settings_to_lower() {
        let refused = |change: fn(&mut TrainConfig), memory: u64| {
            let mut config = TrainConfig::default();
            change(&mut config);
            check(&config, &Model::default(), memory).map_err(|error| error.to_string())
        };
        let tables = |config: &mut TrainConfig| {
            config.model.levels = 32;
            config.model.log2_table_size = 24;
            config.model.finest_resolution = 1 << 20;
        };
        let says = refused(tables, 8 * GIGABYTE).err().unwrap_or_default();
        for part in ["model.log2_table_size = 24", "8.0 GB", "model.levels"] {
            assert!(says.contains(part), "{says}");
        }
        assert_eq!(refused(tables, 64 * GIGABYTE), Ok(()));
        let rays = |config: &mut TrainConfig| {
            config.sampling.rays = 1 << 20;
            config.sampling.background_samples = 4096;
        };
        let says = refused(rays, 64 * GIGABYTE).err().unwrap_or_default();
        for part in [
            "sampling.rays = 1048576",
            "64.0 GB",
            "sampling.background_samples",
        ] {
            assert!(says.contains(part), "{says}");
        }
    }
}
