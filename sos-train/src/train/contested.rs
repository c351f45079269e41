//! Views in which something hides the object that is painted like it.
//!
//! Where nothing has texture, a flake of BaCo before a few cameras explains their photos as well as FoCoR
//! behind it does, and no other view contradicts it. Their mattes lack the object then, and their plates show it.
//! Masks know better. What BaCo keeps in the box may hide the object by rights, a cup on its table or what a
//! mask takes in by mistake, so that a pixel's mask alone decides nothing (`loss.hidden`). But where BaCo hides a good
//! part of what FoCoR has in the middle of a view's mask, that view is taken at its word from then on.

use neus_render::rays::Ray;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::batch::BatchMarcher;
use super::visible::Alone;
use super::{SETTLING, Trainer, VOTES_EVERY, march_config, schedule, space};
use crate::config::{Blend, Fields};
use crate::prepare::{Prepared, Shown};

/// Rays that are looked along in a view, and the fewest that it is judged by.
const RAYS: usize = 64;
const FEWEST_RAYS: usize = 16;
/// Views that are looked at at once: of more, one in two and so on, in turn.
const VIEWS: u32 = 64;
/// How much of a mask's middle FoCoR has to fill for the view to be judged by it.
const FILLED: f32 = 0.5;
/// The share of FoCoR there that is hidden in a contested view.
const HIDDEN: f32 = 0.3;

/// Numbers of contested views, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Contested(Vec<u32>);

impl Contested {
    /// Whether FoCoR has the right of way on a pixel of the view.
    pub(super) fn clears(&self, view: u32, shown: Shown) -> bool {
        match shown {
            Shown::No => false,
            Shown::ByMask => self.0.binary_search(&view).is_ok(),
            Shown::ByColour => true,
        }
    }

    fn add(&mut self, views: &[u32]) {
        self.0.extend_from_slice(views);
        self.0.sort_unstable();
        self.0.dedup();
    }
}

impl Trainer {
    /// Now and then looks for further contested views, once there is an object to speak of. Returns what people
    /// should know.
    pub fn contested_note(&mut self, data: &Prepared) -> Option<String> {
        if !self.may_clear() || !self.step.is_multiple_of(VOTES_EVERY) {
            return None;
        }
        let found = self.newly_contested(data);
        self.contested.add(&found);
        let first = *found.first()?;
        Some(format!(
            "step {}: in {} of {} views, {} among them, something that only they see hides the object though \
             their masks show it: it is cleared away",
            self.step,
            found.len(),
            data.views.len(),
            data.views[first as usize].name
        ))
    }

    /// Whether there is an object to speak of, in a run in which what hides it has a price.
    pub(super) fn may_clear(&self) -> bool {
        let config = self.config();
        let settled = schedule::carve_step(config) + (SETTLING * config.steps as f32) as u32;
        config.loss.hidden > 0.0
            && config.model.fields == Fields::Both
            && config.model.blend == Blend::Sample
            && self.step >= settled
    }

    fn newly_contested(&mut self, data: &Prepared) -> Vec<u32> {
        let schedule = self.schedule();
        let fields = self.look_ahead(schedule);
        let config = self.config();
        let (grids, partition) = space(config, self.step, &self.grids, &self.map);
        let march = march_config(config);
        let turns = (data.views.len() as u32).div_ceil(VIEWS).max(1);
        let turn = self.step / VOTES_EVERY % turns;
        (0..data.views.len() as u32)
            .into_par_iter()
            .filter(|view| view % turns == turn && self.contested.0.binary_search(view).is_err())
            .map_init(BatchMarcher::default, |marcher, view| {
                let rays: Vec<Ray> = self.sampler.object_rays(data, view, self.step, RAYS);
                let marched = marcher.march(&rays, grids, &march, partition);
                let alone = Alone {
                    object: true,
                    background: false,
                };
                let (_, look) = fields.look(marched, config, schedule.cos_anneal, |_| alone);
                let (mut whole, mut visible) = (0.0, 0.0);
                for seen in &look.visibility.object {
                    whole += seen.alone * seen.opacity;
                    visible += seen.weight;
                }
                let filled = rays.len() >= FEWEST_RAYS && whole >= FILLED * rays.len() as f32;
                (filled && whole - visible > HIDDEN * whole).then_some(view)
            })
            .flatten()
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::tiny;

    /// FoCoR is a ball, and BaCo a haze, as at every start, or a fog that hides the ball from everybody.
    #[test]
    fn masks_are_believed_where_the_background_hides_what_they_show() {
        let config = tiny::config();
        let data = tiny::prepared(&config, &[]);
        let step = |fog: bool, look: bool| {
            let mut trainer = Trainer::new(&config, &data).expect("a trainer");
            if fog {
                let last = &mut trainer.scene.background.sdf[1];
                last.bias = last.bias.clone().map(|bias| bias - 4.0);
            }
            let note = look.then(|| trainer.contested_note(&data)).flatten();
            (note, trainer.step(&data).losses.hidden)
        };
        assert_eq!(step(false, true).0, None);
        let (note, cleared) = step(true, true);
        let note = note.expect("contested views");
        assert!(note.contains("hides the object though"), "{note}");
        // Most of the fog is in the box, where it may hide what it likes.
        let (_, left) = step(true, false);
        assert!(cleared > 0.1 && left < 0.3 * cleared, "{left}, {cleared}");
    }

    #[test]
    fn a_contested_view_clears_the_middle_of_its_mask() {
        let mut contested = Contested::default();
        contested.add(&[4, 2]);
        contested.add(&[3]);
        for view in 2..5 {
            assert!(contested.clears(view, Shown::ByMask));
            assert!(!contested.clears(view, Shown::No));
        }
        assert!(!contested.clears(1, Shown::ByMask));
        // Colours decide pixel by pixel.
        assert!(contested.clears(1, Shown::ByColour));
    }
}
