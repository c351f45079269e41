//! What every pixel is taken for at the start: object, background, or not to be relied on.

use glam::Vec2;
use image::GrayImage;
use neus_render::intersect::{Aabb, ray_box};
use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use super::frame::Frame;
use super::label::{
    AGREED_OBJECT, ALIKE_MASKED, ALIKE_OBJECT, Label, SILENT, Shown, Vote, edge_byte, edge_vote,
};
use super::mask_edge::{near_edge, vote_weights};
use super::runs::ByteRuns;
use super::spans::PixelSpans;
use super::view::TrainView;
use super::votes::ViewTrust;
use crate::config::PrepareConfig;
use crate::median::median;

/// The labels of one view, and the pixels where the object can be.
#[derive(Clone, Debug)]
pub struct Outline {
    width: u32,
    height: u32,
    /// Whether the view has a mask that is believed.
    masked: bool,
    labels: ByteRuns,
    /// Pixels whose ray meets space that may hold the object.
    pub candidates: PixelSpans,
    /// Pixels that show the object [by its colours](Self::mark_alike).
    pub alike: PixelSpans,
}

impl Outline {
    /// Bytes that take room in memory for good.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        self.labels.in_memory()
    }

    /// Takes the vote from `pixels`: what the mask says there is not believed.
    pub fn silence(&mut self, pixels: &PixelSpans) {
        self.relabel(pixels, |_| SILENT);
    }

    fn relabel(&mut self, pixels: &PixelSpans, of: impl Fn(u8) -> u8) {
        if pixels.is_empty() {
            return;
        }
        let all = 0..self.width * self.height;
        let mut labels: Vec<u8> = all.map(|i| self.labels.get(i)).collect();
        for i in pixels.iter() {
            if let Some(label) = labels.get_mut(i as usize) {
                *label = of(*label);
            }
        }
        self.labels = ByteRuns::of(&labels);
    }

    /// The label of a pixel.
    #[must_use]
    pub fn label(&self, x: u32, y: u32) -> Label {
        Label::from_byte(self.labels.get(y * self.width + x))
    }

    /// Whether a pixel is the object's for all that is known but the photo: the others say so, and the view's mask, if it is
    /// believed.
    #[must_use]
    pub fn is_expected(&self, x: u32, y: u32) -> bool {
        match self.label(x, y) {
            Label::Object => self.masked,
            Label::DoubtfulObject => !self.masked,
            _ => false,
        }
    }

    /// Marks pixels that have the object's colours, of those where it is [expected](Self::is_expected).
    pub fn mark_alike(&mut self, pixels: &PixelSpans) {
        let mut shown = PixelSpans::default();
        let expected = |i: &u32| self.is_expected(i % self.width, i / self.width);
        pixels.iter().filter(expected).for_each(|i| shown.push(i));
        let alike = match self.masked {
            true => ALIKE_MASKED,
            false => ALIKE_OBJECT,
        };
        self.relabel(&shown, |_| alike);
        self.alike = self.alike.united(&shown);
    }

    /// What says that the object is to be seen on a pixel.
    #[must_use]
    pub fn shown(&self, x: u32, y: u32) -> Shown {
        let inside = |vote: Vote| vote.object && vote.weight == 1.0;
        match self.labels.get(y * self.width + x) {
            ALIKE_OBJECT | ALIKE_MASKED => Shown::ByColour,
            AGREED_OBJECT => Shown::ByMask,
            _ if self.vote(x, y).is_some_and(inside) => Shown::ByMask,
            _ => Shown::No,
        }
    }

    /// What the view's own mask says at a pixel; `None` without one that is believed there.
    #[must_use]
    pub fn vote(&self, x: u32, y: u32) -> Option<Vote> {
        let byte = self.labels.get(y * self.width + x);
        (self.masked && byte != SILENT).then(|| {
            edge_vote(byte).unwrap_or(Vote {
                object: Label::from_byte(byte).target().0 > 0.5,
                weight: 1.0,
            })
        })
    }
}

/// Added to the label of a candidate while labels are found.
const CANDIDATE: u8 = 128;

/// The largest m^P on each pixel's ray, 8 bit, at a `1 / stride` of the photo's size.
#[must_use]
pub fn silhouette(view: &TrainView, frame: &Frame, map: &ProbabilityMap, stride: u32) -> GrayImage {
    let world_from_camera = view.world_from_camera(frame);
    let (w, h) = (
        view.width().div_ceil(stride),
        view.height().div_ceil(stride),
    );
    let unit = Aabb::UNIT;
    let rows: Vec<u8> = (0..w * h)
        .into_par_iter()
        .map(|i| {
            let pixel = Vec2::new((i % w) as f32 + 0.5, (i / w) as f32 + 0.5) * stride as f32;
            let Some(ray) = view.ray(&world_from_camera, pixel) else {
                return 0;
            };
            let Some(span) = ray_box(&ray, &unit) else {
                return 0;
            };
            let best = map.max_along(ray.origin, ray.direction, (span.near, span.far), 0.995);
            (255.0 * best + 0.5) as u8
        })
        .collect();
    GrayImage::from_raw(w, h, rows).unwrap_or_default()
}

