//! Coarse masks: the exact silhouettes, made wrong in the ways a single-view segmenter is wrong.
//!
//! Views fail independently: blobby outlines, all too wide or too narrow, a lost extremity, a
//! leak into a neighbour of similar colour, filled holes; two views have no mask and one has half
//! of the object. All flaws grow with one strength, which bisection sets so that the mean IoU,
//! a missing mask counting as 0, meets [`MEAN_IOU`].

use std::collections::VecDeque;

use glam::DVec2;
use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::mask::{Mask, fill_holes};
use crate::noise::{Rng, fbm2};

/// The mean IoU aimed for.
const MEAN_IOU: f64 = 0.80;

/// What is decided once per view; only the strength varies afterwards.
struct Flaws<'a> {
    truth: Mask,
    photo: &'a RgbImage,
    distance: Vec<f64>,
    /// Slow and fast noise, about unit deviation.
    outline: Vec<f64>,
    /// Square root of the silhouette's area: the unit of length.
    size: f64,
    bias: f64,
    lost_end: Option<Loss>,
    leaks: Vec<Leak>,
    fills_holes: bool,
    half: Option<DVec2>,
}

struct Loss {
    direction: DVec2,
    share: f64,
}

struct Leak {
    /// Where along the outline it starts, in `[0, 1)`.
    start: f64,
    reach: f64,
    tolerance: i32,
}

impl<'a> Flaws<'a> {
    fn draw(photo: &'a RgbImage, alpha: &GrayImage, half: Option<DVec2>, rng: &mut Rng) -> Self {
        let truth = Mask::from_alpha(alpha);
        let size = (truth.on.iter().filter(|on| **on).count() as f64)
            .sqrt()
            .max(1.0);
        let seed = rng.bits() as u32;
        let outline = (0..truth.on.len())
            .map(|i| {
                let p = truth.position(i) / size;
                3.0 * fbm2(p * 5.5, 2, seed) + 1.6 * fbm2(p * 14.0, 2, seed ^ 0x55)
            })
            .collect();
        let mut leak = || Leak {
            start: rng.unit(),
            reach: rng.range(0.12, 0.34),
            tolerance: rng.range(38.0, 80.0) as i32,
        };
        let drawn = [leak(), leak()];
        let number = [0, 0, 1, 1, 2][rng.below(5)];
        let direction = DVec2::new(rng.normal(), rng.normal()).normalize_or(DVec2::X);
        let loss = Loss {
            direction,
            share: rng.range(0.04, 0.13),
        };
        Self {
            distance: truth.signed_distance(),
            truth,
            photo,
            outline,
            size,
            bias: rng.normal(),
            lost_end: (rng.unit() < 0.5).then_some(loss),
            leaks: drawn.into_iter().take(number).collect(),
            fills_holes: rng.unit() < 0.35,
            half,
        }
    }

    fn apply(&self, strength: f64) -> Mask {
        let unit = strength * self.size;
        let mut mask = self.truth.clone();
        if strength <= 0.0 {
            return mask;
        }
        for (i, on) in mask.on.iter_mut().enumerate() {
            *on = self.distance[i] + unit * (0.017 * self.outline[i] + 0.017 * self.bias) > 0.0;
        }
        if let Some(loss) = &self.lost_end {
            self.lose(&mut mask, loss, strength);
        }
        for leak in &self.leaks {
            self.leak(&mut mask, leak, strength);
        }
        if self.fills_holes {
            fill_holes(&mut mask);
        }
        if let Some(direction) = self.half {
            let along = |i: usize| {
                self.truth.position(i).dot(direction) + 0.03 * self.size * self.outline[i]
            };
            let cut = self.quantile(along, 0.52);
            for (i, on) in mask.on.iter_mut().enumerate() {
                *on &= along(i) > cut;
            }
        }
        mask
    }

    /// Value of `key` below which the given share of the silhouette lies.
    fn quantile(&self, key: impl Fn(usize) -> f64, share: f64) -> f64 {
        let mut values: Vec<f64> = (0..self.truth.on.len())
            .filter(|i| self.truth.on[*i])
            .map(key)
            .collect();
        values.sort_by(f64::total_cmp);
        let index = (share.clamp(0.0, 1.0) * values.len() as f64) as usize;
        values
            .get(index.min(values.len().saturating_sub(1)))
            .copied()
            .unwrap_or(0.0)
    }

    /// Cuts off what is nearest to the silhouette's end in some direction.
    fn lose(&self, mask: &mut Mask, loss: &Loss, strength: f64) {
        let inside = (0..self.truth.on.len()).filter(|i| self.truth.on[*i]);
        let Some(end) = inside
            .map(|i| self.truth.position(i))
            .max_by(|a, b| a.dot(loss.direction).total_cmp(&b.dot(loss.direction)))
        else {
            return;
        };
        let key =
            |i: usize| (self.truth.position(i) - end).length() + 0.04 * self.size * self.outline[i];
        let cut = self.quantile(key, (loss.share * strength).min(0.3));
        for (i, on) in mask.on.iter_mut().enumerate() {
            *on &= key(i) > cut;
        }
    }

