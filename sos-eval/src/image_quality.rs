//! How close two pictures are: PSNR and SSIM, over the whole picture or inside a mask.
//! Colours `[height, width, 3]` in 0..=1, so the peak is 1.

use crate::filter::{Border, separable};
use crate::picture::{Mask, Plane, RgbPlane, assert_same_size};

/// Smallest mean squared error [`psnr_of_mse`] tells apart: equal pictures read 100 dB, and means stay
/// finite.
pub const LEAST_MSE: f64 = 1e-10;

/// `PSNR = -10 log10(MSE)` in dB, the MSE floored at [`LEAST_MSE`]; NaN if the MSE is.
pub fn psnr_of_mse(mse: f64) -> f64 {
    // Not `max`, which would make equal pictures of those whose difference is no number.
    let floored = if mse < LEAST_MSE { LEAST_MSE } else { mse };
    -10.0 * floored.log10()
}

/// `PSNR = -10 log10(mean (x - y)^2)` over all pixels and channels, dB; NaN if a value is.
///
/// ```
/// use sos_eval::{RgbPlane, psnr};
/// let grey = RgbPlane::from_fn(8, 8, |_, _| [0.5; 3]);
/// let brighter = RgbPlane::from_fn(8, 8, |_, _| [0.6; 3]);
/// assert!((psnr(&grey, &brighter) - 20.0).abs() < 1e-5);
/// ```
///
/// # Panics
/// If the sizes differ, as all functions here.
pub fn psnr(pred: &RgbPlane, truth: &RgbPlane) -> f64 {
    let (sum, n) = squared_error(pred, truth, None);
    psnr_of_mse(sum / (3 * n.max(1)) as f64)
}

/// [`psnr`] over the pixels of `region` only; `None` if it is empty.
pub fn psnr_in(pred: &RgbPlane, truth: &RgbPlane, region: &Mask) -> Option<f64> {
    let (sum, n) = squared_error(pred, truth, Some(region));
    (n > 0).then(|| psnr_of_mse(sum / (3 * n) as f64))
}

/// Sum of squared differences over the pixels of the region and all channels, and how many pixels.
pub(crate) fn squared_error(
    pred: &RgbPlane,
    truth: &RgbPlane,
    region: Option<&Mask>,
) -> (f64, usize) {
    assert_same_size("psnr", pred, truth);
    if let Some(region) = region {
        assert_same_size("psnr region", truth, region);
    }
    let (mut sum, mut n) = (0.0, 0);
    for (i, (p, t)) in pred.values.iter().zip(&truth.values).enumerate() {
        if region.is_none_or(|region| region.inside[i]) {
            n += 1;
            for c in 0..3 {
                let d = f64::from(p[c]) - f64::from(t[c]);
                sum += d * d;
            }
        }
    }
    (sum, n)
}

const RADIUS: usize = 5;
const SIGMA: f64 = 1.5;

/// SSIM of every pixel, mean of the three channels (Wang et al., IEEE TIP 2004), `[height, width]`.
///
/// With the means `mx`, `my`, variances and covariance under a Gaussian window of 11x11 pixels, sigma
/// 1.5, `C1 = 0.01^2`, `C2 = 0.03^2`:
/// `SSIM = (2 mx my + C1) (2 sxy + C2) / ((mx^2 + my^2 + C1) (sx^2 + sy^2 + C2))`.
/// At the border the window is cut off and its weights still sum to 1.
pub fn ssim_map(pred: &RgbPlane, truth: &RgbPlane) -> Plane {
    assert_same_size("ssim", pred, truth);
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let (width, height) = (truth.width, truth.height);
    let window: Vec<f64> = (0..=2 * RADIUS)
        .map(|k| (-0.5 * ((k as f64 - RADIUS as f64) / SIGMA).powi(2)).exp())
        .collect();
    let blur = |values: &[f64]| separable(values, (width, height), &window, &window, Border::Zero);
    let weight = blur(&vec![1.0; width * height]);
    let product =
        |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };

    let mut total = vec![0.0; width * height];
    for c in 0..3 {
        let x: Vec<f64> = pred.values.iter().map(|v| f64::from(v[c])).collect();
        let y: Vec<f64> = truth.values.iter().map(|v| f64::from(v[c])).collect();
        let (mx, my) = (blur(&x), blur(&y));
        let (xx, yy, xy) = (
            blur(&product(&x, &x)),
            blur(&product(&y, &y)),
            blur(&product(&x, &y)),
        );
        for (i, total) in total.iter_mut().enumerate() {
            let (mx, my) = (mx[i] / weight[i], my[i] / weight[i]);
            let (vx, vy) = (xx[i] / weight[i] - mx * mx, yy[i] / weight[i] - my * my);
            let cov = xy[i] / weight[i] - mx * my;
            *total += (2.0 * mx * my + C1) * (2.0 * cov + C2)
                / ((mx * mx + my * my + C1) * (vx + vy + C2));
        }
    }
    let values = total.into_iter().map(|sum| (sum / 3.0) as f32).collect();
    Plane {
        width,
        height,
        values,
    }
}

/// Mean of [`ssim_map`] over the pixels whose window lies within the picture, as Wang et al. have it;
/// over all pixels if the picture is smaller than the window.
pub fn ssim(pred: &RgbPlane, truth: &RgbPlane) -> f64 {
    whole_mean(&ssim_map(pred, truth))
}

/// Mean of [`ssim_map`] over the pixels of `region`; `None` if it is empty. The windows of pixels
/// near its rim look beyond it.
pub fn ssim_in(pred: &RgbPlane, truth: &RgbPlane, region: &Mask) -> Option<f64> {
    assert_same_size("ssim region", truth, region);
    let (sum, n) = sum_in(&ssim_map(pred, truth), region);
    (n > 0).then(|| sum / n as f64)
}

/// The mean of [`ssim`], from its map.
pub(crate) fn whole_mean(map: &Plane) -> f64 {
    let side = 2 * RADIUS;
    let margin = if map.width > side && map.height > side {
        RADIUS
    } else {
        0
    };
    let rows = map
        .values
        .chunks_exact(map.width.max(1))
        .skip(margin)
        .take(map.height - 2 * margin);
    let (mut sum, mut n) = (0.0, 0_usize);
    for row in rows {
        for &v in &row[margin..map.width - margin] {
            sum += f64::from(v);
            n += 1;
        }
    }
    if n == 0 { 1.0 } else { sum / n as f64 }
}

/// Sum of a plane over the pixels of a region, and how many they are.
pub(crate) fn sum_in(map: &Plane, region: &Mask) -> (f64, usize) {
    let inside = map
        .values
        .iter()
        .zip(&region.inside)
        .filter(|(_, inside)| **inside);
    inside.fold((0.0, 0), |(sum, n), (v, _)| (sum + f64::from(*v), n + 1))
}