/// Pixels whose ray meets space that m^P gives to the object.
#[must_use]
pub fn candidates(
    view: &TrainView,
    frame: &Frame,
    map: &ProbabilityMap,
    config: &PrepareConfig,
) -> PixelSpans {
    const STRIDE: u32 = 2;
    let silhouette = silhouette(view, frame, map, STRIDE);
    let may_show = |i: u32| {
        let at = |v: u32| (v as f32 + 0.5) / STRIDE as f32;
        let (x, y) = (at(i % view.width()), at(i / view.width()));
        bilinear(&silhouette, x, y) >= config.hull_threshold
    };
    let pixels = (0..view.width() * view.height()).into_par_iter();
    let marked: Vec<bool> = pixels.map(may_show).collect();
    let mut candidates = PixelSpans::default();
    for (i, _) in (0..).zip(&marked).filter(|(_, marked)| **marked) {
        candidates.push(i);
    }
    candidates
}

/// How far each mask is believed: by its overlap with what the others say, relative to the median, which comes with it.
#[must_use]
pub fn trust_masks(
    views: &[TrainView],
    silhouettes: &[GrayImage],
    stride: u32,
    threshold: f32,
) -> (ViewTrust, f32) {
    let limit = (255.0 * threshold) as u8;
    // Pixels of both, and of either.
    let overlaps: Vec<Option<(u32, u32)>> = views
        .par_iter()
        .zip(silhouettes)
        .map(|(view, silhouette)| {
            let mask = view.mask.as_ref()?;
            let (mut both, mut either) = (0u32, 0u32);
            for (x, y, value) in silhouette.enumerate_pixels() {
                let mx = (x * stride + stride / 2).min(mask.width() - 1);
                let my = (y * stride + stride / 2).min(mask.height() - 1);
                if view.ignores(mx, my) {
                    continue;
                }
                let own = mask.contains(mx, my);
                let others = value.0[0] >= limit;
                both += u32::from(own && others);
                either += u32::from(own || others);
            }
            Some((both, either))
        })
        .collect();
    let shown = overlaps.iter().flatten().filter(|(_, either)| *either > 0);
    let mut known: Vec<f32> = shown
        .map(|(both, either)| *both as f32 / *either as f32)
        .collect();
    let middle = median(&mut known).unwrap_or(1.0).max(1e-3);
    let trust = overlaps
        .iter()
        .map(|overlap| match overlap {
            // Where all say that the object is not in the picture, nobody is contradicted.
            Some((_, 0)) => 1.0,
            Some((both, either)) => {
                let overlap = *both as f32 / *either as f32;
                ((overlap / middle - 0.5) / 0.3).clamp(0.0, 1.0)
            }
            None => 0.0,
        })
        .collect();
    (ViewTrust(trust), middle)
}

/// Labels of one view. `band` is half the width of the distrusted band along the own mask's edge.
#[must_use]
pub fn outline(
    view: &TrainView,
    silhouette: &GrayImage,
    stride: u32,
    trust: f32,
    band: u32,
    config: &PrepareConfig,
) -> Outline {
    let (width, height) = (view.width(), view.height());
    let mask = view.mask.as_ref().filter(|_| trust >= 0.5);
    let aside = view.mask.as_ref().filter(|_| trust < 0.5);
    let edge = mask.or(aside).map(|mask| near_edge(mask, band));
    let near_edge = |i: usize| edge.as_ref().is_some_and(|edge| edge[i]);
    let weights = mask
        .map(|mask| vote_weights(mask, band))
        .unwrap_or_default();
    let label = |x: u32, y: u32| {
        let i = (y * width + x) as usize;
        let hull = bilinear(
            silhouette,
            (x as f32 + 0.5) / stride as f32,
            (y as f32 + 0.5) / stride as f32,
        );
        if view.ignores(x, y) {
            return SILENT;
        }
        if hull < config.hull_threshold {
            return Label::Background as u8;
        }
        let likely = hull >= config.object_threshold;
        let label = match mask {
            Some(_) if near_edge(i) => Label::Unknown,
            Some(mask) => match (mask.contains(x, y), likely) {
                (true, true) => Label::Object,
                (true, false) => Label::DoubtfulObject,
                (false, true) => Label::DoubtfulBackground,
                (false, false) => Label::Background,
            },
            None if hull >= config.crop_threshold => Label::DoubtfulObject,
            None => Label::Unknown,
        };
        let own = mask.is_some_and(|mask| mask.contains(x, y));
        let agreed = likely && !near_edge(i) && aside.is_some_and(|mask| mask.contains(x, y));
        let byte = match label {
            Label::DoubtfulObject if agreed => AGREED_OBJECT,
            Label::Unknown if mask.is_some() => edge_byte(own, weights[i]),
            label => label as u8,
        };
        byte | CANDIDATE
    };
    let pixels = (0..width * height).into_par_iter();
    let mut labels: Vec<u8> = pixels.map(|i| label(i % width, i / width)).collect();
    let mut candidates = PixelSpans::default();
    for (i, label) in (0..).zip(&mut labels) {
        if *label & CANDIDATE != 0 {
            candidates.push(i);
            *label &= !CANDIDATE;
        }
    }
    Outline {
        width,
        height,
        masked: mask.is_some(),
        labels: ByteRuns::of(&labels),
        candidates,
        alike: PixelSpans::default(),
    }
}

