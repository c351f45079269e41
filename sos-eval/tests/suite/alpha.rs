use crate::{assert_near, blobs, disc};
use sos_eval::*;

fn row(values: &[f32]) -> Plane {
    Plane::new(values.len(), 1, values.to_vec())
}

#[test]
fn overlap_by_hand() {
    let pred = row(&[1.0, 0.5, 0.49, 0.0, 1.0]).mask(0.5);
    let truth = row(&[1.0, 0.0, 1.0, 0.0, 1.0]).mask(0.5);
    let overlap = Overlap::count(&pred, &truth);
    assert_eq!(
        overlap,
        Overlap {
            both: 2,
            only_pred: 1,
            only_truth: 1,
            neither: 1
        }
    );
    assert_eq!(overlap.iou(), 0.5);
    assert_eq!(overlap.miou(), 0.5 * (0.5 + 1.0 / 3.0));
    assert_eq!(overlap.accuracy(), 0.6);
}

#[test]
fn empty_masks() {
    let (none, some) = (Plane::empty(30, 20), disc(30, 15.0, 10.0, 5.0));
    let some = Plane::from_fn(30, 20, |x, y| some.values[y * 30 + x]);
    let agree = score_alpha(&none, &none);
    assert_eq!(agree.to_array(), [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    for (a, b) in [(&none, &some), (&some, &none)] {
        let score = score_alpha(a, b);
        assert_eq!((score.iou, score.boundary_iou), (0.0, 0.0));
    }
}

#[test]
fn perfect_and_symmetric() {
    let (a, b) = (blobs(61, 47, 1), blobs(61, 47, 2));
    assert_eq!(
        score_alpha(&a, &a).to_array(),
        [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    );
    for (ab, ba) in score_alpha(&a, &b)
        .to_array()
        .into_iter()
        .zip(score_alpha(&b, &a).to_array())
    {
        assert_near(ab, ba, 1e-12);
    }
}

#[test]
fn disc_shifted_by_one_pixel() {
    let r = 60.0_f64;
    let score = score_alpha(&disc(160, 81.0, 80.0, 60.0), &disc(160, 80.0, 80.0, 60.0));
    // Two circles of radius r, centres 1 apart: the lens between them has this area.
    let lens = 2.0 * r * r * (0.5 / r).acos() - 0.5 * (4.0 * r * r - 1.0).sqrt();
    let disc_area = std::f64::consts::PI * r * r;
    // Pixel counting leaves about a pixel in a thousand of rim length undecided.
    assert_near(score.iou, lens / (2.0 * disc_area - lens), 5e-4);
    assert_near(score.sad, 2.0 * (disc_area - lens) / 1000.0, 2e-3);
    assert_near(
        score.acc,
        1.0 - 2.0 * (disc_area - lens) / (160.0 * 160.0),
        5e-4,
    );
    assert!(
        score.boundary_iou < score.iou,
        "the rim must react more strongly than the area"
    );
}

#[test]
fn sad_and_mse_by_hand() {
    let (pred, truth) = (row(&[0.0, 0.25, 1.0, 1.0]), row(&[0.0, 0.75, 1.0, 0.0]));
    assert_near(sad(&pred, &truth), 1.5e-3, 1e-15);
    assert_near(mse(&pred, &truth), 1000.0 * (0.25 + 1.0) / 4.0, 1e-12);
}

#[test]
fn band_width_is_two_percent_of_the_diagonal() {
    assert_eq!(band_width(640, 480, BOUNDARY_SHARE), 16);
    assert_eq!(band_width(4, 4, BOUNDARY_SHARE), 1);
}

#[test]
fn boundary_band_equals_distance_to_the_outside() {
    for (seed, d) in [(1, 1), (2, 2), (3, 3), (4, 5), (5, 40)] {
        let mask = blobs(43, 31, seed).mask(0.4);
        let band = boundary_band(&mask, d);
        let reach = d as isize;
        for y in 0..31_isize {
            for x in 0..43_isize {
                let outside = |x: isize, y: isize| {
                    !(0..43).contains(&x)
                        || !(0..31).contains(&y)
                        || !mask.inside[(y * 43 + x) as usize]
                };
                let near =
                    (-reach..=reach).any(|v| (-reach..=reach).any(|u| outside(x + u, y + v)));
                assert_eq!(band.inside[(y * 43 + x) as usize], !outside(x, y) && near);
            }
        }
    }
}

#[test]
fn boundary_iou_of_a_shifted_square() {
    let square = |left: usize| {
        Plane::from_fn(60, 60, |x, y| {
            f32::from((left..left + 30).contains(&x) && (10..40).contains(&y))
        })
        .mask(0.5)
    };
    let (s, d) = (30.0, 4);
    let hole = s - 2.0 * d as f64;
    let both = s * (s - 1.0) - hole * (hole + 1.0);
    let band = s * s - hole * hole;
    assert_near(
        boundary_iou(&square(10), &square(11), d),
        both / (2.0 * band - both),
        1e-12,
    );
}

/// The benchmark's Matlab code, word for word: 2D filters, replicated border.
fn slow_gradient_error(pred: &Plane, truth: &Plane) -> f64 {
    let sigma = 1.4_f64;
    let gauss = |x: f64| {
        (-x * x / (2.0 * sigma * sigma)).exp() / (sigma * (2.0 * std::f64::consts::PI).sqrt())
    };
    let dgauss = |x: f64| -x * gauss(x) / (sigma * sigma);
    let half = (sigma * (-2.0 * ((2.0 * std::f64::consts::PI).sqrt() * sigma * 0.01).ln()).sqrt())
        .ceil() as isize;
    assert_eq!(half, 4);
    let mut energy = 0.0;
    for v in -half..=half {
        for u in -half..=half {
            energy += (gauss(v as f64) * dgauss(u as f64)).powi(2);
        }
    }
    let magnitude = |plane: &Plane, x: isize, y: isize| {
        let (mut gx, mut gy) = (0.0, 0.0);
        for v in -half..=half {
            for u in -half..=half {
                let (px, py) = (
                    (x - u).clamp(0, plane.width as isize - 1),
                    (y - v).clamp(0, plane.height as isize - 1),
                );
                let value = f64::from(plane.values[py as usize * plane.width + px as usize]);
                gx += value * gauss(v as f64) * dgauss(u as f64);
                gy += value * gauss(u as f64) * dgauss(v as f64);
            }
        }
        ((gx * gx + gy * gy) / energy).sqrt()
    };
    let mut sum = 0.0;
    for y in 0..truth.height as isize {
        for x in 0..truth.width as isize {
            sum += (magnitude(pred, x, y) - magnitude(truth, x, y)).powi(2);
        }
    }
    sum / 1000.0
}

#[test]
fn gradient_error_equals_the_slow_formula() {
    let (a, b) = (blobs(37, 29, 3), blobs(37, 29, 4));
    let expected = slow_gradient_error(&a, &b);
    assert!(expected > 0.1);
    assert_near(gradient_error(&a, &b), expected, 1e-10);
}

#[test]
fn gradient_error_ignores_a_constant() {
    let a = blobs(20, 20, 1);
    let (low, high) = (
        Plane::from_fn(20, 20, |_, _| 0.2),
        Plane::from_fn(20, 20, |_, _| 0.9),
    );
    assert_near(gradient_error(&low, &high), 0.0, 1e-12);
    assert!(gradient_error(&low, &a) > 0.0);
}

#[test]
fn connectivity_by_hand() {
    // A pixel at 0.7 where truth has 1, joined to the body: l = 0.7, phi* = 1 - 0.3.
    let truth = row(&[1.0, 1.0, 1.0, 0.0, 0.0]);
    assert_near(
        connectivity_error(&row(&[1.0, 1.0, 0.7, 0.0, 0.0]), &truth),
        0.3e-3,
        1e-9,
    );
    // 0.9: l = 0.9, and 0.1 is below theta.
    assert_near(
        connectivity_error(&row(&[1.0, 1.0, 0.9, 0.0, 0.0]), &truth),
        0.0,
        1e-12,
    );
    // A loose pixel that truth lacks: l = 0, phi = 0 against 1.
    assert_near(
        connectivity_error(&row(&[1.0, 1.0, 1.0, 0.0, 1.0]), &truth),
        1e-3,
        1e-9,
    );
    // A loose pixel in both is no difference.
    let islands = row(&[1.0, 1.0, 1.0, 0.0, 1.0]);
    assert_near(connectivity_error(&islands, &islands), 0.0, 0.0);
    // Diagonal neighbours are not connected: the pixel at (2, 1) hangs loose, l = 0.
    let corner = Plane::new(3, 2, vec![1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let fainter = Plane::new(3, 2, vec![1.0, 1.0, 0.0, 0.0, 0.0, 0.5]);
    assert_near(connectivity_error(&fainter, &corner), 0.5e-3, 1e-9);
}

/// Per threshold: spread labels until nothing changes, take the largest, look up the last threshold of
/// an unbroken run.
fn slow_connectivity_error(pred: &Plane, truth: &Plane) -> f64 {
    let (w, h) = (truth.width, truth.height);
    let omegas: Vec<Vec<bool>> = (1..=10)
        .map(|step| {
            let t = step as f32 / 10.0;
            let inside = |i: usize| pred.values[i] >= t && truth.values[i] >= t;
            let mut label: Vec<usize> = (0..w * h)
                .map(|i| if inside(i) { i + 1 } else { 0 })
                .collect();
            loop {
                let before = label.clone();
                for i in (0..w * h).filter(|&i| inside(i)) {
                    let (x, y) = (i % w, i / w);
                    let mut around = vec![i];
                    if x > 0 {
                        around.push(i - 1)
                    }
                    if x + 1 < w {
                        around.push(i + 1)
                    }
                    if y > 0 {
                        around.push(i - w)
                    }
                    if y + 1 < h {
                        around.push(i + w)
                    }
                    label[i] = around
                        .into_iter()
                        .map(|j| label[j])
                        .filter(|&l| l > 0)
                        .min()
                        .unwrap();
                }
                if before == label {
                    break;
                }
            }
            let size = |l: usize| label.iter().filter(|&&other| other == l).count();
            let mut labels: Vec<usize> = label.iter().copied().filter(|&l| l > 0).collect();
            labels.sort_unstable();
            labels.dedup();
            labels.reverse();
            let best = labels.into_iter().max_by_key(|&l| size(l));
            label.iter().map(|&l| Some(l) == best).collect()
        })
        .collect();
    let mut sum = 0.0;
    for i in 0..w * h {
        let l = omegas.iter().take_while(|omega| omega[i]).count() as f64 / 10.0;
        let phi = |a: f32| {
            let d = f64::from(a) - l;
            1.0 - if d >= 0.15 { d } else { 0.0 }
        };
        sum += (phi(pred.values[i]) - phi(truth.values[i])).abs();
    }
    sum / 1000.0
}

#[test]
fn connectivity_error_equals_the_slow_formula() {
    for seed in [1, 5, 9] {
        let (a, b) = (blobs(33, 27, seed), blobs(33, 27, seed + 1));
        let expected = slow_connectivity_error(&a, &b);
        assert!(expected > 0.01);
        assert_near(connectivity_error(&a, &b), expected, 1e-6);
    }
}

#[test]
fn what_is_no_number_has_no_score() {
    let truth = blobs(33, 27, 3);
    let mut broken = truth.clone();
    broken.values[100] = f32::NAN;
    for error in [sad, mse, gradient_error, connectivity_error] {
        assert_eq!(error(&truth, &truth), 0.0);
        assert!(error(&broken, &truth).is_nan() && error(&truth, &broken).is_nan());
    }
}

#[test]
#[should_panic(expected = "sad: pictures of 2x1 and 3x1 pixels")]
fn unequal_sizes_are_named() {
    sad(&Plane::empty(2, 1), &Plane::empty(3, 1));
}
