//! Masks that leak.
//!
//! Segmenters run over where a photo shows no edge: into a black room, an overexposed table. A zone of one colour of which a
//! mask takes only a small part is cut by it where nothing is to be seen, so that this part is no witness; of a zone that is
//! cut in halves all of it is none. Only where the masks of the other views have the object there as well is it one: what
//! looks like the ground beside it.

use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use super::silence;
use crate::cells::grown;
use crate::flat_zones::{self, flat_zones};
use crate::prepare::frame::Frame;
use crate::prepare::mask::Mask;
use crate::prepare::spans::PixelSpans;
use crate::prepare::{Prepared, TrainView, outline};
use crate::train::Trainer;

/// The largest share of a zone that a mask may leak into.
const CUT: f32 = 0.35;
/// Up to this one a mask may as well have lost the rest: neither side has a vote.
const TORN: f32 = 0.65;
/// Nearly all masks that see a place must have it for the object: a hull of half of them is fat.
const HULL: f32 = 0.85;
/// What lies in that hull by this share is no leak.
const AGREED: f32 = 0.8;

impl Trainer {
    /// Takes the vote from pixels that masks leak into. Returns what was done, for people; `None` if nothing.
    pub(super) fn find_leaks(&mut self, data: &mut Prepared) -> Option<String> {
        self.mask_faults.leaks = leaks(data);
        let (masks, all, percent) = silence(data, &self.mask_faults.leaks)?;
        Some(format!(
            "{masks} of {all} masks leak into surroundings without an edge, {percent:.1} % of what they cover: that has no vote"
        ))
    }
}

/// The pixels of each view of which its mask says nothing: what it leaks into, and zones that it cuts in halves.
fn leaks(data: &Prepared) -> Vec<PixelSpans> {
    let views = data.views.par_iter().zip(&data.trust.0);
    views
        .map(|(view, trust)| match &view.mask {
            Some(mask) if *trust >= 0.5 => leak(view, mask, &data.frame, &data.map),
            _ => PixelSpans::default(),
        })
        .collect()
}

/// The same for one view; `map` is what all masks together say.
fn leak(view: &TrainView, mask: &Mask, frame: &Frame, map: &ProbabilityMap) -> PixelSpans {
    let squares = flat_zones::squares(view);
    let columns = squares.columns as usize;
    let colours = flat_zones::colours(view, &squares);
    let middles = (0..squares.len()).map(|i| squares.middle(i));
    let inside: Vec<bool> = middles.map(|(x, y)| mask.contains(x, y)).collect();
    let cuts = cut_off(&colours, &inside, columns);
    if cuts.is_empty() {
        return PixelSpans::default();
    }
    let together = outline::silhouette(view, frame, map, squares.side);
    let agreed = |cut: &Cut| {
        let in_hull = |i: &&usize| f32::from(together.as_raw()[**i]) >= 255.0 * HULL;
        cut.part.iter().filter(in_hull).count() as f32 / cut.part.len() as f32
    };
    let (mut leaking, mut torn) = (vec![false; colours.len()], vec![false; colours.len()]);
    for cut in cuts.iter().filter(|cut| agreed(cut) < AGREED) {
        cut.part.iter().for_each(|i| leaking[*i] = true);
        if cut.is_torn() {
            cut.zone.iter().for_each(|i| torn[*i] = true);
        }
    }
    // Squares at a zone's border are not flat themselves.
    let leaking = grown(&leaking, columns, 1);
    let mut pixels = PixelSpans::default();
    for y in 0..view.height() {
        for x in 0..view.width() {
            let square = squares.of(x, y);
            if torn[square] || leaking[square] && mask.contains(x, y) {
                pixels.push(y * view.width() + x);
            }
        }
    }
    pixels
}

/// A flat zone of which a mask takes no more than about half.
struct Cut {
    /// Its squares by number, row-major.
    zone: Vec<usize>,
    /// Those of them that the mask has.
    part: Vec<usize>,
}

impl Cut {
    /// How much of the zone the mask has.
    fn share(&self) -> f32 {
        self.part.len() as f32 / self.zone.len() as f32
    }

    /// Whether that is about half.
    fn is_torn(&self) -> bool {
        self.share() > CUT
    }
}

