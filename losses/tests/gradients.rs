//! Values and gradients of every loss against the textbook formula in f64 and its central finite
//! differences, on both CPU backends.
//!
//! Inputs are chosen so that the formulas are smooth within the differences' step: nothing closer
//! than 0.01 to the kinks of `|x|`, of Huber's function and of the clamps. What happens at those
//! points is the subject of `degenerate.rs`.

mod support;

use burn::tensor::{Device, Tensor};
use losses::{
    ColourLoss, PointPenalty, SparsityForm, background_loss, curvature_loss, eikonal_loss,
    mask_loss, opacity_entropy, point_loss, sparsity_loss,
};
use support::{constant, devices, evaluate, rows};

/// The step of the central differences: their error is of the order of its square, 1e-10, times
/// third derivatives below 1e4 here.
const STEP: f64 = 1e-5;
/// Single precision carries 6e-8 of the largest term; a dozen operations and a sum leave this.
const TOLERANCE: f64 = 3e-6;

const WEIGHTS: [f32; 4] = [1.0, 0.0, 0.5, 2.0];
const COLOURS: [f32; 12] = [
    0.1, 0.9, 0.4, 0.7, 0.3, 0.2, 0.05, 0.6, 0.95, 0.5, 0.35, 0.8,
];
const PHOTO: [f32; 12] = [
    0.15, 0.5, 0.42, 0.1, 0.33, 0.9, 0.25, 0.63, 0.9, 0.1, 0.3, 0.45,
];
const NORMALS: [f32; 12] = [
    0.1, 0.2, 0.9, -1.5, 0.4, 0.3, 0.02, -0.03, 0.01, 0.6, -0.8, 0.1,
];
const NEIGHBOURS: [f32; 12] = [0.2, 0.1, 0.8, 1.0, 0.5, -0.3, 0.5, 0.4, 0.3, 0.5, -0.9, 0.2];
const SDF: [f32; 4] = [0.3, -0.02, 0.05, -0.6];
const OPACITY: [f32; 4] = [0.02, 0.97, 0.5, 0.31];
const MASK: [f32; 4] = [1.0, 0.0, 0.25, 1.0];

/// Compares a loss with its formula; `inputs` are those whose gradients count.
fn check(
    name: &str,
    inputs: &[&[f32]],
    loss: impl Fn(&Device, &[Tensor<1>]) -> Tensor<1>,
    formula: impl Fn(&[Vec<f64>]) -> f64,
) {
    let single: Vec<Vec<f32>> = inputs.iter().map(|values| values.to_vec()).collect();
    let double: Vec<Vec<f64>> = single
        .iter()
        .map(|values| values.iter().map(|&v| v.into()).collect())
        .collect();
    for (backend, device) in devices() {
        let outcome = evaluate(&device, &single, |tensors| loss(&device, tensors));
        assert_close(
            &format!("{name} on {backend}"),
            outcome.value,
            formula(&double),
        );
        for (i, values) in double.iter().enumerate() {
            for j in 0..values.len() {
                let at = |offset: f64| {
                    let mut moved = double.clone();
                    moved[i][j] += offset;
                    formula(&moved)
                };
                let expected = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                let place = format!("{name} on {backend}, gradient {j} of input {i}");
                assert_close(&place, outcome.gradients[i][j], expected);
            }
        }
    }
}

fn assert_close(place: &str, actual: f32, expected: f64) {
    let difference = (f64::from(actual) - expected).abs();
    assert!(
        difference <= TOLERANCE * (1.0 + expected.abs()),
        "{place}: {actual}, expected {expected}"
    );
}

