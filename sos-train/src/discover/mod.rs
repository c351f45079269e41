//! Finding the object without masks.
//!
//! A capture says what it is of by where its cameras look. So a background field learns the whole
//! region of interest ([`region`]) for a while; its depths, fused, are solid shapes; the plane that
//! things stand on is taken away ([`plane`]), and with it what bulges out of it (`humps.rs`); what stands close together is parted (`standing.rs`); and of the parts
//! that remain, the object is the one in the middle, or the one that a hint points at ([`parts`]). Where a few views have masks,
//! the object is what they show and what hangs together with it instead, ground or not (`spread.rs`). Where it goes on beyond the region, a larger
//! one is looked at in the same way; where that is of no use, it is parted from what hangs on it by thin bridges
//! (`cores.rs`), or else followed from what it was to where it ends (`beyond.rs`). Every view's pixels that show this part
//! are its rough mask ([`masks`]), and from there on a run is like any other.
//!
//! The whole of it is open point 5 of the method, which leaves the choice of the surface to the reader.

mod beyond;
mod cores;
mod hanging;
pub mod hint;
mod humps;
mod judge;
mod look;
pub mod masks;
mod network;
mod normal;
pub mod parts;
pub mod plane;
pub mod region;
mod spread;
#[cfg(test)]
mod staged;
mod standing;
mod sweep;

use std::sync::atomic::AtomicBool;

use io_colmap::SparsePoint;

use crate::config::{Preset, TrainConfig, Transparency};
use crate::prepare::TrainView;
use crate::prepare::error::PrepareError;
use crate::prepare::mask::Mask;

pub use hint::Hint;
use look::Look;

/// Looks at ever larger regions, at most, while what was found goes on beyond them.
const MOST_LOOKS: usize = 3;
/// Steps that the whole scene is learnt for, as a share of the run's, and at most.
const STEP_SHARE: f32 = 0.5;
const MOST_STEPS: u32 = 4000;
/// What short runs spend on it, as far as they have as many: with fewer the wrong thing is found.
const WORTHWHILE_STEPS: u32 = 1500;

/// The object that was found.
#[derive(Debug)]
pub struct Discovery {
    /// A rough mask for each view, white is the object.
    pub masks: Vec<Mask>,
    /// What was chosen and why, for the user.
    pub notes: Vec<String>,
}

/// Looks for the object that `views` are of. `None` when `interrupt` came up.
///
/// `progress` is told the steps done and to be done, from 1 on for each region that is looked at.
///
/// # Errors
/// When cameras, points and hints do not determine a region, or nothing stands in it.
pub fn find_object(
    views: &[TrainView],
    points: &[SparsePoint],
    hint: &Hint,
    config: &TrainConfig,
    interrupt: &AtomicBool,
    mut progress: impl FnMut(u32, u32),
) -> Result<Option<Discovery>, PrepareError> {
    let config = search_config(config);
    let mut look_at = |region| {
        Look::new(
            views,
            points,
            hint,
            &config,
            region,
            interrupt,
            &mut progress,
        )
    };
    let Some(mut look) = look_at(hint.region(views, points)?)? else {
        return Ok(None);
    };
    let mut refused = None;
    for _ in 1..MOST_LOOKS {
        let Some(larger) = look.region_beyond(hint) else {
            break;
        };
        match look_at(larger) {
            Ok(None) => return Ok(None),
            Ok(Some(wider)) if wider.shows_more_of(&look) => look = wider,
            Ok(Some(wider)) => {
                match wider.going_on_from(look, hint) {
                    Ok(wider) => look = wider,
                    Err(before) => {
                        look = *before;
                        refused = Some("a larger one showed no more of it".to_owned());
                    }
                }
                break;
            }
            Err(error) => {
                refused = Some(format!("a larger one was of no use ({error})"));
                break;
            }
        }
    }
    let beyond = if look.goes_on(hint) {
        let why = refused
            .unwrap_or_else(|| format!("so it did in each of {MOST_LOOKS} ever larger ones"));
        Some(match look.parted(hint) {
            Some(core) => {
                look.chosen = core;
                "what was found went on beyond that box by thin bridges alone, and was parted there; give all of \
                 it with --box if it is cut off"
                    .to_owned()
            }
            None => format!(
                "the object goes on beyond that box, and is cut off there: {why}; give all of it with --box"
            ),
        })
    } else if look.region_beyond(hint).is_some() {
        Some(
            "the object reaches a side of that box; if a tip of it is cut off, give all of it with --box"
                .to_owned(),
        )
    } else if look.goes_beyond_another() {
        Some(
            "it went on beyond a smaller box, and what hangs together with it there belongs to it"
                .to_owned(),
        )
    } else {
        None
    };
    let data = &look.data;
    let masks = data
        .views
        .iter()
        .enumerate()
        .map(|(number, view)| Mask::of_white(&look.mask(number), &view.store))
        .collect::<Result<_, _>>()?;
    let chosen_from = match hint {
        Hint::Masks(_) => String::new(),
        _ => format!(
            ", one of {} parts, {}",
            look.first().parts.count(),
            if look.first().ground.is_some() {
                "without the ground it stands on"
            } else {
                "where no ground was found"
            }
        ),
    };
    let mut notes = vec![format!(
        "{} taken for the object{chosen_from}, in the box around ({:.3}, {:.3}, {:.3}) of side {:.3}; found_masks/ shows it",
        hint.reason(),
        data.frame.centre.x,
        data.frame.centre.y,
        data.frame.centre.z,
        2.0 * data.frame.half_side,
    )];
    notes.extend(beyond);
    Ok(Some(Discovery { masks, notes }))
}

/// The settings of the search: the background alone, as a density, whatever the run itself is to be.
fn search_config(run: &TrainConfig) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Default);
    config.seed = run.seed;
    config.device.clone_from(&run.device);
    config.steps = ((STEP_SHARE * run.steps as f32) as u32)
        .clamp(WORTHWHILE_STEPS.min(run.steps), MOST_STEPS)
        .max(1);
    config.schedule.carve = 1.0;
    config.model.background = Transparency::Density;
    config.loss.mask = 0.0;
    config.loss.mask_trusted = 0.0;
    config.loss.hidden = 0.0;
    config
}
