//! Whether a mask's outline lies where its photo has edges.
//!
//! The outline of an exact mask is where the photo changes, two to five times as much as a few pixels
//! beside it. That of a blob around the object, or of a mask that is too small or too large, is anywhere.

use image::imageops::thumbnail;

use super::view::TrainView;
use crate::distance::signed_distance;
use crate::mean::Mean;
use crate::snap::{LONGEST, edge_strength};

/// Pixels from the outline that are on it, and those that are beside it.
const ON: f32 = 1.0;
const BESIDE: std::ops::Range<f32> = 3.0..9.0;
/// Pixels on the outline below which nothing is known.
const FEWEST: usize = 50;

/// How many times as strong the photo's edges are along its mask's outline as beside it; `None` without a
/// mask, or where there is too little outline.
#[must_use]
pub fn edge_contrast(view: &TrainView) -> Option<f32> {
    let mask = view.mask.as_ref()?.picture();
    let factor = view.width().max(view.height()).div_ceil(LONGEST);
    let (width, height) = (view.width() / factor, view.height() / factor);
    if width < 3 || height < 3 {
        return None;
    }
    let (photo, mask) = (
        thumbnail(&view.photo, width, height),
        thumbnail(&mask, width, height),
    );
    let inside: Vec<bool> = mask.pixels().map(|pixel| pixel.0[0] >= 128).collect();
    let shape = [width as usize, height as usize];
    let distances = signed_distance(&inside, &shape, BESIDE.end as usize + 1);
    let (mut on, mut beside) = (Mean::default(), Mean::default());
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let distance = distances[(y * width + x) as usize].abs();
            let mean = if distance < ON {
                &mut on
            } else if BESIDE.contains(&distance) {
                &mut beside
            } else {
                continue;
            };
            if !view.ignores(x * factor, y * factor) {
                mean.add(edge_strength(&photo, x, y));
            }
        }
    }
    let (on, beside) = (on.get(FEWEST)?, beside.get(FEWEST)?);
    (beside > 0.0).then_some(on / beside)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::prepare::disc;

    /// A disc of radius 40, and a mask of another kind.
    fn view(mask: impl Fn(f32, f32) -> bool) -> TrainView {
        let view = disc::view(160, 120, 40.0);
        let picture = disc::picture(160, 120, mask);
        view.with_mask(&picture).unwrap()
    }

    #[test]
    fn an_exact_outline_lies_on_edges_and_others_do_not() {
        let exact = edge_contrast(&view(|u, v| u.hypot(v) < 40.0)).unwrap();
        assert!(exact > 3.0, "{exact}");
        for radius in [34.0, 46.0] {
            let off = edge_contrast(&view(|u, v| u.hypot(v) < radius)).unwrap();
            assert!(off < 1.0, "{radius}: {off}");
        }
        // Rough as a blob is.
        let blob = |u: f32, v: f32| u.hypot(v) < 40.0 + 5.0 * (5.0 * v.atan2(u)).sin();
        let blob = edge_contrast(&view(blob)).unwrap();
        assert!(blob < 2.0, "{blob}");
    }

    #[test]
    fn nothing_is_said_without_an_outline() {
        assert_eq!(edge_contrast(&view(|_, _| false)), None);
        assert_eq!(edge_contrast(&view(|_, _| true)), None);
        let bare = TrainView {
            mask: None,
            ..view(|_, _| true)
        };
        assert_eq!(edge_contrast(&bare), None);
    }
}
