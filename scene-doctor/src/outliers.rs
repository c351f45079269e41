//! Photos that differ from those taken beside them: blurred, or of another exposure.
//!
//! What a photo shows matters more for its sharpness than how sharp it is, so each is compared with
//! the photos of nearly the same view. Where all are blurred, that says nothing: how much detail
//! another blur would take does.

use crate::directions::rounded;
use crate::finding::{Finding, median, percent, some_names};
use crate::photo::PhotoMeasures;
use crate::scene::Exam;

/// Photos that each one is compared with.
const NEIGHBOURS: usize = 6;
/// Blurred is what has less than this share of its neighbours' sharpness. Sharp photos of the scenes
/// this was tried on stay above 0.5; a blur of 2 pixels in 1000 comes to 0.3 at most.
const BLURRED: f64 = 0.4;
/// Photos are soft as a whole where a blur by a pixel of 640 leaves more than this of their detail.
/// Those of the scenes this was tried on keep 0.4 to 0.65, frames of a compressed video 0.83; with a
/// blur of 5 pixels in 1000 all keep more than 0.91.
const SOFT: f64 = 0.9;
/// Stops by which the light of a photo may differ from its neighbours'. On orbits through a room it
/// stays below 0.3.
const STOPS: f64 = 0.7;
/// Share of a photo that may be blown out, or black, beyond what is usual in the set.
const CLIPPED: f64 = 0.15;

/// The measures of a photo over those of its neighbours.
fn against_neighbours(exam: &Exam, of: impl Fn(&PhotoMeasures) -> f64) -> Vec<f64> {
    (0..exam.views.len())
        .map(|i| {
            let near = exam.neighbours(i, NEIGHBOURS).into_iter();
            let usual = median(near.map(|j| of(&exam.measures[j])));
            of(&exam.measures[i]) / usual.unwrap_or(f64::NAN)
        })
        .collect()
}

/// Photos that are less sharp than those beside them.
pub(crate) fn sharpness(exam: &Exam) -> Finding {
    let ratios = against_neighbours(exam, |measures| measures.sharpness);
    let mut blurred: Vec<(f64, &str)> = ratios
        .iter()
        .zip(&exam.views)
        .filter(|(ratio, _)| **ratio < BLURRED)
        .map(|(ratio, view)| (*ratio, view.name))
        .collect();
    blurred.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = ratios
        .iter()
        .copied()
        .filter(|r| r.is_finite())
        .fold(f64::INFINITY, f64::min);
    let usual = median(exam.measures.iter().map(|measures| measures.sharpness));
    let soft = median(exam.measures.iter().map(|measures| measures.softness)).unwrap_or(f64::NAN);
    let names: Vec<String> = blurred
        .iter()
        .map(|(ratio, name)| format!("{name} ({})", percent(*ratio)))
        .collect();
    let says = match names.len() {
        0 if soft > SOFT => format!(
            "the photos are soft as a whole: of their detail, {} would outlast a blur by one pixel \
             of 640, and of sharp photos' 40 to 85 %",
            percent(soft)
        ),
        0 => format!(
            "no photo is blurred beside its neighbours; the least sharp has {} of their sharpness",
            percent(if least.is_finite() { least } else { 1.0 })
        ),
        n => format!(
            "{n} of {} photos {} blurred, by their share of their neighbours' sharpness: {}",
            exam.views.len(),
            if n == 1 { "is" } else { "are" },
            some_names(&names)
        ),
    };
    let finding = Finding::pass("sharpness", says)
        .number("blurred", blurred.len())
        .number("least_ratio", rounded(least))
        .number("median_sharpness", rounded(usual.unwrap_or(f64::NAN)))
        .number("median_softness", rounded(soft))
        .about(blurred.iter().map(|(_, name)| *name));
    if blurred.is_empty() && soft > SOFT {
        finding.warn(
            "focus on the object, hold still or use more light; if they were enlarged or filtered, \
             take the originals: what no photo resolves, no result does",
        )
    } else if blurred.is_empty() {
        finding
    } else {
        finding.warn("leave them out, or take them again: their blur goes into the result")
    }
}

/// Photos that are lighter or darker than those beside them, or lose what is bright or dark.
pub(crate) fn exposure(exam: &Exam) -> Finding {
    let stops: Vec<f64> = against_neighbours(exam, |measures| measures.luminance.max(1e-6))
        .iter()
        .map(|ratio| ratio.log2())
        .collect();
    let usual = |of: fn(&PhotoMeasures) -> f64| median(exam.measures.iter().map(of)).unwrap_or(0.0);
    let (blown, black) = (usual(|m| m.blown), usual(|m| m.black));
    let luminance = usual(|m| m.luminance);
    let mut odd: Vec<(f64, String, &str)> = Vec::new();
    for ((view, measures), stops) in exam.views.iter().zip(&exam.measures).zip(&stops) {
        let more_blown = measures.blown - blown;
        let more_black = measures.black - black;
        if stops.abs() > STOPS {
            let way = if *stops > 0.0 { "lighter" } else { "darker" };
            let text = format!("{} ({:.1} stops {way})", view.name, stops.abs());
            odd.push((stops.abs(), text, view.name));
        } else if more_blown > CLIPPED {
            let text = format!("{} ({} blown out)", view.name, percent(measures.blown));
            odd.push((more_blown, text, view.name));
        } else if more_black > CLIPPED {
            let text = format!("{} ({} black)", view.name, percent(measures.black));
            odd.push((more_black, text, view.name));
        }
    }
    odd.sort_by(|a, b| b.0.total_cmp(&a.0));
    let widest = stops
        .iter()
        .copied()
        .filter(|s| s.is_finite())
        .map(f64::abs)
        .fold(0.0, f64::max);
    let names: Vec<String> = odd.iter().map(|(_, text, _)| text.clone()).collect();
    let says = match names.len() {
        0 => format!("photos differ from their neighbours by {widest:.1} stops at most"),
        n => format!(
            "{n} of {} photos {} out of line with those beside {}: {}",
            exam.views.len(),
            if n == 1 { "is" } else { "are" },
            if n == 1 { "it" } else { "them" },
            some_names(&names)
        ),
    };
    let finding = Finding::pass("exposure", says)
        .number("odd", odd.len())
        .number("widest_stops", rounded(widest))
        .number("median_luminance", rounded(luminance))
        .about(odd.iter().map(|(_, _, name)| *name));
    if odd.is_empty() {
        finding
    } else {
        finding.warn(
            "lock exposure and white balance while taking photos; leave out what differs: colours \
             are taken to be the same in all",
        )
    }
}
