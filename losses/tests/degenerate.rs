//! What training meets and textbooks leave out: nothing to average, weights of zero, opacities of
//! exactly 0 and 1, vectors of no length. Values and gradients stay finite, and say what they must.

mod support;

use burn::tensor::{Device, Tensor};
use losses::{
    ColourLoss, PointPenalty, SparsityForm, background_loss, curvature_loss, eikonal_loss,
    mask_loss, opacity_entropy, point_loss, sparsity_loss,
};
use support::{constant, devices, evaluate, rows};

/// A loss over elements, whichever it is: takes two inputs of three numbers per element.
type AnyLoss = fn(&[Tensor<1>], Option<Tensor<1>>) -> Tensor<1>;

/// The first column of a tensor with three numbers per element.
fn column(tensor: &Tensor<1>) -> Tensor<1> {
    let [values] = tensor.dims();
    rows(tensor).narrow(1, 0, 1).reshape([values / 3])
}

const LOSSES: [(&str, AnyLoss); 11] = [
    ("colour L2", |t, w| {
        ColourLoss::L2.loss(rows(&t[0]), rows(&t[1]), w)
    }),
    ("colour L1", |t, w| {
        ColourLoss::L1.loss(rows(&t[0]), rows(&t[1]), w)
    }),
    ("colour Huber", |t, w| {
        ColourLoss::Huber { delta: 0.1 }.loss(rows(&t[0]), rows(&t[1]), w)
    }),
    ("background", |t, w| {
        let outside = w.unwrap_or_else(|| column(&t[0]).ones_like());
        background_loss(ColourLoss::L2, rows(&t[0]), rows(&t[1]), outside)
    }),
    ("eikonal", |t, w| eikonal_loss(rows(&t[0]), w)),
    ("sparsity", |t, w| {
        sparsity_loss(column(&t[0]), 20.0, SparsityForm::Plain, w)
    }),
    ("mask", |t, w| {
        let opacity = column(&t[0]);
        mask_loss(opacity.clone(), opacity.neg().log1p(), column(&t[1]), w)
    }),
    ("points L1", |t, w| {
        point_loss(column(&t[0]), PointPenalty::L1, w)
    }),
    ("points Huber", |t, w| {
        point_loss(column(&t[0]), PointPenalty::Huber { delta: 0.1 }, w)
    }),
    ("curvature", |t, w| {
        curvature_loss(rows(&t[0]), rows(&t[1]), w)
    }),
    ("entropy", |t, w| opacity_entropy(column(&t[0]), w)),
];

fn assert_finite(place: &str, value: f32, gradients: &[Vec<f32>]) {
    assert!(value.is_finite(), "{place}: value {value}");
    for gradient in gradients {
        assert!(
            gradient.iter().all(|g| g.is_finite()),
            "{place}: gradient {gradient:?}"
        );
    }
}

#[test]
fn an_empty_batch_costs_nothing() {
    for (backend, device) in devices() {
        for (name, loss) in LOSSES {
            let inputs = [vec![], vec![]];
            let plain = evaluate(&device, &inputs, |t| loss(t, None));
            assert_eq!(plain.value, 0.0, "{name} on {backend}, no elements");
            let weights = || Some(constant(&device, &[]));
            let weighted = evaluate(&device, &inputs, |t| loss(t, weights()));
            assert_eq!(
                weighted.value, 0.0,
                "{name} on {backend}, no elements, no weights"
            );
        }
    }
}

#[test]
fn weights_of_zero_cost_nothing_and_pull_nothing() {
    let inputs = [
        vec![0.2, 0.5, 0.9, 0.4, 0.3, 0.1],
        vec![1.0, 0.5, 0.1, 0.0, 0.3, 0.7],
    ];
    for (backend, device) in devices() {
        for (name, loss) in LOSSES {
            let outcome = evaluate(&device, &inputs, |t| {
                loss(t, Some(constant(&device, &[0.0, 0.0])))
            });
            let place = format!("{name} on {backend}");
            assert_eq!(outcome.value, 0.0, "{place}");
            for gradient in outcome.gradients {
                assert!(
                    gradient.iter().all(|&g| g == 0.0),
                    "{place}: gradient {gradient:?}"
                );
            }
        }
    }
}

#[test]
fn an_element_of_weight_zero_is_as_if_absent() {
    let both = [
        vec![0.2, 0.5, 0.9, 0.4, 0.3, 0.1],
        vec![1.0, 0.5, 0.1, 0.0, 0.3, 0.7],
    ];
    let first = both.each_ref().map(|values| values[..3].to_vec());
    for (backend, device) in devices() {
        for (name, loss) in LOSSES {
            let with = evaluate(&device, &both, |t| {
                loss(t, Some(constant(&device, &[0.5, 0.0])))
            });
            let without = evaluate(&device, &first, |t| loss(t, None));
            let difference = (with.value - without.value).abs();
            assert!(
                difference < 1e-6,
                "{name} on {backend}: {}, {}",
                with.value,
                without.value
            );
        }
    }
}

