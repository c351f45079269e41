//! Zones of a photo that are of one colour: a black room, an overexposed table, a clear sky.

use crate::cells::{around, pieces};
use crate::prepare::TrainView;
use crate::squares::Squares;

/// Squares along a photo's longer side: noise averages out in them.
const LONGEST: u32 = 400;
/// Squares of a zone differ from those around them by no more than this in any channel, of 255.
const FLAT: u8 = 5;
/// The least share of the picture that a zone has.
const SMALLEST: f32 = 0.003;

/// The squares of a view's photo that zones are made of.
pub(crate) fn squares(view: &TrainView) -> Squares {
    Squares::new(view.width(), view.height(), LONGEST)
}

/// The mean colours of a view's `squares`, row by row.
pub(crate) fn colours(view: &TrainView, squares: &Squares) -> Vec<[u8; 3]> {
    (0..squares.rows)
        .flat_map(|y| (0..squares.columns).map(move |x| (x, y)))
        .map(|(x, y)| squares.colour(&view.photo, x, y).0)
        .collect()
}

/// The zones of a picture whose squares have these `colours`, row by row with so many `columns`: each as the numbers of its squares.
pub(crate) fn flat_zones(colours: &[[u8; 3]], columns: usize) -> Vec<Vec<usize>> {
    let len = colours.len();
    let alike = |a: usize, b: usize| {
        let channels = colours[a].iter().zip(&colours[b]);
        channels.into_iter().all(|(a, b)| a.abs_diff(*b) <= FLAT)
    };
    let flat = |i: usize| around(i, columns, len).all(|j| alike(i, j));
    // Flat squares beside each other are alike.
    let mut zones = pieces(len, columns, flat, |_, _| true);
    zones.retain(|zone| zone.len() as f32 >= SMALLEST * len as f32);
    zones
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zone_is_large_and_of_one_colour() {
        let columns = 40;
        let colour = |i: usize| match (i % columns, i / columns) {
            (0..20, _) => [200; 3],
            // Texture, and in it a flat place of a few squares.
            (28..34, 8..14) => [90; 3],
            (x, y) => [(x * 37 + y * 91) as u8; 3],
        };
        let colours: Vec<[u8; 3]> = (0..columns * 30).map(colour).collect();
        let zones = flat_zones(&colours, columns);
        assert_eq!(
            zones.iter().map(Vec::len).collect::<Vec<_>>(),
            [19 * 30, 16]
        );
        assert!(flat_zones(&[], 0).is_empty());
    }
}
