//! Rough masks: whether they are there, mean what they should, and agree with one another.

use crate::directions::rounded;
use crate::finding::{Finding, median, percent, some_names};
use crate::scene::{Exam, ObjectMask};
use image::GrayImage;

/// Shares of white below and above which a mask shows nothing.
const EMPTY: f64 = 5e-4;
const FULL: f64 = 0.98;
/// The share of the picture's border that the object may touch without leaving it.
const TOUCHES: f64 = 0.02;
/// Below this median overlap the masks do not show one rigid thing.
const AGREE: f64 = 0.35;
/// Trust below which training sets a mask aside.
const TRUSTED: f32 = 0.5;
/// Overlap of the inverse of a mask that is white along the border with what the others say, from which
/// on it is the inverse that is meant.
const INVERTED: f64 = 0.5;

/// The masks of a scene, as far as they could be used.
#[derive(Debug, Clone)]
pub enum Masks {
    /// There are none.
    None {
        /// Where some lie that were not asked for: a sentence.
        offered: Option<String>,
    },
    /// There are some, and training refuses them.
    Refused {
        /// What is wrong, with the file.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// They are those of the views.
    Found {
        /// Which colour is the object and why: a sentence without a full stop.
        polarity: String,
        /// What all of them together say; none where they do not determine a place.
        consensus: Option<Consensus>,
    },
}

/// What all masks together take for the object, view by view.
#[derive(Debug, Clone)]
pub struct Consensus {
    /// For each view, at a part of its size; from `limit` on, the masks agree that it is the object.
    pub silhouettes: Vec<GrayImage>,
    /// From which value on.
    pub limit: u8,
    /// How far training believes each view's own mask, 0..1.
    pub trust: Vec<f32>,
}

/// Shares of white of one mask: everywhere, and along the border.
fn shares(mask: &dyn ObjectMask, (w, h): (u32, u32)) -> (f64, f64) {
    let (mut all, mut border, mut edge) = (0u64, 0u64, 0u64);
    for y in 0..h {
        for x in 0..w {
            let white = u64::from(mask.is_object(x, y));
            let outer = x == 0 || y == 0 || x + 1 == w || y + 1 == h;
            all += white;
            border += white * u64::from(outer);
            edge += u64::from(outer);
        }
    }
    let share = |n: u64, of: u64| n as f64 / of.max(1) as f64;
    (share(all, u64::from(w) * u64::from(h)), share(border, edge))
}

/// How many masks there are, and whether they look like masks of an object.
pub(crate) fn masks(exam: &Exam, masks: &Masks) -> Finding {
    let polarity = match masks {
        Masks::None { offered } => {
            let mut says = "none: the object will be looked for".to_owned();
            if let Some(offered) = offered {
                says.push_str(&format!(" ({offered})"));
            }
            return Finding::pass("masks", says).number("masks", 0);
        }
        Masks::Refused { what, remedy } => {
            return Finding::pass("masks", what.clone()).fail(remedy.clone());
        }
        Masks::Found { polarity, .. } => polarity,
    };
    let (mut empty, mut full, mut cut) = (Vec::new(), Vec::new(), Vec::new());
    let (mut areas, mut mostly_border, mut missing) = (Vec::new(), 0, Vec::new());
    for view in &exam.views {
        let name = view.name.to_owned();
        let Some(mask) = view.mask else {
            missing.push(name);
            continue;
        };
        let (all, border) = shares(mask, view.size());
        areas.push(all);
        if all < EMPTY {
            empty.push(name);
        } else if all > FULL {
            full.push(name);
        } else if border > TOUCHES {
            cut.push(name);
        }
        mostly_border += usize::from(border > 0.5 && border > all);
    }
    let (count, all) = (areas.len(), exam.views.len());
    let area = median(areas).unwrap_or(0.0);
    let mut says = format!("{count} of {all} photos have a mask");
    if !missing.is_empty() && count > 0 {
        says.push_str(&format!(" (not {})", some_names(&missing)));
    }
    says.push_str(&format!(
        ", {polarity}; the object fills {} of a picture",
        percent(area)
    ));
    let mut odd = |names: &[String], what: &str| {
        if !names.is_empty() {
            says.push_str(&format!("; {} {what} ({})", names.len(), some_names(names)));
        }
    };
    odd(&empty, "empty");
    odd(&full, "white all over");
    odd(&cut, "cut off by the picture's border");
    let finding = |says| {
        Finding::pass("masks", says)
            .number("masks", count)
            .number("without", missing.len())
            .number("empty", empty.len())
            .number("full", full.len())
            .number("at_border", cut.len())
            .number("median_area", rounded(area))
            .about(empty.iter().chain(&full).cloned())
    };
    if 2 * mostly_border > count {
        let says = format!("{says}; {mostly_border} are white along the border, as if inverted");
        finding(says)
            .warn("look at one: if black is the object there, say so with --polarity black")
    } else if !empty.is_empty() || !full.is_empty() {
        finding(says).warn(
            "delete masks that say nothing where the object is to be seen: a photo without a mask is \
             fine, one with a wrong mask costs",
        )
    } else {
        finding(says)
    }
}

/// Whether the masks show the same thing. `None` where there are too few to tell.
pub(crate) fn agreement(exam: &Exam, masks: &Masks) -> Option<Finding> {
    let Masks::Found {
        consensus: Some(consensus),
        ..
    } = masks
    else {
        return None;
    };
    let (mut overlaps, mut aside, mut inverted) = (Vec::new(), Vec::new(), Vec::new());
    for (i, view) in exam.views.iter().enumerate() {
        let Some((mask, silhouette)) = view.mask.zip(consensus.silhouettes.get(i)) else {
            continue;
        };
        let [own, inverse] = overlap(mask, view.size(), silhouette, consensus.limit);
        overlaps.push(own);
        let believed = consensus.trust.get(i).is_none_or(|trust| *trust >= TRUSTED);
        if !believed {
            let (_, border) = shares(mask, view.size());
            if inverse > INVERTED && inverse > 2.0 * own && border > 0.5 {
                inverted.push(view.name.to_owned());
            }
            aside.push((own, view.name.to_owned()));
        }
    }
    let count = overlaps.len();
    let usual = median(overlaps)?;
    aside.sort_by(|a, b| a.0.total_cmp(&b.0));
    let aside: Vec<String> = aside.into_iter().map(|(_, name)| name).collect();
    let mut says = format!(
        "each overlaps by {} with what all of them roughly agree on (median)",
        percent(usual)
    );
    match aside.len() {
        0 => says.push_str("; none contradicts the others"),
        n => says.push_str(&format!(
            "; {n} of {count} contradict{} the others and will be set aside: {}",
            if n == 1 { "s" } else { "" },
            some_names(&aside)
        )),
    }
    if !inverted.is_empty() {
        says.push_str(&format!("; inverted: {}", some_names(&inverted)));
    }
    let finding = Finding::pass("agreement", says)
        .number("median_iou", rounded(usual))
        .number("set_aside", aside.len())
        .number("inverted", inverted.len())
        .about(aside.iter().cloned());
    Some(if usual < AGREE {
        finding.warn(
            "they hardly show one thing: check that masks and photos belong together, that it did \
             not move, and that the poses are right",
        )
    } else if !inverted.is_empty() {
        finding.warn("invert or delete the inverted ones; what is set aside does no harm")
    } else if !aside.is_empty() {
        finding.warn("look at them: training goes on without them, correct ones would help")
    } else {
        finding
    })
}

/// Intersection over union of a mask, and of its inverse, with what the others agree on.
fn overlap(mask: &dyn ObjectMask, size: (u32, u32), silhouette: &GrayImage, limit: u8) -> [f64; 2] {
    let (w, h) = silhouette.dimensions();
    let mut counts = [[0u32; 2]; 2];
    for (x, y, value) in silhouette.enumerate_pixels() {
        let at = |v: u32, n: u32, size: u32| {
            (((f64::from(v) + 0.5) / f64::from(n) * f64::from(size)) as u32).min(size - 1)
        };
        let own = mask.is_object(at(x, w, size.0), at(y, h, size.1));
        counts[usize::from(own)][usize::from(value.0[0] >= limit)] += 1;
    }
    let [[neither, others], [own, both]] = counts.map(|pair| pair.map(f64::from));
    let ratio = |part: f64, whole: f64| part / whole.max(1.0);
    [
        ratio(both, own + others + both),
        ratio(others, neither + others + both),
    ]
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    fn square(low: u32, high: u32) -> GrayImage {
        GrayImage::from_fn(40, 40, |x, y| {
            let inside = (low..high).contains(&x) && (low..high).contains(&y);
            Luma([if inside { 255 } else { 0 }])
        })
    }

    #[test]
    fn overlap_knows_inverted_masks() {
        let silhouette = image::imageops::thumbnail(&square(8, 32), 10, 10);
        let [own, inverse] = overlap(&square(8, 32), (40, 40), &silhouette, 128);
        assert!(own > 0.99 && inverse < 0.01, "{own} {inverse}");
        let mut other = square(8, 32);
        other.iter_mut().for_each(|v| *v = 255 - *v);
        let [own, inverse] = overlap(&other, (40, 40), &silhouette, 128);
        assert!(own < 0.01 && inverse > 0.99, "{own} {inverse}");
        let nothing = GrayImage::new(4, 4);
        assert_eq!(
            overlap(&GrayImage::new(4, 4), (4, 4), &nothing, 128),
            [0.0, 0.0]
        );
    }

    #[test]
    fn shares_count_the_border_apart() {
        assert_eq!(shares(&square(0, 40), (40, 40)), (1.0, 1.0));
        let (all, border) = shares(&square(0, 20), (40, 40));
        assert!((all - 0.25).abs() < 1e-9 && (border - 39.0 / 156.0).abs() < 1e-9);
    }
}
