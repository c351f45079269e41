use crate::{assert_near, blobs};
use sos_eval::*;

fn picture(width: usize, height: usize, seed: u32) -> RgbPlane {
    let channels = [0, 1, 2].map(|c| blobs(width, height, seed + c));
    RgbPlane::from_fn(width, height, |x, y| {
        [0, 1, 2].map(|c: usize| channels[c].values[y * width + x])
    })
}

#[test]
fn psnr_by_hand() {
    let black = RgbPlane::from_fn(4, 4, |_, _| [0.0; 3]);
    let dot = RgbPlane::from_fn(4, 4, |x, y| {
        if (x, y) == (1, 2) {
            [0.5, 0.0, 0.0]
        } else {
            [0.0; 3]
        }
    });
    assert_near(psnr(&dot, &black), -10.0 * (0.25_f64 / 48.0).log10(), 1e-9);
    assert_near(psnr(&black, &black), 100.0, 1e-9);
    let here = Plane::from_fn(4, 4, |x, _| f32::from(x == 1)).mask(0.5);
    assert_near(
        psnr_in(&dot, &black, &here).unwrap(),
        -10.0 * (0.25_f64 / 12.0).log10(),
        1e-9,
    );
    assert_eq!(psnr_in(&dot, &black, &Plane::empty(4, 4).mask(0.5)), None);
}

/// Pictures are not equal because their difference is no number.
#[test]
fn what_is_no_number_has_no_psnr() {
    let grey = RgbPlane::from_fn(20, 20, |_, _| [0.5; 3]);
    let broken = RgbPlane::from_fn(20, 20, |x, y| {
        if (x, y) == (1, 2) {
            [0.5, f32::NAN, 0.5]
        } else {
            [0.5; 3]
        }
    });
    let half = |left: bool| Plane::from_fn(20, 20, |x, _| f32::from((x < 10) == left)).mask(0.5);
    for (pred, truth) in [(&grey, &broken), (&broken, &grey)] {
        assert!(psnr(pred, truth).is_nan() && ssim(pred, truth).is_nan());
        assert!(psnr_in(pred, truth, &half(true)).unwrap().is_nan());
        assert_near(psnr_in(pred, truth, &half(false)).unwrap(), 100.0, 1e-9);
    }
    assert!(psnr_of_mse(f64::NAN).is_nan());
    assert_near(psnr_of_mse(0.0), 100.0, 1e-9);
}

#[test]
fn ssim_of_flat_pictures_is_the_luminance_term() {
    let flat = |v: f32| RgbPlane::from_fn(30, 20, |_, _| [v; 3]);
    let (a, b) = (0.25, 0.75);
    let expected = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
    assert_near(ssim(&flat(0.25), &flat(0.75)), expected, 1e-6);
    let corner = Plane::from_fn(30, 20, |x, y| f32::from(x < 3 && y < 3)).mask(0.5);
    assert_near(
        ssim_in(&flat(0.25), &flat(0.75), &corner).unwrap(),
        expected,
        1e-6,
    );
}

#[test]
fn ssim_is_one_for_equal_pictures_and_symmetric() {
    let (a, b) = (picture(40, 30, 1), picture(40, 30, 4));
    assert_near(ssim(&a, &a), 1.0, 1e-6);
    assert_near(ssim(&a, &b), ssim(&b, &a), 1e-9);
    assert!(ssim(&a, &b) < 0.9);
}

/// Windows one by one, variances about the mean (not as a difference of moments).
fn slow_ssim_at(a: &RgbPlane, b: &RgbPlane, x: isize, y: isize) -> f64 {
    let mut total = 0.0;
    for c in 0..3 {
        let mut window = Vec::new();
        for v in -5..=5_isize {
            for u in -5..=5_isize {
                let (px, py) = (x + u, y + v);
                if (0..a.width as isize).contains(&px) && (0..a.height as isize).contains(&py) {
                    let i = py as usize * a.width + px as usize;
                    let weight = (-((u * u + v * v) as f64) / (2.0 * 1.5 * 1.5)).exp();
                    window.push((weight, f64::from(a.values[i][c]), f64::from(b.values[i][c])));
                }
            }
        }
        let norm: f64 = window.iter().map(|w| w.0).sum();
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            window.iter().map(|&(w, p, q)| w * f(p, q)).sum::<f64>() / norm
        };
        let (ma, mb) = (mean(&|p, _| p), mean(&|_, q| q));
        let (va, vb) = (
            mean(&|p, _| (p - ma).powi(2)),
            mean(&|_, q| (q - mb).powi(2)),
        );
        let cov = mean(&|p, q| (p - ma) * (q - mb));
        total += (2.0 * ma * mb + 1e-4) * (2.0 * cov + 9e-4)
            / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
    }
    total / 3.0
}

#[test]
fn ssim_equals_the_slow_formula() {
    let (a, b) = (picture(27, 19, 1), picture(27, 19, 2));
    let map = ssim_map(&a, &b);
    let (mut sum, mut n) = (0.0, 0);
    for y in 0..19 {
        for x in 0..27 {
            let expected = slow_ssim_at(&a, &b, x as isize, y as isize);
            assert_near(f64::from(map.values[y * 27 + x]), expected, 1e-6);
            if (5..22).contains(&x) && (5..14).contains(&y) {
                sum += expected;
                n += 1;
            }
        }
    }
    assert_near(ssim(&a, &b), sum / f64::from(n), 1e-6);
}