/// `sum w l / sum w`, or the mean.
fn reduce(elements: impl Iterator<Item = f64>, weights: Option<&[f32]>) -> f64 {
    let elements: Vec<f64> = elements.collect();
    let weights: Vec<f64> = match weights {
        Some(weights) => weights.iter().map(|&w| w.into()).collect(),
        None => vec![1.0; elements.len()],
    };
    let total: f64 = weights.iter().sum();
    elements
        .iter()
        .zip(&weights)
        .map(|(l, w)| l * w)
        .sum::<f64>()
        / total
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// With and without weights.
const BOTH: [Option<&[f32]>; 2] = [None, Some(&WEIGHTS)];

fn tensor(device: &Device, weights: Option<&[f32]>) -> Option<Tensor<1>> {
    weights.map(|values| constant(device, values))
}

fn colour_element(kind: ColourLoss, r: f64) -> f64 {
    match kind {
        ColourLoss::L2 => r * r,
        ColourLoss::L1 => r.abs(),
        ColourLoss::Huber { delta } if r.abs() <= delta.into() => r * r,
        ColourLoss::Huber { delta } => f64::from(delta) * (2.0 * r.abs() - f64::from(delta)),
    }
}

fn colour_formula(kind: ColourLoss, v: &[Vec<f64>], weights: Option<&[f32]>) -> f64 {
    let rays = v[0].chunks(3).zip(v[1].chunks(3));
    let per_ray = rays.map(|(c, photo)| {
        c.iter()
            .zip(photo)
            .map(|(a, b)| colour_element(kind, a - b))
            .sum::<f64>()
            / 3.0
    });
    reduce(per_ray, weights)
}

#[test]
fn colour() {
    for kind in [
        ColourLoss::L2,
        ColourLoss::L1,
        ColourLoss::Huber { delta: 0.12 },
    ] {
        for weights in BOTH {
            check(
                &format!("colour {kind:?}"),
                &[&COLOURS, &PHOTO],
                |device, t| kind.loss(rows(&t[0]), rows(&t[1]), tensor(device, weights)),
                |v| colour_formula(kind, v, weights),
            );
        }
    }
}

#[test]
fn background() {
    let kind = ColourLoss::Huber { delta: 0.12 };
    check(
        "background",
        &[&COLOURS, &PHOTO],
        |device, t| background_loss(kind, rows(&t[0]), rows(&t[1]), constant(device, &WEIGHTS)),
        |v| colour_formula(kind, v, Some(&WEIGHTS)),
    );
}

#[test]
fn eikonal() {
    for weights in BOTH {
        check(
            "eikonal",
            &[&NORMALS],
            |device, t| eikonal_loss(rows(&t[0]), tensor(device, weights)),
            |v| reduce(v[0].chunks(3).map(|n| (length(n) - 1.0).powi(2)), weights),
        );
    }
}

#[test]
fn sparsity() {
    for (form, power) in [(SparsityForm::Plain, 1), (SparsityForm::Squared, 2)] {
        for weights in BOTH {
            check(
                &format!("sparsity {form:?}"),
                &[&SDF],
                |device, t| sparsity_loss(t[0].clone(), 20.0, form, tensor(device, weights)),
                |v| {
                    reduce(
                        v[0].iter().map(|s| (-20.0 * s.abs()).exp().powi(power)),
                        weights,
                    )
                },
            );
        }
    }
}

#[test]
fn mask() {
    // Opacity and log transmittance as independent inputs, as the function takes them.
    let log_transmittance: Vec<f32> = OPACITY.iter().map(|a| (-a).ln_1p()).collect();
    for weights in BOTH {
        check(
            "mask",
            &[&OPACITY, &log_transmittance, &MASK],
            |device, t| {
                let [a, log_t, m] = [0, 1, 2].map(|i: usize| t[i].clone());
                mask_loss(a, log_t, m, tensor(device, weights))
            },
            |v| {
                let rays = v[0].iter().zip(&v[1]).zip(&v[2]);
                let entropy = rays.map(|((a, log_t), m)| -(1.0 - m) * log_t - m * (a + 1e-3).ln());
                reduce(entropy, weights)
            },
        );
    }
}

#[test]
fn points() {
    for weights in BOTH {
        check(
            "points L1",
            &[&SDF],
            |device, t| point_loss(t[0].clone(), PointPenalty::L1, tensor(device, weights)),
            |v| reduce(v[0].iter().map(|s| s.abs()), weights),
        );
        let delta = 0.1_f32;
        let penalty = PointPenalty::Huber { delta };
        check(
            "points Huber",
            &[&SDF],
            |device, t| point_loss(t[0].clone(), penalty, tensor(device, weights)),
            |v| {
                let d = f64::from(delta);
                let huber = |s: &f64| {
                    if s.abs() <= d {
                        s * s / (2.0 * d)
                    } else {
                        s.abs() - d / 2.0
                    }
                };
                reduce(v[0].iter().map(huber), weights)
            },
        );
    }
}

#[test]
fn curvature() {
    for weights in BOTH {
        check(
            "curvature",
            &[&NORMALS, &NEIGHBOURS],
            |device, t| curvature_loss(rows(&t[0]), rows(&t[1]), tensor(device, weights)),
            |v| {
                let pairs = v[0].chunks(3).zip(v[1].chunks(3));
                let squared = pairs.map(|(n, m)| {
                    let [ln, lm] = [length(n), length(m)];
                    n.iter()
                        .zip(m)
                        .map(|(a, b)| (a / ln - b / lm).powi(2))
                        .sum()
                });
                reduce(squared, weights)
            },
        );
    }
}

#[test]
fn entropy() {
    for weights in BOTH {
        check(
            "entropy",
            &[&OPACITY],
            |device, t| opacity_entropy(t[0].clone(), tensor(device, weights)),
            |v| {
                let entropy = v[0]
                    .iter()
                    .map(|a| -a * a.ln() - (1.0 - a) * (1.0 - a).ln());
                reduce(entropy, weights)
            },
        );
    }
}