    /// Grows over pixels of similar colour from a place just outside the outline.
    fn leak(&self, mask: &mut Mask, leak: &Leak, strength: f64) {
        let rim: Vec<usize> = (0..self.truth.on.len())
            .filter(|i| (-3.5..-1.5).contains(&self.distance[*i]))
            .collect();
        let Some(&start) = rim.get((leak.start * rim.len() as f64) as usize) else {
            return;
        };
        let colour = |i: usize| {
            let (x, y) = (i % self.truth.width, i / self.truth.width);
            self.photo.get_pixel(x as u32, y as u32).0.map(i32::from)
        };
        let (centre, wanted) = (self.truth.position(start), colour(start));
        let reach = leak.reach * self.size * strength.min(1.6);
        let near = |i: usize| {
            (self.truth.position(i) - centre).length() + 0.04 * self.size * self.outline[i] < reach
        };
        let similar = |i: usize| {
            colour(i)
                .iter()
                .zip(wanted)
                .all(|(a, b)| (a - b).abs() < leak.tolerance)
        };
        let mut queue = VecDeque::from([start]);
        let mut reached = vec![false; self.truth.on.len()];
        reached[start] = true;
        while let Some(i) = queue.pop_front() {
            if !near(i) {
                continue;
            }
            mask.on[i] = true;
            for n in mask.neighbours(i) {
                if !reached[n] && !self.truth.on[n] && similar(n) {
                    reached[n] = true;
                    queue.push_back(n);
                }
            }
        }
        // A segmenter's leak is a blob: what is nearly surrounded belongs to it.
        for _ in 0..2 {
            let before = mask.clone();
            for i in 0..mask.on.len() {
                mask.on[i] |=
                    before.neighbours(i).filter(|n| before.on[*n]).count() >= 3 && near(i);
            }
        }
    }
}

/// Coarse masks (0 or 255) of all views; `None` where the segmenter found nothing.
///
/// Scenes of fewer than twelve views lose at most one mask, of fewer than twenty have no half
/// mask: the mean would be out of reach otherwise.
pub(crate) fn coarse_masks(
    pictures: &[(&RgbImage, &GrayImage)],
    seed: u64,
) -> Vec<Option<GrayImage>> {
    let count = pictures.len();
    let mut rng = Rng::new(seed, 0xc0a5);
    // Special views in random order; the first view always has a mask.
    let mut order: Vec<usize> = (1..count).collect();
    for i in (1..order.len()).rev() {
        order.swap(i, rng.below(i + 1));
    }
    let missing = if count >= 12 {
        2
    } else {
        usize::from(count >= 6)
    };
    let bad = usize::from(count >= 20);
    let role = |view: usize| order.iter().position(|v| *v == view).unwrap_or(usize::MAX);
    let flaws: Vec<Option<Flaws<'_>>> = pictures
        .par_iter()
        .enumerate()
        .map(|(view, (photo, alpha))| {
            let mut rng = Rng::new(seed, 0xc0a5_0000 + view as u64);
            let direction = DVec2::new(rng.normal(), rng.normal()).normalize_or(DVec2::X);
            let half = (missing..missing + bad)
                .contains(&role(view))
                .then_some(direction);
            (role(view) >= missing).then(|| Flaws::draw(photo, alpha, half, &mut rng))
        })
        .collect();
    let at = |strength: f64| -> (f64, Vec<Option<Mask>>) {
        let made: Vec<(f64, Option<Mask>)> = flaws
            .par_iter()
            .map(|flaws| match flaws {
                Some(flaws) => {
                    let mask = flaws.apply(strength);
                    (mask.iou(&flaws.truth), Some(mask))
                }
                None => (0.0, None),
            })
            .collect();
        let mean = made.iter().map(|(iou, _)| iou).sum::<f64>() / count.max(1) as f64;
        (mean, made.into_iter().map(|(_, mask)| mask).collect())
    };
    let (mut weak, mut strong) = (0.0, 3.0);
    let mut best = at(weak);
    for _ in 0..10 {
        let strength = 0.5 * (weak + strong);
        let made = at(strength);
        if made.0 > MEAN_IOU {
            weak = strength;
        } else {
            strong = strength;
        }
        if (made.0 - MEAN_IOU).abs() < (best.0 - MEAN_IOU).abs() {
            best = made;
        }
    }
    best.1
        .into_iter()
        .map(|mask| mask.map(|mask| mask.to_image()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    fn disc(size: u32, hole: f64) -> GrayImage {
        GrayImage::from_fn(size, size, |x, y| {
            let d = (DVec2::new(f64::from(x), f64::from(y)) - f64::from(size) / 2.0).length();
            Luma([if d < f64::from(size) * 0.3 && d > hole {
                255
            } else {
                0
            }])
        })
    }

    #[test]
    fn strength_zero_is_the_truth() {
        let photo = RgbImage::new(40, 40);
        let alpha = disc(40, 5.0);
        let flaws = Flaws::draw(&photo, &alpha, None, &mut Rng::new(5, 5));
        assert_eq!(flaws.apply(0.0).iou(&flaws.truth), 1.0);
        assert!(flaws.apply(1.5).iou(&flaws.truth) < 0.95);
    }
}
