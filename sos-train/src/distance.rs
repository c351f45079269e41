//! The signed distance of a set of pixels or voxels.

use rayon::prelude::*;

/// Elements that one task computes.
const TASK: usize = 1024;

/// Signed distances between the centres of `inside` elements and others, in elements: negative inside,
/// cut off at `reach`.
///
/// `shape` has the number of elements along each axis, the fastest first; `inside` has their product.
#[must_use]
pub(crate) fn signed_distance(inside: &[bool], shape: &[usize], reach: usize) -> Vec<f32> {
    let outward = squared_distance(inside, true, shape, reach);
    let inward = squared_distance(inside, false, shape, reach);
    // The surface lies halfway between the last element inside and the first outside.
    let half = |squared: f32| (squared.sqrt() - 0.5).min(reach as f32);
    inside
        .iter()
        .zip(outward.iter().zip(&inward))
        .map(|(inside, (outward, inward))| {
            if *inside {
                -half(*inward)
            } else {
                half(*outward)
            }
        })
        .collect()
}

/// Squared distance of every element to the nearest that is `kind`, one axis at a time (Felzenszwalb and
/// Huttenlocher 2012, within a window).
fn squared_distance(inside: &[bool], kind: bool, shape: &[usize], reach: usize) -> Vec<f32> {
    let far = ((reach + 1) * (reach + 1)) as f32;
    let start = |i: &bool| if *i == kind { 0.0 } else { far };
    let mut squared: Vec<f32> = inside.iter().map(start).collect();
    let mut stride = 1;
    for &n in shape {
        squared = (0..squared.len())
            .into_par_iter()
            .with_min_len(TASK)
            .map(|i| {
                let at = i / stride % n;
                let window = at.saturating_sub(reach)..(at + reach + 1).min(n);
                window
                    .map(|k| squared[i + k * stride - at * stride] + (k as f32 - at as f32).powi(2))
                    .fold(far, f32::min)
            })
            .collect();
        stride *= n;
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_and_discs_have_their_distance() {
        let reach = 8;
        for shape in [&[32usize, 32, 32][..], &[40, 30]] {
            let distance = |i: usize| {
                let (mut rest, mut squared) = (i, 0.0);
                for &n in shape {
                    squared += ((rest % n) as f32 - 15.5).powi(2);
                    rest /= n;
                }
                squared.sqrt() - 9.0
            };
            let inside: Vec<bool> = (0..shape.iter().product())
                .map(|i| distance(i) < 0.0)
                .collect();
            let found = signed_distance(&inside, shape, reach);
            for (i, found) in found.into_iter().enumerate() {
                let expected = distance(i).clamp(-(reach as f32), reach as f32);
                assert!(
                    (found - expected).abs() < 0.9,
                    "{shape:?}: {found} {expected}"
                );
            }
        }
    }
}
