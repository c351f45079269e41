//! What changes over a run, as functions of the step.

use crate::config::{LossConfig, ScheduleConfig, TrainConfig};

use super::step::StepSchedule;

/// Step `step` of `config.steps`.
#[must_use]
pub fn at(config: &TrainConfig, step: u32, levels: usize) -> StepSchedule {
    let progress = progress(config, step);
    StepSchedule {
        active_levels: active_levels(&config.schedule, progress, levels),
        cos_anneal: (progress / config.schedule.cos_anneal_end.max(1e-6)).min(1.0),
        mask_weight: mask_weight(&config.loss, progress),
        background_gate: if progress < config.loss.mask_end {
            0.0
        } else {
            config.loss.background_gate
        },
    }
}

/// Position in the run, 0 to 1.
#[must_use]
pub fn progress(config: &TrainConfig, step: u32) -> f32 {
    step as f32 / config.steps.max(1) as f32
}

/// Coarse levels first, one more at a time, so that the surface settles before it gets detail.
fn active_levels(schedule: &ScheduleConfig, progress: f32, levels: usize) -> usize {
    let first = (schedule.first_levels as usize).clamp(1, levels);
    let share = (progress / schedule.levels_end.max(1e-6)).min(1.0);
    first + (share * (levels - first) as f32) as usize
}

/// The largest `s` that the sharpness `b = exp(10 s)` may have: it rises evenly over the first 60 %
/// of the run, to where the surface is as thin as a pixel.
///
/// A `b` that runs ahead freezes a surface that is not there yet; `finest` is that of a pixel.
#[must_use]
pub fn sharpness_cap(config: &TrainConfig, step: u32, finest: f32) -> f32 {
    let start = config.schedule.sharpness_start;
    let end = (finest.max(1.0).ln() / 10.0).max(start);
    start + (end - start) * (progress(config, step) / 0.6).min(1.0)
}

/// Full weight at first, then linearly down to the floor.
fn mask_weight(loss: &LossConfig, progress: f32) -> f32 {
    let span = (loss.mask_end - loss.mask_hold).max(1e-6);
    let fallen = ((progress - loss.mask_hold) / span).clamp(0.0, 1.0);
    loss.mask * (1.0 + fallen * (loss.mask_floor - 1.0))
}

/// The factor on every learning rate: a linear warm-up, then exponentially down to `final_ratio`.
#[must_use]
pub fn rate_factor(config: &TrainConfig, step: u32) -> f64 {
    let schedule = &config.schedule;
    let warm = f64::from(schedule.warmup_steps);
    if f64::from(step) < warm {
        return f64::from(step + 1) / warm;
    }
    let rest = (f64::from(config.steps) - warm).max(1.0);
    let share = ((f64::from(step) - warm) / rest).min(1.0);
    f64::from(schedule.final_ratio).powf(share)
}
