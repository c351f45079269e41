//! Finding the object without masks.
//!
//! A capture says what it is of by where its cameras look. So a background field learns the whole region of interest
//! ([`region`]) for a while, helped by places where rays are known to end (`places.rs`); its depths, fused, are solid shapes; the
//! plane that things stand on is taken away ([`sparse_ground`], [`plane`]), before a wall the shelf as well (`division.rs`), and with
//! it what bulges out of it (`humps.rs`); what stands close together is parted (`standing.rs`, `beside.rs`); and of the parts that
//! remain, the object is the one in the middle of what cameras look at (`gaze.rs`), or the one that a hint points at ([`parts`]). Where a few views have masks, the object is what they show and what hangs together with it
//! instead, ground or not (`spread.rs`). Where it goes on beyond the region, a larger one is looked at in the same way; where it
//! hangs together with too much there, it is parted from what hangs on it by thin bridges (`cores.rs`), or else followed from what
//! it was to where it ends (`beyond.rs`). What it touches begins where colours change (`seams.rs`).
//! Every view's pixels that show this part are its rough mask ([`masks`]), and from there on a run is like any other.
//!
//! The whole of it is open point 5 of the method, which leaves the choice of the surface to the reader.

mod beside;
mod beyond;
mod columns;
mod cores;
mod division;
mod gaze;
mod hanging;
pub mod hint;
mod humps;
mod judge;
mod look;
pub mod masks;
mod network;
mod normal;
pub mod part_set;
pub mod parts;
mod places;
pub mod plane;
pub mod region;
mod seams;
pub mod sparse_ground;
mod spread;
#[cfg(test)]
mod staged;
mod standing;
mod surroundings;
mod sweep;

use std::sync::atomic::AtomicBool;

use io_colmap::SparsePoint;

use crate::config::{Preset, TrainConfig, Transparency};
use crate::prepare::error::PrepareError;
use crate::prepare::mask::Mask;
use crate::prepare::{Frame, Sights, TrainView};

pub use hint::Hint;
use look::Look;
use places::Places;

/// Looks at ever larger regions, at most, while what was found goes on beyond them.
const MOST_LOOKS: usize = 3;
/// Steps that the whole scene is learnt for, as a share of the run's, and at most.
const STEP_SHARE: f32 = 0.5;
const MOST_STEPS: u32 = 4000;
/// What short runs spend on it, as far as they have as many: with fewer the wrong thing is found.
const WORTHWHILE_STEPS: u32 = 1500;
/// What light costs that comes from elsewhere than where a ray is known to end.
const SIGHT: f32 = 0.02;

/// The object that was found.
#[derive(Debug)]
pub struct Discovery {
    /// A rough mask for each view, white is the object.
    pub masks: Vec<Mask>,
    /// What was chosen and why, for the user.
    pub notes: Vec<String>,
}

/// What the search for the object is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Searching {
    /// Photos are asked for places that they agree on, one by one.
    Places,
    /// A region is learnt, step by step.
    Region,
}

/// Looks for the object that `views` are of. `None` when `interrupt` came up.
///
/// `points` are the model's sparse points, `sights` what the views see of them.
///
/// `progress` is told what it is at, how far and of how much, from 1 on for the photos and for each region that is looked at.
///
/// # Errors
/// When cameras, points and hints do not determine a region, or nothing stands in it.
pub fn find_object(
    views: &[TrainView],
    points: &[SparsePoint],
    sights: &Sights,
    hint: &Hint,
    config: &TrainConfig,
    interrupt: &AtomicBool,
    mut progress: impl FnMut(Searching, u32, u32),
) -> Result<Option<Discovery>, PrepareError> {
    let config = search_config(config);
    let region = hint.region(views, points)?;
    let asked = |done, photos| progress(Searching::Places, done, photos);
    let places = Places::known(views, points, sights, interrupt, asked)?;
    let mut learnt = |done, steps| progress(Searching::Region, done, steps);
    let look_at = |region| {
        Look::new(
            views,
            &places,
            hint,
            &config,
            region,
            interrupt,
            &mut learnt,
        )
    };
    let Some((mut look, refused)) = looked(region, hint, look_at)? else {
        return Ok(None);
    };
    let border = settle_border(&mut look, hint, refused);
    look.settle_ends(hint);
    let data = &look.data;
    let masks = data
        .views
        .iter()
        .enumerate()
        .map(|(number, view)| Mask::of_white(&look.mask(number), &view.store))
        .collect::<Result<_, _>>()?;
    let followed = look.goes_beyond_another().then(|| {
        "it went on beyond a smaller box, and what hangs together with it there belongs to it"
            .to_owned()
    });
    let notes = [Some(choice_note(&look, hint)), followed, border];
    let notes = notes.into_iter().flatten().collect();
    Ok(Some(Discovery { masks, notes }))
}

