//! Values that cannot work, found before anything starts.

use super::overlay::entries;
use super::{ConfigError, DEVICES, Fields, TrainConfig, Transparency};
use crate::words::did_you_mean;

/// Settings that a checkpoint has built in: sizes of tables and networks, the box, the random draws.
const FIXED_ON_RESUME: [&str; 4] = [
    "model.",
    "prepare.",
    "sampling.occupancy_resolution",
    "seed",
];
/// One of theirs that is free: how a device keeps its copy of the tables, for as long as it reads them.
const FREE_ON_RESUME: &str = "model.table_reads";

impl TrainConfig {
    /// Checks that every value lies in the range where it means something.
    ///
    /// # Errors
    /// [`ConfigError::Value`] for the first that does not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if !DEVICES.contains(&self.device.as_str()) {
            return Err(bad(
                "device",
                &self.device,
                format!(
                    "the devices are {}{}",
                    DEVICES.join(", "),
                    did_you_mean(&self.device, DEVICES)
                ),
            ));
        }
        if i64::try_from(self.seed).is_err() {
            return Err(bad(
                "seed",
                self.seed,
                format!("it must be at most {}", i64::MAX),
            ));
        }
        let (model, loss, schedule) = (&self.model, &self.loss, &self.schedule);
        let (sampling, prepare, export) = (&self.sampling, &self.prepare, &self.export);
        for (key, value, least, most) in [
            ("steps", self.steps, 0, 10_000_000),
            ("model.levels", model.levels, 0, 32),
            ("model.base_resolution", model.base_resolution, 2, 4096),
            (
                "model.finest_resolution",
                model.finest_resolution,
                0,
                1 << 20,
            ),
            ("model.log2_table_size", model.log2_table_size, 8, 24),
            ("model.direction_degree", model.direction_degree, 1, 4),
            ("model.hidden", model.hidden, 8, 1024),
            ("model.object_features", model.object_features, 1, 256),
            (
                "model.background_features",
                model.background_features,
                1,
                256,
            ),
            ("schedule.first_levels", schedule.first_levels, 1, 32),
            ("sampling.rays", sampling.rays, 1, 1 << 20),
            ("sampling.most_rays", sampling.most_rays, 1, 1 << 20),
            (
                "sampling.target_samples",
                sampling.target_samples,
                64,
                1 << 24,
            ),
            ("sampling.object_steps", sampling.object_steps, 8, 4096),
            (
                "sampling.background_samples",
                sampling.background_samples,
                4,
                4096,
            ),
            (
                "sampling.occupancy_resolution",
                sampling.occupancy_resolution,
                8,
                512,
            ),
            (
                "sampling.occupancy_every",
                sampling.occupancy_every,
                1,
                100_000,
            ),
            ("prepare.downscale", prepare.downscale, 1, 16),
            ("export.edge_rays", export.edge_rays, 1, 256),
            ("export.mesh_resolution", export.mesh_resolution, 16, 4096),
        ] {
            if !(least..=most).contains(&value) {
                return Err(bad(key, value, format!("it must lie in {least}..={most}")));
            }
        }
        if model.finest_resolution != 0 && model.finest_resolution < model.base_resolution {
            return Err(bad(
                "model.finest_resolution",
                model.finest_resolution,
                format!(
                    "it must be 0 (chosen from the photos) or at least model.base_resolution = {}",
                    model.base_resolution
                ),
            ));
        }
        if model.fields == Fields::Semantic && model.background == Transparency::Sdf {
            return Err(bad(
                "model.fields",
                "semantic",
                "its one field is a density; set model.background to density as well".to_owned(),
            ));
        }
        for (key, value) in [
            ("loss.mask_hold", loss.mask_hold),
            ("loss.mask_end", loss.mask_end),
            ("schedule.carve", schedule.carve),
            ("schedule.votes_start", schedule.votes_start),
            ("schedule.view_start", schedule.view_start),
            ("schedule.view_end", schedule.view_end),
            ("loss.mask_floor", loss.mask_floor),
            ("loss.mask_trusted", loss.mask_trusted),
            ("loss.ignore_band", loss.ignore_band),
            ("schedule.final_ratio", schedule.final_ratio),
            ("schedule.levels_end", schedule.levels_end),
            ("schedule.cos_anneal_end", schedule.cos_anneal_end),
            ("sampling.object_share", sampling.object_share),
            ("sampling.sight_share", sampling.sight_share),
            ("sampling.clear_share", sampling.clear_share),
            ("prepare.hull_threshold", prepare.hull_threshold),
            ("prepare.object_threshold", prepare.object_threshold),
            ("prepare.crop_threshold", prepare.crop_threshold),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(bad(
                    key,
                    value,
                    "it is a share and must lie in 0..=1".to_owned(),
                ));
            }
        }
        if loss.mask_end < loss.mask_hold {
            return Err(bad(
                "loss.mask_end",
                loss.mask_end,
                format!("it must be at least loss.mask_hold = {}", loss.mask_hold),
            ));
        }
        for (key, value) in [
            ("loss.huber_delta", loss.huber_delta),
            ("loss.sparsity_tau", loss.sparsity_tau),
            ("schedule.learning_rate", schedule.learning_rate),
            ("schedule.learning_rate_mlp", schedule.learning_rate_mlp),
            ("schedule.final_ratio", schedule.final_ratio),
            ("sampling.clear_share", sampling.clear_share),
        ] {
            if !value.is_finite() || value <= 0.0 {
                return Err(bad(
                    key,
                    value,
                    "it must be a finite number greater than 0".to_owned(),
                ));
            }
        }
        for (key, value) in [
            ("loss.eikonal", loss.eikonal),
            ("loss.eikonal_background", loss.eikonal_background),
            ("loss.sparsity", loss.sparsity),
            ("loss.mask", loss.mask),
            ("loss.points", loss.points),
            ("loss.curvature", loss.curvature),
            ("loss.distortion", loss.distortion),
            ("loss.far", loss.far),
            ("loss.hidden", loss.hidden),
            ("loss.sight", loss.sight),
            ("loss.background", loss.background),
            ("loss.semantic", loss.semantic),
            (
                "schedule.sharpness_learning_rate",
                schedule.sharpness_learning_rate,
            ),
            ("schedule.sharpness_start", schedule.sharpness_start),
            ("prepare.box_margin", prepare.box_margin),
            ("export.edge_width", export.edge_width),
        ] {
            if !value.is_finite() || value < 0.0 {
                return Err(bad(
                    key,
                    value,
                    "it must be a finite number of at least 0".to_owned(),
                ));
            }
        }
        Ok(())
    }

    /// Checks that a run saved with `saved` can go on with these values: what its checkpoint has
    /// built in must be the same.
    ///
    /// # Errors
    /// [`ConfigError::FixedOnResume`] for the first that is not.
    pub fn check_resumes(&self, saved: &TrainConfig) -> Result<(), ConfigError> {
        for ((key, wanted), (_, saved)) in entries(self)?.into_iter().zip(entries(saved)?) {
            let fixed = FIXED_ON_RESUME
                .iter()
                .any(|fixed| key == *fixed || (fixed.ends_with('.') && key.starts_with(fixed)))
                && key != FREE_ON_RESUME;
            if fixed && wanted != saved {
                return Err(ConfigError::FixedOnResume {
                    key,
                    saved: saved.to_string(),
                    wanted: wanted.to_string(),
                });
            }
        }
        Ok(())
    }
}

fn bad(key: &str, value: impl ToString, reason: String) -> ConfigError {
    ConfigError::Value {
        key: key.to_owned(),
        value: value.to_string(),
        reason,
    }
}