/// The flat zones that are cut by the mask which has the squares `inside`; row-major.
fn cut_off(colours: &[[u8; 3]], inside: &[bool], columns: usize) -> Vec<Cut> {
    let mut cuts = Vec::new();
    for zone in flat_zones(colours, columns) {
        let part = zone.iter().copied().filter(|i| inside[*i]).collect();
        let cut = Cut { zone, part };
        if !cut.part.is_empty() && cut.share() <= TORN {
            cuts.push(cut);
        }
    }
    cuts
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::prepare::balls;
    use glam::DVec3;

    /// A dark disc on a ground that is flat on its left, and textured on its right; and what a mask has of it.
    fn picture(mask: impl Fn(usize, usize) -> bool) -> (Vec<[u8; 3]>, Vec<bool>, usize) {
        let (columns, rows) = (60, 40);
        let places = || (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        let colour = |(x, y): (usize, usize)| {
            let disc = x.abs_diff(30).pow(2) + y.abs_diff(20).pow(2) < 100;
            let texture = if x > 30 { (x * 7 + y * 5) % 31 } else { x % 2 };
            [if disc { 40 } else { 200 + texture as u8 }; 3]
        };
        let inside = places().map(|(x, y)| mask(x, y)).collect();
        (places().map(colour).collect(), inside, columns)
    }

    fn disc(x: usize, y: usize) -> bool {
        x.abs_diff(30).pow(2) + y.abs_diff(20).pow(2) < 100
    }

    #[test]
    fn a_mask_that_ends_where_the_photo_has_an_edge_does_not_leak() {
        let (colours, inside, columns) = picture(disc);
        assert!(cut_off(&colours, &inside, columns).is_empty());
    }

    #[test]
    fn a_mask_leaks_where_it_ends_in_a_flat_zone() {
        let (colours, inside, columns) = picture(|x, y| disc(x, y) || (x < 30 && x > 12 && y < 20));
        let cuts = cut_off(&colours, &inside, columns);
        assert_eq!(cuts.len(), 1);
        assert!(!cuts[0].is_torn());
        assert!(cuts[0].part.len() > 50, "{}", cuts[0].part.len());
        for i in &cuts[0].part {
            let (x, y) = (i % columns, i / columns);
            assert!(inside[*i] && !disc(x, y), "({x}, {y})");
        }
    }

    #[test]
    fn a_zone_that_is_cut_in_halves_is_torn() {
        let (colours, inside, columns) = picture(|x, y| disc(x, y) || (x < 30 && y < 20));
        let cuts = cut_off(&colours, &inside, columns);
        assert_eq!(cuts.len(), 1);
        assert!(cuts[0].is_torn());
        assert!(cuts[0].zone.iter().any(|i| i / columns > 30));
        assert!(cuts[0].part.iter().all(|i| i / columns < 20));
    }

    #[test]
    fn texture_says_nothing_of_leaks() {
        let (colours, inside, columns) = picture(|x, y| disc(x, y) || (x > 40 && y < 20));
        assert!(cut_off(&colours, &inside, columns).is_empty());
    }

    #[test]
    fn a_zone_that_is_mostly_inside_is_the_objects() {
        let (colours, inside, columns) = picture(|x, y| disc(x, y) || x < 31);
        assert!(cut_off(&colours, &inside, columns).is_empty());
    }

    #[test]
    fn what_nearly_all_masks_have_is_no_leak() {
        // A ball in a photo that is black all over.
        let view = balls::view(DVec3::new(0.0, 0.0, -4.0), DVec3::Z);
        let view = balls::with_balls(view, &[(DVec3::ZERO, 0.5)]);
        let mask = view.mask.as_ref().unwrap();
        let frame = Frame {
            centre: DVec3::ZERO,
            half_side: 1.0,
        };
        let silent = |share: f32| {
            let map = ProbabilityMap::new(4, vec![share; 64]);
            leak(&view, mask, &frame, &map).len()
        };
        assert_eq!(silent(0.5), mask.area());
        assert_eq!(silent(0.9), 0);
    }

    #[test]
    fn no_picture_has_no_zones() {
        assert!(cut_off(&[], &[], 0).is_empty());
    }
}
