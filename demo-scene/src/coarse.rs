//! Coarse masks: the exact silhouettes, made wrong in the ways a single-view segmenter is wrong.
//!
//! Views fail independently: blobby outlines, all too wide or too narrow, a lost extremity, a
//! leak into a neighbour of similar colour, filled holes; two views have no mask and one has half
//! of the object. All flaws grow with one strength, which bisection sets so that the mean IoU,
//! a missing mask counting as 0, meets [`MEAN_IOU`].

use std::collections::VecDeque;

use glam::DVec2;
use image::{GrayImage, Luma, RgbImage};
use rayon::prelude::*;

use crate::noise::{Rng, fbm2};

/// The mean IoU aimed for.
const MEAN_IOU: f64 = 0.80;

/// A boolean picture.
#[derive(Clone)]
struct Mask {
    width: usize,
    height: usize,
    on: Vec<bool>,
}

impl Mask {
    fn from_alpha(alpha: &GrayImage) -> Self {
        Self {
            width: alpha.width() as usize,
            height: alpha.height() as usize,
            on: alpha.pixels().map(|p| p.0[0] >= 128).collect(),
        }
    }

    fn to_image(&self) -> GrayImage {
        GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            Luma([if self.on[y as usize * self.width + x as usize] { 255 } else { 0 }])
        })
    }

    fn position(&self, index: usize) -> DVec2 {
        DVec2::new((index % self.width) as f64, (index / self.width) as f64)
    }

    fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, y, width, height) = (index % self.width, index / self.width, self.width, self.height);
        [
            (x > 0).then(|| index - 1),
            (x + 1 < width).then(|| index + 1),
            (y > 0).then(|| index - width),
            (y + 1 < height).then(|| index + width),
        ]
        .into_iter()
        .flatten()
    }

    fn iou(&self, other: &Self) -> f64 {
        let (mut both, mut either) = (0_u32, 0_u32);
        for (a, b) in self.on.iter().zip(&other.on) {
            both += u32::from(*a && *b);
            either += u32::from(*a || *b);
        }
        f64::from(both) / f64::from(either.max(1))
    }

    /// Distance in pixels to the nearest pixel of the other kind, positive inside (two chamfer
    /// sweeps: right to a few per cent).
    fn signed_distance(&self) -> Vec<f64> {
        let far = (self.width + self.height) as f64;
        let sweep = |kind: bool| {
            let mut d: Vec<f64> = self.on.iter().map(|on| if *on == kind { far } else { 0.0 }).collect();
            let (w, h) = (self.width as isize, self.height as isize);
            let mut relax = |x: isize, y: isize, steps: [(isize, isize, f64); 4]| {
                let here = (y * w + x) as usize;
                for (dx, dy, cost) in steps {
                    let (nx, ny) = (x + dx, y + dy);
                    if nx >= 0 && ny >= 0 && nx < w && ny < h {
                        d[here] = d[here].min(d[(ny * w + nx) as usize] + cost);
                    }
                }
            };
            let diagonal = core::f64::consts::SQRT_2;
            for y in 0..h {
                for x in 0..w {
                    relax(x, y, [(-1, 0, 1.0), (0, -1, 1.0), (-1, -1, diagonal), (1, -1, diagonal)]);
                }
            }
            for y in (0..h).rev() {
                for x in (0..w).rev() {
                    relax(x, y, [(1, 0, 1.0), (0, 1, 1.0), (1, 1, diagonal), (-1, 1, diagonal)]);
                }
            }
            d
        };
        let (inside, outside) = (sweep(true), sweep(false));
        inside.iter().zip(&outside).map(|(i, o)| i - o).collect()
    }
}

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
        let size = (truth.on.iter().filter(|on| **on).count() as f64).sqrt().max(1.0);
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
        let loss = Loss { direction, share: rng.range(0.04, 0.13) };
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
        for (i, on) in mask.on.iter_mut().enumerate() {
            *on = self.distance[i] + unit * (0.017 * self.outline[i] + 0.017 * self.bias) > 0.0;
        }
        if let Some(loss) = &self.lost_end {
            self.lose(&mut mask, loss, strength);
        }
        for leak in &self.leaks {
            self.leak(&mut mask, leak, strength);
        }
        if self.fills_holes && strength > 0.0 {
            fill_holes(&mut mask);
        }
        if let Some(direction) = self.half {
            let along = |i: usize| self.truth.position(i).dot(direction) + 0.03 * self.size * self.outline[i];
            let cut = self.quantile(along, 0.52);
            for (i, on) in mask.on.iter_mut().enumerate() {
                *on &= along(i) > cut;
            }
        }
        mask
    }

    /// Value of `key` below which the given share of the silhouette lies.
    fn quantile(&self, key: impl Fn(usize) -> f64, share: f64) -> f64 {
        let mut values: Vec<f64> =
            (0..self.truth.on.len()).filter(|i| self.truth.on[*i]).map(key).collect();
        values.sort_by(f64::total_cmp);
        let index = (share.clamp(0.0, 1.0) * values.len() as f64) as usize;
        values.get(index.min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
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
        let key = |i: usize| (self.truth.position(i) - end).length() + 0.04 * self.size * self.outline[i];
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
            colour(i).iter().zip(wanted).all(|(a, b)| (a - b).abs() < leak.tolerance)
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
                mask.on[i] |= before.neighbours(i).filter(|n| before.on[*n]).count() >= 3 && near(i);
            }
        }
    }
}

