//! Pixels and their neighbours come to agree.

use image::RgbImage;

/// Rounds of mean field.
const ROUNDS: usize = 30;
/// What agreeing with a neighbour of the same colour is worth in log odds, and with any.
const SAME: f32 = 2.0;
const ANY: f32 = 0.1;

/// Whether each pixel is inside, by its own `evidence` (log odds) and its four neighbours, the more the less the photo
/// changes between them; only pixels `free` to change do, the others are as `inside` has them.
pub(super) fn relax(
    photo: &RgbImage,
    evidence: &[f32],
    free: &[bool],
    inside: &[bool],
) -> Vec<bool> {
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let raw = photo.as_raw();
    let change = |i: usize, j: usize| -> f32 {
        (0..3)
            .map(|c| (f32::from(raw[3 * i + c]) - f32::from(raw[3 * j + c])).powi(2))
            .sum()
    };
    let pixels: Vec<usize> = (0..width * height).filter(|&i| free[i]).collect();
    let right = |i: usize| (i % width + 1 < width).then_some(i + 1);
    let below = |i: usize| (i / width + 1 < height).then_some(i + width);
    let (mut sum, mut count) = (0.0f64, 0u32);
    for &i in &pixels {
        for j in [right(i), below(i)].into_iter().flatten() {
            sum += f64::from(change(i, j));
            count += 1;
        }
    }
    let usual = (sum / f64::from(count.max(1))).max(1.0) as f32;
    let tie = |i: usize, j: usize| SAME * (-change(i, j) / (2.0 * usual)).exp() + ANY;
    // Each pixel's neighbours with what agreeing is worth.
    let ties: Vec<[(usize, f32); 4]> = pixels
        .iter()
        .map(|&i| {
            let left = (i % width > 0).then(|| i - 1);
            let above = (i >= width).then(|| i - width);
            [right(i), left, below(i), above].map(|j| j.map_or((i, 0.0), |j| (j, tie(i, j))))
        })
        .collect();
    let logistic = |odds: f32| 1.0 / (1.0 + (-odds).exp());
    let mut share: Vec<f32> = (0..width * height)
        .map(|i| {
            if free[i] {
                logistic(evidence[i])
            } else {
                f32::from(u8::from(inside[i]))
            }
        })
        .collect();
    for _ in 0..ROUNDS {
        for (&i, ties) in pixels.iter().zip(&ties) {
            let pull = ties.iter().map(|&(j, tie)| tie * (2.0 * share[j] - 1.0));
            share[i] = logistic(evidence[i] + pull.sum::<f32>());
        }
    }
    share.into_iter().map(|share| share > 0.5).collect()
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn an_edge_of_the_photo_is_where_agreement_ends() {
        // Dark up to column 11; evidence in single columns only.
        let photo = RgbImage::from_fn(24, 9, |x, _| Rgb([if x < 12 { 40 } else { 200 }; 3]));
        let evidence: Vec<f32> = (0..24 * 9)
            .map(|i| match i % 24 {
                10 => 3.0,
                13 => -3.0,
                _ => 0.0,
            })
            .collect();
        let free = vec![true; 24 * 9];
        let found = relax(&photo, &evidence, &free, &vec![false; 24 * 9]);
        for (i, found) in found.iter().enumerate() {
            assert_eq!(*found, i % 24 < 12, "{i}");
        }
    }

    #[test]
    fn what_is_not_free_stays() {
        let photo = RgbImage::from_pixel(8, 4, Rgb([90; 3]));
        let inside: Vec<bool> = (0..32).map(|i| i % 8 < 3).collect();
        let found = relax(&photo, &[-9.0; 32], &[false; 32], &inside);
        assert_eq!(found, inside);
    }
}
