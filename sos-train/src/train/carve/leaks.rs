//! Masks that leak.
//!
//! Segmenters run over where a photo shows no edge: into a black room, an overexposed table. A zone of one colour of which a
//! mask takes only a small part is cut by it where nothing is to be seen, so that this part is no witness. Only where the
//! masks of the other views have the object there as well is it one: what looks like the ground beside it.

use std::collections::VecDeque;

use rayon::prelude::*;

use super::openings::covered;
use crate::grown::grown;
use crate::prepare::mask::Mask;
use crate::prepare::spans::PixelSpans;
use crate::prepare::{Prepared, TrainView, outline};
use crate::squares::Squares;
use crate::train::Trainer;

/// Squares along a photo's longer side: noise averages out in them.
const LONGEST: u32 = 400;
/// Squares of a zone differ from those around them by no more than this in any channel, of 255.
const FLAT: u8 = 5;
/// The least share of the picture that a zone has.
const SMALLEST: f32 = 0.003;
/// The largest share of a zone that a mask may leak into.
const CUT: f32 = 0.35;
/// Nearly all masks that see a place must have it for the object: a hull of half of them is fat.
const HULL: f32 = 0.85;
/// What lies in that hull by this share is no leak.
const AGREED: f32 = 0.8;

impl Trainer {
    /// Takes the vote from pixels that masks leak into. Returns what was done, for people; `None` if nothing.
    pub(super) fn find_leaks(&mut self, data: &mut Prepared) -> Option<String> {
        self.mask_faults.leaks = leaks(data);
        let silent = &self.mask_faults.leaks;
        for (outline, leak) in data.outlines.iter_mut().zip(silent) {
            outline.silence(leak);
        }
        let leaky = silent.iter().filter(|pixels| !pixels.is_empty()).count();
        let pixels: usize = silent.iter().map(PixelSpans::len).sum();
        (leaky > 0).then(|| {
            format!(
                "{leaky} of {} masks leak into surroundings without an edge, {:.1} % of what they cover: that has no vote",
                data.views.iter().filter(|view| view.mask.is_some()).count(),
                100.0 * pixels as f32 / covered(data).max(1) as f32
            )
        })
    }
}

/// The pixels of each view that its mask leaks into.
fn leaks(data: &Prepared) -> Vec<PixelSpans> {
    let views = data.views.par_iter().zip(&data.trust.0);
    views
        .map(|(view, trust)| match &view.mask {
            Some(mask) if *trust >= 0.5 => leak(view, mask, data),
            _ => PixelSpans::default(),
        })
        .collect()
}

fn leak(view: &TrainView, mask: &Mask, data: &Prepared) -> PixelSpans {
    let (width, height) = (view.width(), view.height());
    let squares = Squares::new(width, height, LONGEST);
    let columns = squares.columns as usize;
    let places = || (0..squares.rows).flat_map(|y| (0..squares.columns).map(move |x| (x, y)));
    let colours: Vec<[u8; 3]> = places()
        .map(|(x, y)| squares.colour(&view.photo, x, y).0)
        .collect();
    let inside: Vec<bool> = places()
        .map(|(x, y)| {
            let middle =
                |square: u32, end: u32| (square * squares.side + squares.side / 2).min(end - 1);
            mask.contains(middle(x, width), middle(y, height))
        })
        .collect();
    let parts = cut_off(&colours, &inside, columns);
    if parts.is_empty() {
        return PixelSpans::default();
    }
    let together = outline::silhouette(view, &data.frame, &data.map, squares.side);
    let agreed = |part: &Vec<usize>| {
        let in_hull = |i: &&usize| f32::from(together.as_raw()[**i]) >= 255.0 * HULL;
        part.iter().filter(in_hull).count() as f32 / part.len() as f32
    };
    let mut leaking = vec![false; colours.len()];
    for part in parts.iter().filter(|part| agreed(part) < AGREED) {
        part.iter().for_each(|i| leaking[*i] = true);
    }
    // Squares at a zone's border are not flat themselves.
    let leaking = grown(&leaking, columns, 1);
    let mut pixels = PixelSpans::default();
    for (x, y) in mask.pixels() {
        if leaking[squares.of(x, y)] {
            pixels.push(y * width + x);
        }
    }
    pixels
}

/// The parts inside of flat zones that are mostly outside: squares by number, row-major.
fn cut_off(colours: &[[u8; 3]], inside: &[bool], columns: usize) -> Vec<Vec<usize>> {
    let rows = colours.len() / columns.max(1);
    let alike = |a: usize, b: usize| {
        let channels = colours[a].iter().zip(colours[b]);
        channels.into_iter().all(|(a, b)| a.abs_diff(b) <= FLAT)
    };
    let mut flat: Vec<bool> = (0..colours.len())
        .map(|i| {
            let (x, y) = (i % columns, i / columns);
            let around = (y.saturating_sub(1)..(y + 2).min(rows)).flat_map(|y| {
                (x.saturating_sub(1)..(x + 2).min(columns)).map(move |x| y * columns + x)
            });
            around.into_iter().all(|j| alike(i, j))
        })
        .collect();
    let mut parts = Vec::new();
    let mut queue = VecDeque::new();
    for first in 0..flat.len() {
        if !std::mem::take(&mut flat[first]) {
            continue;
        }
        queue.push_back(first);
        let mut zone = Vec::new();
        while let Some(i) = queue.pop_front() {
            zone.push(i);
            let (x, y) = (i % columns, i / columns);
            let next = [
                (x > 0).then(|| i - 1),
                (x + 1 < columns).then_some(i + 1),
                (y > 0).then(|| i - columns),
                (y + 1 < rows).then_some(i + columns),
            ];
            for j in next.into_iter().flatten() {
                if std::mem::take(&mut flat[j]) {
                    queue.push_back(j);
                }
            }
        }
        let size = zone.len() as f32;
        zone.retain(|i| inside[*i]);
        let small = size < SMALLEST * colours.len() as f32;
        if !small && !zone.is_empty() && zone.len() as f32 <= CUT * size {
            parts.push(zone);
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let parts = cut_off(&colours, &inside, columns);
        assert_eq!(parts.len(), 1);
        assert!(parts[0].len() > 50, "{}", parts[0].len());
        for i in &parts[0] {
            let (x, y) = (i % columns, i / columns);
            assert!(inside[*i] && !disc(x, y), "({x}, {y})");
        }
    }

    #[test]
    fn texture_says_nothing_of_leaks() {
        let (colours, inside, columns) = picture(|x, y| disc(x, y) || (x > 40 && y < 20));
        assert!(cut_off(&colours, &inside, columns).is_empty());
    }

    #[test]
    fn a_zone_that_is_mostly_inside_is_the_objects() {
        let (colours, inside, columns) = picture(|x, _| x < 31);
        assert!(cut_off(&colours, &inside, columns).is_empty());
    }

    #[test]
    fn no_picture_has_no_zones() {
        assert!(cut_off(&[], &[], 0).is_empty());
    }
}