/// The object in a region, or in a larger one where it goes on beyond it, and why a larger one was of no use; `None` when interrupted.
fn looked(
    region: Frame,
    hint: &Hint,
    mut look_at: impl FnMut(Frame) -> Result<Option<Look>, PrepareError>,
) -> Result<Option<(Look, Option<String>)>, PrepareError> {
    let Some(mut look) = look_at(region)? else {
        return Ok(None);
    };
    for _ in 1..MOST_LOOKS {
        let Some(larger) = look.region_beyond(hint) else {
            break;
        };
        match look_at(larger) {
            Ok(None) => return Ok(None),
            Ok(Some(wider)) if wider.shows_more_of(&look) => look = wider,
            Ok(Some(wider)) => {
                return Ok(Some(match wider.going_on_from(look, hint) {
                    Ok(wider) => (wider, None),
                    Err(before) => {
                        let why = "in a larger one it hung together with too much";
                        (*before, Some(why.to_owned()))
                    }
                }));
            }
            Err(error) => {
                let why = format!("a larger one was of no use ({error})");
                return Ok(Some((look, Some(why))));
            }
        }
    }
    Ok(Some((look, None)))
}

/// Parts the object from what goes on beyond the region, where that can be; what the user has to know of the region's border.
fn settle_border(look: &mut Look, hint: &Hint, refused: Option<String>) -> Option<String> {
    if look.goes_on(hint) {
        if let Some(core) = look.parted(hint) {
            look.chosen = core;
            return Some(
                "what was found went on beyond that box by thin bridges alone, and was parted there; give all of \
                 it with --box if it is cut off"
                    .to_owned(),
            );
        }
        let why = refused
            .unwrap_or_else(|| format!("so it did in each of {MOST_LOOKS} ever larger ones"));
        return Some(format!(
            "the object goes on beyond that box, and is cut off there: {why}; give all of it with --box"
        ));
    }
    look.region_beyond(hint).map(|_| {
        "the object reaches a side of that box; if a tip of it is cut off, give all of it with --box"
            .to_owned()
    })
}

/// What was taken for the object and why, for the user.
fn choice_note(look: &Look, hint: &Hint) -> String {
    let first = look.first();
    let chosen_from = match hint {
        Hint::Masks(_) => String::new(),
        _ => format!(
            ", one of {} parts, {}",
            first.parts.count(),
            match (&first.ground, &first.wall) {
                (Some(_), Some(_)) =>
                    "without the wall behind it and what it stands on (give all that is wanted with --box if that \
                     belongs to it)",
                (Some(_), None) => "without the ground it stands on",
                (None, _) => "where no ground was found",
            }
        ),
    };
    let Frame { centre, half_side } = look.data.frame;
    format!(
        "{} taken for the object{chosen_from}, in the box around ({:.3}, {:.3}, {:.3}) of side {:.3}; found_masks/ shows it",
        hint.reason(),
        centre.x,
        centre.y,
        centre.z,
        2.0 * half_side,
    )
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
    config.loss.sight = SIGHT;
    config
}