/// Turns on everything that cannot be reached from the picture's border.
fn fill_holes(mask: &mut Mask) {
    let (w, h) = (mask.width, mask.height);
    let border = (0..mask.on.len()).filter(|i| i % w == 0 || i % w == w - 1 || *i < w || *i >= w * (h - 1));
    let mut queue: VecDeque<usize> = border.filter(|i| !mask.on[*i]).collect();
    let mut outside = vec![false; mask.on.len()];
    for i in &queue {
        outside[*i] = true;
    }
    while let Some(i) = queue.pop_front() {
        for n in mask.neighbours(i) {
            if !outside[n] && !mask.on[n] {
                outside[n] = true;
                queue.push_back(n);
            }
        }
    }
    for (on, outside) in mask.on.iter_mut().zip(outside) {
        *on = !outside;
    }
}

/// Coarse masks (0 or 255) of all views; `None` where the segmenter found nothing.
///
/// Scenes of fewer than twelve views lose at most one mask, of fewer than twenty have no half
/// mask: the mean would be out of reach otherwise.
pub(crate) fn coarse_masks(pictures: &[(&RgbImage, &GrayImage)], seed: u64) -> Vec<Option<GrayImage>> {
    let count = pictures.len();
    let mut rng = Rng::new(seed, 0xc0a5);
    // Special views in random order; the first view always has a mask.
    let mut order: Vec<usize> = (1..count).collect();
    for i in (1..order.len()).rev() {
        order.swap(i, rng.below(i + 1));
    }
    let missing = if count >= 12 { 2 } else { usize::from(count >= 6) };
    let bad = usize::from(count >= 20);
    let role = |view: usize| order.iter().position(|v| *v == view).unwrap_or(usize::MAX);
    let flaws: Vec<Option<Flaws<'_>>> = pictures
        .par_iter()
        .enumerate()
        .map(|(view, (photo, alpha))| {
            let mut rng = Rng::new(seed, 0xc0a5_0000 + view as u64);
            let direction = DVec2::new(rng.normal(), rng.normal()).normalize_or(DVec2::X);
            let half = (missing..missing + bad).contains(&role(view)).then_some(direction);
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
    best.1.into_iter().map(|mask| mask.map(|mask| mask.to_image())).collect()
}

/// Intersection over union of a mask with an alpha matte cut at one half; 0 without a mask.
pub(crate) fn iou(mask: Option<&GrayImage>, alpha: &GrayImage) -> f64 {
    mask.map_or(0.0, |mask| Mask::from_alpha(mask).iou(&Mask::from_alpha(alpha)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(size: u32, hole: f64) -> GrayImage {
        GrayImage::from_fn(size, size, |x, y| {
            let d = (DVec2::new(f64::from(x), f64::from(y)) - f64::from(size) / 2.0).length();
            Luma([if d < f64::from(size) * 0.3 && d > hole { 255 } else { 0 }])
        })
    }

    #[test]
    fn signed_distance_of_a_disc() {
        let mask = Mask::from_alpha(&disc(40, -1.0));
        let distance = mask.signed_distance();
        assert!((distance[20 * 40 + 20] - 12.0).abs() < 1.0);
        assert!((distance[20 * 40 + 39] + 7.0).abs() < 1.5);
    }

    #[test]
    fn holes_are_filled() {
        let mut mask = Mask::from_alpha(&disc(40, 5.0));
        fill_holes(&mut mask);
        assert!(mask.iou(&Mask::from_alpha(&disc(40, -1.0))) > 0.999);
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
