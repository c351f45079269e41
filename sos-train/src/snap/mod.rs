//! Moves an object's outline to where its photo shows it.
//!
//! Geometry ends where light stops coming from a surface: along contact with the ground, or where all rough masks take in
//! the same rim, it cannot tell. The photo often can. Where the outline is a few pixels off, colours close by say what
//! those pixels are, and the photo changes far more along the right outline than along the wrong one. So, within a narrow
//! band around the outline:
//!
//! 1. each pixel is held against colours that are surely inside and surely outside, close by ([`colours`]; the local
//!    classifiers of Bai et al. 2009, Video SnapCut, without their shape model);
//! 2. neighbours of the same colour come to agree, and without evidence the outline stays ([`relax`], mean field of a
//!    Potts model whose edges follow contrast, as in GrabCut, Rother et al. 2004);
//! 3. of what would move, only pieces are kept along whose new outline the photo changes at least twice as much as along
//!    the old one ([`gate`]).
//!
//! The last rule is what makes it safe: on textured ground or in shade pieces are refused, and all stays as it was.

mod colours;
mod edges;
mod gate;
mod relax;

use image::RgbImage;

pub(crate) use edges::edge_strength;

use crate::distance::signed_distance;

/// Photos are best looked at with no more pixels than so many along their longer side: larger ones are soft, and the time
/// grows with the fourth power.
pub(crate) const LONGEST: u32 = 1000;
/// Rounds, each from the outline that the last one came to.
const ROUNDS: usize = 3;
/// Half the width of the band in which the outline may move in a round, as a share of the picture's diagonal.
const BAND: f32 = 0.01;
/// Pixels farther from the outline than this share of the band are surely on their side, up to so many bands away.
const SURE: f32 = 0.5;
const FAR: f32 = 3.0;
/// What staying where it is is worth, in log odds at the band's end.
const PRIOR: f32 = 4.0;

/// How far the outline may move in a round, in pixels of a picture of this size.
pub(crate) fn band(width: u32, height: u32) -> f32 {
    BAND * (width as f32).hypot(height as f32)
}

/// How far from the outline pixels matter, in pixels.
pub(crate) fn surroundings(band: f32) -> u32 {
    ((ROUNDS as f32 + FAR + 2.0 * colours::CELL) * band).ceil() as u32
}

/// What is inside by the photo, where it is `inside` as far as is known and pixels are `usable`; lists are row-major. `band`
/// is how far the outline may move in a round, in pixels ([`band`]).
///
/// # Panics
/// When the lists are not as long as the photo has pixels.
#[must_use]
pub(crate) fn snap(photo: &RgbImage, inside: &[bool], usable: &[bool], band: f32) -> Vec<bool> {
    let pixels = photo.width() as usize * photo.height() as usize;
    assert_eq!(inside.len(), pixels, "pixels inside");
    assert_eq!(usable.len(), pixels, "usable pixels");
    let shape = [photo.width() as usize, photo.height() as usize];
    let mut found = inside.to_vec();
    let mut asked = usable.to_vec();
    for _ in 0..ROUNDS {
        let next = round(photo, &found, usable, &asked, band);
        let moved: Vec<bool> = next.iter().zip(&found).map(|(a, b)| a != b).collect();
        if !moved.contains(&true) {
            break;
        }
        found = next;
        // Elsewhere the last answer stands.
        let away = signed_distance(&moved, &shape, (2.0 * band).ceil() as usize);
        for (asked, away) in asked.iter_mut().zip(away) {
            *asked &= away < 2.0 * band;
        }
    }
    found
}

/// One round of [`snap`], in which only pixels that are `asked` may move.
fn round(
    photo: &RgbImage,
    inside: &[bool],
    usable: &[bool],
    asked: &[bool],
    band: f32,
) -> Vec<bool> {
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let reach = (FAR * band).ceil() as usize;
    let distance = signed_distance(inside, &[width, height], reach);
    let in_band: Vec<bool> = (0..width * height)
        .map(|i| asked[i] && distance[i].abs() < band)
        .collect();
    let sure = |i: usize| {
        let away = distance[i].abs();
        usable[i] && away > SURE * band && away < FAR * band
    };
    let odds = colours::log_odds(photo, inside, sure, &in_band, band);
    let free: Vec<bool> = odds.iter().map(Option::is_some).collect();
    let evidence: Vec<f32> = odds
        .iter()
        .zip(&distance)
        .map(|(odds, distance)| odds.unwrap_or(0.0) - PRIOR * distance / band)
        .collect();
    let found = relax::relax(photo, &evidence, &free, inside);
    gate::borne_out(photo, inside, &found)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    const SIZE: (u32, u32) = (300, 240);

    fn disc(radius: f32) -> Vec<bool> {
        ellipse(radius, 0.0)
    }

    /// A disc whose right side is `more` pixels farther out.
    fn ellipse(radius: f32, more: f32) -> Vec<bool> {
        (0..SIZE.0 * SIZE.1)
            .map(|i| {
                let (x, y) = ((i % SIZE.0) as f32 - 140.0, (i / SIZE.0) as f32 - 120.0);
                let turn = y.atan2(x).abs();
                x.hypot(y) < radius + more * (1.0 - turn).clamp(0.0, 1.0)
            })
            .collect()
    }

    /// A bright disc on darker ground, with grain.
    fn photo(inside: &[bool], grain: f32) -> RgbImage {
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let i = (y * SIZE.0 + x) as usize;
            let noise = ((x * 37 + y * 101) % 17) as f32 / 17.0 - 0.5;
            let base = if inside[i] { 180.0 } else { 90.0 };
            let value = (base + grain * noise) as u8;
            Rgb([value, value, (0.8 * f32::from(value)) as u8])
        })
    }

    fn snapped(photo: &RgbImage, given: &[bool], usable: bool) -> Vec<bool> {
        let usable = vec![usable; given.len()];
        snap(photo, given, &usable, band(SIZE.0, SIZE.1))
    }

    #[test]
    fn a_rim_of_the_ground_is_taken_off_and_a_lost_rim_comes_back() {
        let truth = disc(70.0);
        let photo = photo(&truth, 20.0);
        for more in [3.0, -3.0] {
            let given = ellipse(70.0, more);
            let before = given.iter().zip(&truth).filter(|(g, t)| g != t).count();
            let found = snapped(&photo, &given, true);
            let after = found.iter().zip(&truth).filter(|(f, t)| f != t).count();
            assert!(
                before > 40 && after < before / 3,
                "{more}: {before} {after}"
            );
        }
    }

    #[test]
    fn an_outline_that_is_right_or_that_no_edge_contradicts_stays() {
        let truth = disc(70.0);
        for (given, photo) in [
            (truth.clone(), photo(&truth, 20.0)),
            // Nothing is to be seen.
            (ellipse(70.0, 3.0), photo(&disc(-1.0), 20.0)),
            // Far more grain than contrast.
            (ellipse(70.0, 3.0), photo(&disc(-1.0), 200.0)),
        ] {
            assert_eq!(snapped(&photo, &given, true), given);
        }
    }

    #[test]
    fn what_is_not_to_be_learned_from_says_nothing() {
        let truth = disc(70.0);
        let given = ellipse(70.0, 3.0);
        assert_eq!(snapped(&photo(&truth, 20.0), &given, false), given);
    }
}
