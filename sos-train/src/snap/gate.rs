//! Which pieces of a change of outline the photo's edges bear out.

use image::RgbImage;

use super::edges::edge_strength;
use crate::cells::{around, neighbours};
use crate::mean::Mean;

/// How many times as much the photo has to change along the new outline as along the old.
const BETTER: f32 = 2.0;

/// What is inside when, of the pieces between the outlines of `old` and `new`, only those change sides that the photo
/// bears out. Lists are row-major.
pub(super) fn borne_out(photo: &RgbImage, old: &[bool], new: &[bool]) -> Vec<bool> {
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    // Pixels with one of the other side among their four neighbours.
    let on_outline = |sides: &[bool], i: usize| {
        let mut near = neighbours(i, width, sides.len()).flatten();
        near.any(|j| sides[j] != sides[i])
    };
    let strength = |i: usize| {
        let (x, y) = (i % width, i / width);
        let inner = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
        inner.then(|| edge_strength(photo, x as u32, y as u32))
    };
    let mut found = old.to_vec();
    // The number of the piece that a pixel belongs to, and of the one that looked at it last.
    let (mut piece_of, mut seen_by) = (vec![0u32; old.len()], vec![0u32; old.len()]);
    let mut number = 0;
    for first in 0..old.len() {
        if old[first] == new[first] || piece_of[first] > 0 {
            continue;
        }
        number += 1;
        let mut piece = vec![first];
        piece_of[first] = number;
        let mut next = 0;
        while let Some(&i) = piece.get(next) {
            next += 1;
            for j in around(i, width, old.len()) {
                if old[j] != new[j] && piece_of[j] == 0 {
                    piece_of[j] = number;
                    piece.push(j);
                }
            }
        }
        let (mut before, mut after) = (Mean::default(), Mean::default());
        for j in piece.iter().flat_map(|&i| around(i, width, old.len())) {
            if seen_by[j] == number {
                continue;
            }
            seen_by[j] = number;
            let Some(strength) = strength(j) else {
                continue;
            };
            match (on_outline(old, j), on_outline(new, j)) {
                (true, false) => before.add(strength),
                (false, true) => after.add(strength),
                _ => {}
            }
        }
        // A piece that comes or goes as a whole has one outline only: nothing to compare.
        let better = before.get(1).zip(after.get(1));
        if better.is_some_and(|(before, after)| after > BETTER * before) {
            for i in piece {
                found[i] = new[i];
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// 20 x 10 pixels, the left `columns` inside, on lower rows so many others.
    fn left(columns: usize, below: usize) -> Vec<bool> {
        (0..200)
            .map(|i| i % 20 < if i / 20 < 5 { columns } else { below })
            .collect()
    }

    #[test]
    fn pieces_that_lead_to_an_edge_move_and_others_stay() {
        let edge = RgbImage::from_fn(20, 10, |x, _| Rgb([if x < 10 { 200 } else { 60 }; 3]));
        // From beyond the edge to it.
        let (beyond, at) = (left(13, 13), left(10, 10));
        assert_eq!(borne_out(&edge, &beyond, &at), at);
        // Away from it, and along nothing at all.
        assert_eq!(borne_out(&edge, &at, &beyond), at);
        let plain = RgbImage::from_pixel(20, 10, Rgb([90; 3]));
        assert_eq!(borne_out(&plain, &beyond, &at), beyond);
        // Two pieces, of which one leads to the edge.
        let mut away = left(10, 7);
        away[5 * 20 + 7..5 * 20 + 10].fill(true);
        assert_eq!(borne_out(&edge, &left(13, 10), &away), at);
    }

    #[test]
    fn a_piece_that_goes_as_a_whole_is_left_alone() {
        let edge = RgbImage::from_fn(20, 10, |x, _| Rgb([if x < 10 { 200 } else { 60 }; 3]));
        let mut speck = left(5, 5);
        speck[3 * 20 + 15] = true;
        assert_eq!(borne_out(&edge, &speck, &left(5, 5)), speck);
    }
}