/// Value in `[0, 1]` at a position in pixels, between pixel centres.
pub(crate) fn bilinear(image: &GrayImage, x: f32, y: f32) -> f32 {
    let clamp = |v: i64, n: u32| v.clamp(0, i64::from(n) - 1) as u32;
    let (fx, fy) = (x - 0.5, y - 0.5);
    let (x0, y0) = (fx.floor() as i64, fy.floor() as i64);
    let (tx, ty) = (fx - fx.floor(), fy - fy.floor());
    let at = |dx: i64, dy: i64| {
        let p = image.get_pixel(
            clamp(x0 + dx, image.width()),
            clamp(y0 + dy, image.height()),
        );
        f32::from(p.0[0]) / 255.0
    };
    let top = at(0, 0) + tx * (at(1, 0) - at(0, 0));
    let bottom = at(0, 1) + tx * (at(1, 1) - at(0, 1));
    top + ty * (bottom - top)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::DVec3;
    use image::Luma;

    use super::super::balls::{view, with_balls};
    use super::*;
    use crate::config::TrainConfig;

    #[test]
    fn silent_pixels_have_no_vote_and_others_keep_theirs() {
        let object = Label::Object as u8;
        let edge = |weight| edge_byte(true, weight);
        let mut outline = Outline {
            width: 3,
            height: 2,
            masked: true,
            labels: ByteRuns::of(&[0, object, object, edge(1.0), edge(0.26), object]),
            candidates: PixelSpans::default(),
            alike: PixelSpans::default(),
        };
        let votes = |outline: &Outline| {
            let weight = |i: u32| outline.vote(i % 3, i / 3).map(|vote| vote.weight);
            (0..6).map(weight).collect::<Vec<_>>()
        };
        let edge = Some(0.25);
        let full = Some(1.0);
        assert_eq!(votes(&outline), [full, full, full, full, edge, full]);
        let mut opening = PixelSpans::default();
        opening.push(2);
        opening.push(3);
        outline.silence(&opening);
        assert_eq!(votes(&outline), [full, full, None, None, edge, full]);
        assert_eq!(outline.label(2, 0), Label::Unknown);
        assert_eq!(outline.label(2, 1), Label::Object);
    }

    #[test]
    fn along_outlines_masks_vote_for_either_side_and_never_with_nothing() {
        for object in [false, true] {
            for (weight, counts) in [(0.0, 0.125), (0.5, 0.5), (1.0, 1.0)] {
                let byte = edge_byte(object, weight);
                let expected = Vote {
                    object,
                    weight: counts,
                };
                assert_eq!(edge_vote(byte), Some(expected));
                assert!(byte < CANDIDATE && Label::from_byte(byte) == Label::Unknown);
            }
        }
        assert_eq!(edge_vote(ALIKE_MASKED), None);
    }

    #[test]
    fn a_mask_that_is_set_aside_shows_what_the_others_say_as_well() {
        // A ball of 13 pixels' radius in the middle of the picture; all others have it left of the middle.
        let ball = (DVec3::ZERO, 2.0);
        let view = with_balls(view(DVec3::NEG_Z * 9.0, DVec3::Z), &[ball]);
        let others = GrayImage::from_fn(64, 48, |x, _| Luma([255 * u8::from(x < 32)]));
        let config = TrainConfig::default().prepare;
        let of = |trust: f32| outline(&view, &others, 1, trust, 3, &config);
        let (aside, believed) = (of(0.4), of(0.6));
        let shown = |outline: &Outline| [5, 26, 38, 60].map(|x| outline.shown(x, 24));
        let (no, by_mask) = (Shown::No, Shown::ByMask);
        assert_eq!(shown(&aside), [no, by_mask, no, no]);
        // Nothing votes, and the label is that of a view without a mask.
        assert_eq!(aside.vote(26, 24), None);
        assert_eq!(aside.label(26, 24), Label::DoubtfulObject);
        assert_eq!(aside.label(5, 24), Label::DoubtfulObject);
        // On the mask's outline nothing is shown.
        assert_eq!([&aside, &believed].map(|of| of.shown(20, 24)), [no, no]);
        assert_eq!(believed.shown(26, 24), by_mask);
        // Nor where a mask says background, whatever the others say.
        assert_eq!(believed.shown(5, 24), no);
        assert!(believed.vote(26, 24).is_some());

        // Colours say more, but not of what the others have elsewhere.
        let mut alike = PixelSpans::default();
        for x in [5, 26, 38] {
            alike.push(24 * 64 + x);
        }
        let mut coloured = aside.clone();
        coloured.mark_alike(&alike);
        assert!(!coloured.alike.is_empty() && coloured.alike.len() < alike.len());
        let by_colour = Shown::ByColour;
        assert_eq!(shown(&coloured), [by_colour, by_colour, no, no]);
        assert_eq!(coloured.label(26, 24), Label::DoubtfulObject);
    }
}
