//! What changes over a run, as functions of the step.

use losses::Schedule;

use crate::config::{Fields, LossConfig, ScheduleConfig, TrainConfig, Transparency};

use super::step::StepSchedule;

/// Step `step` of `config.steps`.
#[must_use]
pub fn at(config: &TrainConfig, step: u32, levels: usize) -> StepSchedule {
    let progress = progress(config, step);
    let levels_of = |transparency| match transparency {
        Transparency::Sdf => active_levels(&config.schedule, progress, levels),
        Transparency::Density => levels,
    };
    StepSchedule {
        step,
        active_levels: levels_of(config.model.foreground),
        background_levels: levels_of(config.model.background),
        cos_anneal: (progress / config.schedule.cos_anneal_end.max(1e-6)).min(1.0),
        // Without an object there is no matte to compare.
        mask_weight: if background_alone(config, step) {
            0.0
        } else {
            mask_weight(&config.loss, progress)
        },
        far_weight: far_weight(config, progress),
        sight_weight: sight_weight(config, progress),
        view_share: rise(
            progress,
            config.schedule.view_start,
            config.schedule.view_end,
        ),
    }
}

/// Share of the run after the carving in which the price of distance falls to nothing.
const FAR_FALL: f32 = 0.2;

/// Distance has its price while geometry is being found; later on it would only pull at it.
fn far_weight(config: &TrainConfig, progress: f32) -> f32 {
    let start = carve_step(config) as f32 / config.steps.max(1) as f32;
    config.loss.far * (1.0 - rise(progress, start, start + FAR_FALL))
}

/// Shares of the run between which the price of light from elsewhere than where rays are known to end falls to nothing.
const SIGHT_FALLS: [f32; 2] = [0.3, 0.6];

/// It clears what photos could be explained with as well. Later on it would only wear away thin things beside such rays.
fn sight_weight(config: &TrainConfig, progress: f32) -> f32 {
    let [start, end] = SIGHT_FALLS;
    config.loss.sight * (1.0 - rise(progress, start, end))
}

/// The step from which on that price is nothing, and from the start where it has none.
pub(super) fn sights_end(config: &TrainConfig) -> u32 {
    if config.loss.sight == 0.0 {
        return 0;
    }
    (SIGHT_FALLS[1] * config.steps as f32).ceil() as u32
}

/// 0 until `start`, 1 from `end` on, even in between.
fn rise(progress: f32, start: f32, end: f32) -> f32 {
    ((progress - start) / (end - start).max(1e-6)).clamp(0.0, 1.0)
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

/// `s` of an object just carved: b = 120.
const CARVED_SHARPNESS: f32 = 0.48;

/// The largest `s` that the sharpness `b = exp(10 s)` may have: it rises evenly over the first 60 %
/// of the run, to where the surface is as thin as a pixel.
///
/// A `b` that runs ahead freezes a surface that is not there yet; `finest` is that of a pixel.
#[must_use]
pub fn sharpness_cap(config: &TrainConfig, step: u32, finest: f32) -> f32 {
    let carve = carve_step(config);
    let start = match carve {
        0 => config.schedule.sharpness_start,
        // The surface is known to a few voxels then.
        _ => config.schedule.sharpness_start.max(CARVED_SHARPNESS),
    };
    let end = (finest.max(1.0).ln() / 10.0).max(start);
    let risen = step.saturating_sub(carve) as f32 / (0.6 * (config.steps - carve).max(1) as f32);
    start + (end - start) * risen.min(1.0)
}

/// Whether BaCo is the only field at `step`: until FoCoR is carved out of it, or for good where one
/// field is the whole scene.
#[must_use]
pub fn background_alone(config: &TrainConfig, step: u32) -> bool {
    config.model.fields == Fields::Semantic || step < carve_step(config)
}

/// The step at which FoCoR is carved out of BaCo, or would be; 0 when both learn from the start.
#[must_use]
pub fn carve_step(config: &TrainConfig) -> u32 {
    match (config.model.fields, config.model.background) {
        // Depths of a surface that is still a fog of one sharpness tell nothing yet.
        (Fields::Object, _) | (_, Transparency::Sdf) => 0,
        (_, Transparency::Density) => (config.schedule.carve * config.steps as f32) as u32,
    }
}

/// Has a run that goes on at `step` with other settings, or other steps in all, carve FoCoR out once: what was carved with the
/// settings `before` stays so, and what was not is carved when the new ones say, or at the next step if that has passed.
pub fn keep_carving(config: &mut TrainConfig, before: &TrainConfig, step: u32) {
    let (earlier, stated) = (carve_step(before), carve_step(config));
    let carve = if step > earlier {
        earlier
    } else {
        stated.max(step)
    };
    if carve != stated {
        // In the middle of a step, so that it stays that step when rounded.
        config.schedule.carve = match carve {
            0 => 0.0,
            _ => ((carve as f32 + 0.5) / config.steps as f32).min(1.0),
        };
    }
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
    let rate = Schedule::WarmUpDecay {
        peak: 1.0,
        warm_up: config.schedule.warmup_steps.into(),
        end: config.steps.into(),
        final_ratio: config.schedule.final_ratio.into(),
    };
    rate.at(step.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    /// The step of the carving of a run of 8000 steps, 2400 before it, that goes on at `step` with `steps` in all.
    fn carved_at(step: u32, steps: u32, carve: f32) -> u32 {
        let mut before = TrainConfig::preset(Preset::Default);
        before.steps = 8000;
        before.schedule.carve = 0.3;
        let mut config = before.clone();
        config.steps = steps;
        config.schedule.carve = carve;
        keep_carving(&mut config, &before, step);
        assert!((0.0..=1.0).contains(&config.schedule.carve));
        carve_step(&config)
    }

    #[test]
    fn a_run_that_goes_on_with_other_steps_carves_once() {
        // Carved already: longer, shorter, with another share.
        for (steps, carve) in [(12_000, 0.3), (2500, 0.3), (8000, 0.9), (8000, 0.0)] {
            assert_eq!(carved_at(2401, steps, carve), 2400, "{steps}, {carve}");
        }
        // Not yet: when the new settings say, or at once.
        assert_eq!(carved_at(2400, 8000, 0.3), 2400);
        assert_eq!(carved_at(2000, 12_000, 0.3), 3600);
        assert_eq!(carved_at(2000, 6000, 0.3), 2000);
        assert_eq!(carved_at(2000, 6000, 0.0), 2000);
        assert_eq!(carved_at(2000, 2000, 0.3), 2000);
        // Or not at all.
        assert_eq!(carved_at(2000, 8000, 1.0), 8000);
    }

    #[test]
    fn fields_that_learn_together_from_the_start_go_on_so() {
        let before = TrainConfig::preset(Preset::Paper);
        let mut config = before.clone();
        config.steps = 50_000;
        keep_carving(&mut config, &before, 40_000);
        assert_eq!(carve_step(&config), 0);
        assert_eq!(config.schedule, before.schedule);
    }
}
