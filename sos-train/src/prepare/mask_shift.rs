//! Masks whose outline is moved outwards or inwards all around.

use image::GrayImage;

use super::mask::Mask;
use crate::distance::signed_distance;

/// Distances in pixels from the centre of each pixel to the mask's outline, row-major: positive
/// outside, cut off at `reach`.
#[must_use]
pub fn outline_distance(mask: &Mask, reach: u32) -> Vec<f32> {
    let inside: Vec<bool> = mask.answers().collect();
    let shape = [mask.width() as usize, mask.height() as usize];
    signed_distance(&inside, &shape, reach as usize)
}

/// The mask with its outline `by` pixels farther out; farther in where that is negative.
#[must_use]
pub fn shifted(mask: &Mask, by: f32) -> GrayImage {
    let distances = outline_distance(mask, by.abs().ceil() as u32 + 1);
    let values = distances
        .into_iter()
        .map(|distance| if distance < by { 255 } else { 0 })
        .collect();
    GrayImage::from_raw(mask.width(), mask.height(), values).unwrap_or_default()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use image::Luma;

    use super::*;
    use crate::prepare::pixels::PixelStore;

    fn shifted(picture: &GrayImage, by: f32) -> GrayImage {
        let store = PixelStore::new(&std::env::temp_dir());
        super::shifted(&Mask::of_white(picture, &store).unwrap(), by)
    }

    fn disc(radius: f32) -> GrayImage {
        GrayImage::from_fn(90, 70, |x, y| {
            let r = (x as f32 - 40.0).hypot(y as f32 - 33.0);
            Luma([if r < radius { 255 } else { 0 }])
        })
    }

    #[test]
    fn a_shifted_disc_is_a_disc_of_another_radius() {
        for (radius, by) in [(20.0, 6.0), (20.0, -6.0), (20.0, 2.0)] {
            let (found, expected) = (shifted(&disc(radius), by), disc(radius + by));
            let off = found.pixels().zip(expected.pixels());
            let off = off.filter(|(a, b)| a != b).count();
            // Of some 120 pixels along the outline, those whose centre it passes closely.
            assert!(off < 60, "{radius} {by}: {off}");
        }
    }

    #[test]
    fn nothing_grows_from_an_empty_mask_and_all_of_a_full_one_stays() {
        let empty = GrayImage::new(8, 5);
        assert_eq!(shifted(&empty, 3.0), empty);
        let full = GrayImage::from_pixel(8, 5, Luma([255]));
        assert_eq!(shifted(&full, -3.0), full);
    }
}
