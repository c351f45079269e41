//! Masks whose outline is moved outwards or inwards all around.

use image::GrayImage;

/// Distances in pixels from the centre of each pixel to the mask's outline, row-major: positive
/// outside, cut off at `reach`.
#[must_use]
pub fn outline_distance(mask: &GrayImage, reach: u32) -> Vec<f32> {
    let inside: Vec<bool> = mask.pixels().map(|p| p.0[0] >= 128).collect();
    let width = mask.width() as usize;
    let outward = squared_distance(&inside, true, width, reach);
    let inward = squared_distance(&inside, false, width, reach);
    // The outline runs halfway between the last pixel inside and the first outside.
    let half = |squared: f32| (squared.sqrt() - 0.5).min(reach as f32);
    inside
        .iter()
        .zip(outward.iter().zip(&inward))
        .map(|(inside, (outward, inward))| match inside {
            true => -half(*inward),
            false => half(*outward),
        })
        .collect()
}

/// The mask with its outline `by` pixels farther out; farther in where that is negative.
#[must_use]
pub fn shifted(mask: &GrayImage, by: f32) -> GrayImage {
    let distances = outline_distance(mask, by.abs().ceil() as u32 + 1);
    let values = distances
        .into_iter()
        .map(|distance| if distance < by { 255 } else { 0 })
        .collect();
    GrayImage::from_raw(mask.width(), mask.height(), values).unwrap_or_else(|| mask.clone())
}

/// Squared distance to the nearest pixel that is `kind`, columns first and then rows, within `reach`
/// (Felzenszwalb and Huttenlocher 2012, within a window).
fn squared_distance(inside: &[bool], kind: bool, width: usize, reach: u32) -> Vec<f32> {
    let reach = reach as usize + 1;
    let far = (reach * reach) as f32;
    let height = inside.len().checked_div(width).unwrap_or(0);
    // Along columns: pixels since the last one of the kind, from above and from below.
    let mut along = vec![reach; inside.len()];
    for upwards in [false, true] {
        let mut since = vec![reach; width];
        for row in 0..height {
            let y = if upwards { height - 1 - row } else { row };
            for (x, since) in since.iter_mut().enumerate() {
                let i = y * width + x;
                *since = if inside[i] == kind {
                    0
                } else {
                    (*since + 1).min(reach)
                };
                along[i] = along[i].min(*since);
            }
        }
    }
    let mut squared = Vec::with_capacity(inside.len());
    for row in along.chunks(width.max(1)) {
        let columns: Vec<f32> = row.iter().map(|d| (d * d) as f32).collect();
        squared.extend((0..width).map(|x| {
            let first = x.saturating_sub(reach);
            let window = &columns[first..(x + reach + 1).min(width)];
            let offset = first as f32 - x as f32;
            window
                .iter()
                .enumerate()
                .map(|(k, d)| d + (k as f32 + offset).powi(2))
                .fold(far, f32::min)
        }));
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    fn disc(radius: f32) -> GrayImage {
        GrayImage::from_fn(90, 70, |x, y| {
            let r = (x as f32 - 40.0).hypot(y as f32 - 33.0);
            Luma([if r < radius { 255 } else { 0 }])
        })
    }

    #[test]
    fn a_disc_has_its_distance() {
        for (i, distance) in outline_distance(&disc(20.0), 12).into_iter().enumerate() {
            let r = ((i % 90) as f32 - 40.0).hypot((i / 90) as f32 - 33.0);
            let expected = (r - 20.0).clamp(-12.0, 12.0);
            assert!(
                (distance - expected).abs() < 1.0,
                "{i}: {distance} {expected}"
            );
        }
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