#[test]
fn zeros_and_ones_stay_finite() {
    for (backend, device) in devices() {
        for (name, loss) in LOSSES {
            // At opacity 1 the log transmittance's own gradient is infinite, which is the
            // renderer's affair: here the mask loss is tested below, with inputs of its own.
            let ones = if name == "mask" { 0.5 } else { 1.0 };
            for (a, b) in [(0.0, 0.0), (0.0, ones), (ones, 0.0), (ones, ones)] {
                let inputs = [vec![a; 6], vec![b; 6]];
                let outcome = evaluate(&device, &inputs, |t| loss(t, None));
                let place = format!("{name} on {backend} at {a} and {b}");
                assert_finite(&place, outcome.value, &outcome.gradients);
            }
        }
    }
}

#[test]
fn normals_of_no_length_have_no_gradient() {
    for (backend, device) in devices() {
        let zero = vec![0.0; 3];
        let eikonal = evaluate(&device, std::slice::from_ref(&zero), |t| {
            eikonal_loss(rows(&t[0]), None)
        });
        assert!(
            (eikonal.value - 1.0).abs() < 1e-5,
            "{backend}: {}",
            eikonal.value
        );
        assert_eq!(eikonal.gradients[0], zero, "{backend}");

        let inputs = [zero.clone(), vec![0.0, 0.0, 3.0]];
        let curvature = evaluate(&device, &inputs, |t| {
            curvature_loss(rows(&t[0]), rows(&t[1]), None)
        });
        assert!(
            (curvature.value - 1.0).abs() < 1e-6,
            "{backend}: {}",
            curvature.value
        );
        assert_eq!(curvature.gradients[0], zero, "{backend}");
    }
}

/// Value and the gradients by opacity and log transmittance of the mask loss of one ray.
fn mask_of_one(device: &Device, opacity: f32, log_transmittance: f32, mask: f32) -> [f32; 3] {
    let inputs = [vec![opacity], vec![log_transmittance]];
    let outcome = evaluate(device, &inputs, |t| {
        mask_loss(t[0].clone(), t[1].clone(), constant(device, &[mask]), None)
    });
    [
        outcome.value,
        outcome.gradients[0][0],
        outcome.gradients[1][0],
    ]
}

#[test]
fn the_mask_loss_pulls_rays_that_are_fully_wrong() {
    for (backend, device) in devices() {
        // Empty where the object should be: the gradient that a clamp would have killed.
        let [value, by_opacity, _] = mask_of_one(&device, 0.0, 0.0, 1.0);
        assert!((value - 6.907_755).abs() < 1e-5, "{backend}: {value}");
        assert!((by_opacity + 1000.0).abs() < 0.1, "{backend}: {by_opacity}");

        // Solid where nothing should be, at a transmittance that no f32 can hold.
        let [value, _, by_log] = mask_of_one(&device, 1.0, -400.0, 0.0);
        assert_eq!([value, by_log], [400.0, -1.0], "{backend}");
        // At one that a wall's density makes of a long last interval.
        let [value, _, by_log] = mask_of_one(&device, 1.0, -1.6e9, 0.0);
        assert_eq!([value, by_log], [1.6e9, -1.0], "{backend}");

        // Right in both ways.
        let [value, ..] = mask_of_one(&device, 0.0, 0.0, 0.0);
        assert_eq!(value, 0.0, "{backend}");
        let [value, ..] = mask_of_one(&device, 1.0, -400.0, 1.0);
        assert!(value.abs() < 2e-3, "{backend}: {value}");
    }
}

#[test]
fn the_mask_loss_survives_an_infinite_log_transmittance() {
    for (backend, device) in devices() {
        for mask in [0.0, 0.5, 1.0] {
            let [value, by_opacity, by_log] = mask_of_one(&device, 1.0, f32::NEG_INFINITY, mask);
            assert_finite(backend, value, &[vec![by_opacity, by_log]]);
        }
        // A whole batch of them adds up to a number, too.
        let rays = 10_000;
        let inputs = [vec![1.0; rays], vec![f32::NEG_INFINITY; rays]];
        let outcome = evaluate(&device, &inputs, |t| {
            let mask = constant(&device, &vec![0.0; rays]);
            let weights = constant(&device, &vec![2.0; rays]);
            mask_loss(t[0].clone(), t[1].clone(), mask, Some(weights))
        });
        assert_finite(backend, outcome.value, &outcome.gradients);
    }
}

#[test]
#[should_panic(expected = "mask_loss: mask has shape [3], expected [2]")]
fn a_wrong_shape_is_named() {
    let device = Device::flex();
    let two = || constant(&device, &[0.5, 0.5]);
    let _ = mask_loss(two(), two(), constant(&device, &[0.0, 0.0, 1.0]), None);
}

#[test]
#[should_panic(expected = "background_loss: weights has shape [1], expected [2]")]
fn wrong_weights_are_named() {
    let device = Device::flex();
    let colours = || rows(&constant(&device, &[0.5; 6]));
    let _ = background_loss(
        ColourLoss::L2,
        colours(),
        colours(),
        constant(&device, &[1.0]),
    );
}

#[test]
#[should_panic(expected = "Huber's delta is 0, expected a positive number")]
fn a_delta_of_zero_is_refused() {
    let device = Device::flex();
    let _ = point_loss(
        constant(&device, &[0.1]),
        PointPenalty::Huber { delta: 0.0 },
        None,
    );
}
