//! Losses of rows in one pass: against the same in tensor operations, against finite differences, and at the edges.

mod support;

use burn::tensor::{Device, Tensor, TensorData};
use losses::{
    ColourLoss, PointPenalty, RowLoss, RowTerm, SparsityForm, background_loss,
    eikonal_loss_of_lengths, mask_loss, mean_weights, point_loss, row_losses, row_losses_reference,
    sparsity_loss,
};
use support::devices;

/// Columns of the rows below: colour, opacity, another opacity, a length, one that nothing is asked of.
const COLUMNS: usize = 7;
/// Columns that are known: photo, mask, two kinds of weights.
const KNOWN: usize = 6;

fn terms() -> Vec<RowTerm> {
    let colour = |kind| RowLoss::Colour {
        kind,
        colour: 0,
        photo: 0,
    };
    [
        (colour(ColourLoss::L2), 4),
        (colour(ColourLoss::L1), 5),
        (colour(ColourLoss::Huber { delta: 0.2 }), 4),
        (
            RowLoss::Mask {
                opacity: 3,
                mask: 3,
            },
            5,
        ),
        (RowLoss::Shortfall { seen: 3, most: 4 }, 4),
        (RowLoss::Value { column: 5 }, 5),
        (RowLoss::UnitLength { length: 5 }, 4),
        (RowLoss::Sparsity { sdf: 3, tau: 2.5 }, 5),
        (RowLoss::Surface { sdf: 5 }, 4),
    ]
    .map(|(loss, weight)| RowTerm { loss, weight })
    .to_vec()
}

/// Numbers in `[0, 1)`.
fn numbers(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed;
    (0..count)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        })
        .collect()
}

fn matrix(values: &[f32], columns: usize, device: &Device) -> Tensor<2> {
    let data = TensorData::new(values.to_vec(), [values.len() / columns, columns]);
    Tensor::from_data(data, device)
}

fn list<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec::<f32>().expect("f32")
}

/// The losses, and the gradient of a mix of them by the rows.
fn run(
    device: &Device,
    rows: &[f32],
    known: &[f32],
    of: impl Fn(Tensor<2>, Tensor<2>, Vec<RowTerm>) -> Tensor<1>,
) -> [Vec<f32>; 2] {
    let rows = matrix(rows, COLUMNS, device).require_grad();
    let losses = of(rows.clone(), matrix(known, KNOWN, device), terms());
    let mix = Tensor::from_floats([1.0, -2.0, 0.5, 3.0, 1.5, -0.7, 0.2, -1.2, 0.8], device);
    let gradients = (losses.clone() * mix).sum().backward();
    [list(losses), list(rows.grad(&gradients).expect("tracked"))]
}

fn assert_close(what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected.iter().fold(1e-6_f32, |a, b| a.max(b.abs()));
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!(
            (f - e).abs() <= tolerance * largest,
            "{what}[{i}]: {f}, expected {e}"
        );
    }
}

/// More rows than a task takes, and few.
#[test]
fn one_pass_says_what_tensor_operations_say() {
    for (backend, device) in devices() {
        for n in [1, 3, 9001] {
            let (rows, known) = (numbers(n * COLUMNS, 1), numbers(n * KNOWN, 2));
            let found = run(&device, &rows, &known, row_losses);
            let expected = run(&device, &rows, &known, |rows, known, terms| {
                row_losses_reference(rows, known, &terms)
            });
            for (what, (f, e)) in ["losses", "gradient"]
                .iter()
                .zip(found.iter().zip(&expected))
            {
                assert_close(&format!("{what} of {n} rows, {backend}"), f, e, 1e-5);
            }
        }
    }
}

/// On both sides of a surface, and on it.
#[test]
fn distances_are_those_of_the_losses_that_are_named() {
    let sdf = [-0.3, 0.0, 0.25, -0.01, 0.8];
    let n = sdf.len();
    for (backend, device) in devices() {
        // Values, and the gradient of one of both.
        let run = |of: &dyn Fn(Tensor<2>) -> Tensor<1>, which: [f32; 2]| {
            let rows = matrix(&sdf, 1, &device).require_grad();
            let losses = of(rows.clone());
            let mix = Tensor::from_floats(which, &device);
            let gradients = (losses.clone() * mix).sum().backward();
            [list(losses), list(rows.grad(&gradients).expect("tracked"))]
        };
        let in_one_pass = |rows| {
            let terms = [
                RowLoss::Sparsity { sdf: 0, tau: 4.0 },
                RowLoss::Surface { sdf: 0 },
            ]
            .map(|loss| RowTerm { loss, weight: 0 });
            let weights = matrix(&mean_weights(vec![1.0; n]), 1, &device);
            row_losses(rows, weights, terms.to_vec())
        };
        let one_by_one = |rows: Tensor<2>| {
            let sdf = rows.reshape([n]);
            let sparsity = sparsity_loss(sdf.clone(), 4.0, SparsityForm::Plain, None);
            Tensor::cat(vec![sparsity, point_loss(sdf, PointPenalty::L1, None)], 0)
        };
        for which in [[1.0, 0.0], [0.0, 1.0]] {
            let (found, expected) = (run(&in_one_pass, which), run(&one_by_one, which));
            assert_close(backend, &found[0], &expected[0], 1e-6);
            assert_close(backend, &found[1], &expected[1], 1e-5);
        }
    }
}

/// Central differences of each term by itself; nothing lies near a kink.
#[test]
fn gradients_are_finite_differences() {
    let (rows, known) = (numbers(5 * COLUMNS, 7), numbers(5 * KNOWN, 0x9E37_79B9));
    let (_, device) = devices().into_iter().next().expect("a device");
    for (t, term) in terms().into_iter().enumerate() {
        let value = |rows: &[f32]| {
            let rows = matrix(rows, COLUMNS, &device);
            list(row_losses(rows, matrix(&known, KNOWN, &device), vec![term]))[0]
        };
        let leaf = matrix(&rows, COLUMNS, &device).require_grad();
        let loss = row_losses(leaf.clone(), matrix(&known, KNOWN, &device), vec![term]);
        let gradient = list(leaf.grad(&loss.sum().backward()).expect("tracked"));
        let step = 1e-3;
        for i in 0..rows.len() {
            // No gradient flows to what others are compared with.
            if t == 4 && i % COLUMNS == 4 {
                assert_eq!(gradient[i], 0.0);
                continue;
            }
            let (mut low, mut high) = (rows.clone(), rows.clone());
            low[i] -= step;
            high[i] += step;
            let slope = (value(&high) - value(&low)) / (2.0 * step);
            assert!(
                (gradient[i] - slope).abs() < 2e-3 * (1.0 + slope.abs()),
                "{term:?}, value {i}: {} instead of {slope}",
                gradient[i]
            );
        }
    }
}

/// The losses that terms are named after.
#[test]
fn terms_are_the_losses_they_name() {
    for (_, device) in devices() {
        let n = 40;
        let (rows, mut known) = (numbers(n * COLUMNS, 3), numbers(n * KNOWN, 4));
        let weights: Vec<f32> = known.iter().skip(4).step_by(KNOWN).copied().collect();
        for (known, weight) in known
            .chunks_exact_mut(KNOWN)
            .zip(mean_weights(weights.clone()))
        {
            known[4] = weight;
        }
        let (rows, known) = (
            matrix(&rows, COLUMNS, &device),
            matrix(&known, KNOWN, &device),
        );
        let column = |of: &Tensor<2>, column: usize| of.clone().narrow(1, column, 1).reshape([n]);
        let weights = Tensor::<1>::from_floats(&weights[..], &device);
        let (colour, photo) = (rows.clone().narrow(1, 0, 3), known.clone().narrow(1, 0, 3));
        let opacity = column(&rows, 3);
        let hidden = opacity
            .clone()
            .neg()
            .add_scalar(1.0 + losses::OPACITY_OFFSET)
            .log();
        let expected = [
            background_loss(ColourLoss::L2, colour, photo, weights.clone()),
            mask_loss(opacity, hidden, column(&known, 3), Some(weights.clone())),
            eikonal_loss_of_lengths(column(&rows, 5), Some(weights)),
        ];
        let mut terms = terms();
        terms[3].weight = 4;
        let found = list(row_losses(rows, known, vec![terms[0], terms[3], terms[6]]));
        for (found, expected) in found.iter().zip(expected) {
            let expected = list(expected)[0];
            assert!((found - expected).abs() < 2e-6, "{found} {expected}");
        }
    }
}

#[test]
fn nothing_is_zero_and_stays_differentiable() {
    for (_, device) in devices() {
        let [losses, gradient] = run(&device, &[], &[], row_losses);
        assert_eq!(losses, vec![0.0; 9]);
        assert!(gradient.is_empty());
    }
    assert_eq!(mean_weights(vec![0.0, 0.0]), [0.0, 0.0]);
    assert_eq!(mean_weights(vec![1.0, 3.0]), [0.25, 0.75]);
}

/// A row of weight 0 is not there, whatever it and what is known of it are.
#[test]
fn rows_without_weight_are_ignored_even_where_they_are_no_numbers() {
    let (n, row) = (50, 20);
    let (clean, mut known) = (numbers(n * COLUMNS, 5), numbers(n * KNOWN, 6));
    known[row * KNOWN + 4..(row + 1) * KNOWN].fill(0.0);
    let mut spoilt = [clean.clone(), known.clone()];
    spoilt[0][row * COLUMNS..(row + 1) * COLUMNS].fill(f32::NAN);
    spoilt[1][row * KNOWN..row * KNOWN + 4].fill(f32::NAN);
    for (backend, device) in devices() {
        let expected = run(&device, &clean, &known, row_losses);
        let found = run(&device, &spoilt[0], &spoilt[1], row_losses);
        assert_eq!(found, expected, "{backend}");
        assert_eq!(
            found[1][row * COLUMNS..(row + 1) * COLUMNS],
            [0.0; COLUMNS],
            "{backend}"
        );
        let reference = run(&device, &spoilt[0], &spoilt[1], |rows, known, terms| {
            row_losses_reference(rows, known, &terms)
        });
        for (found, reference) in found.iter().zip(&reference) {
            assert_close(backend, found, reference, 1e-5);
        }
    }
}

/// An opacity of 1 that should be 0 has a gradient; colours that are right have none.
#[test]
fn kinks_have_the_gradients_that_training_needs() {
    let (_, device) = devices().into_iter().next().expect("a device");
    let gradient = |row: [f32; COLUMNS], known: [f32; KNOWN], term: usize| {
        let leaf = matrix(&row, COLUMNS, &device).require_grad();
        let loss = row_losses(
            leaf.clone(),
            matrix(&known, KNOWN, &device),
            vec![terms()[term]],
        );
        list(leaf.grad(&loss.sum().backward()).expect("tracked"))
    };
    let (row, known) = (
        [0.5, 0.5, 0.5, 1.0, 1.0, 1.0, 0.0],
        [0.5, 0.5, 0.5, 0.0, 1.0, 1.0],
    );
    assert!((gradient(row, known, 3)[3] - 1000.0).abs() < 1.0);
    for term in [0, 1, 2, 6] {
        assert_eq!(gradient(row, known, term), [0.0; COLUMNS], "term {term}");
    }
    // What is as large as it should be is held there.
    assert_eq!(gradient(row, known, 4)[3], -1.0);
}

/// Columns from one on that only just is a number, which three more are not.
#[test]
fn columns_beyond_all_numbers_are_refused() {
    let (_, device) = devices().into_iter().next().expect("a device");
    let kind = ColourLoss::L2;
    let last = usize::MAX;
    for loss in [
        RowLoss::Colour {
            kind,
            colour: last - 1,
            photo: 0,
        },
        RowLoss::Colour {
            kind,
            colour: 0,
            photo: last,
        },
        RowLoss::Mask {
            opacity: last,
            mask: 0,
        },
        RowLoss::Mask {
            opacity: 0,
            mask: last,
        },
        RowLoss::Shortfall {
            seen: 0,
            most: last,
        },
        RowLoss::Value { column: last },
    ] {
        let (rows, known) = ([0.0; COLUMNS], [0.0; KNOWN]);
        let rows = matrix(&rows, COLUMNS, &device);
        let known = matrix(&known, KNOWN, &device);
        let refused = std::panic::catch_unwind(move || {
            let _ = row_losses(rows, known, vec![RowTerm { loss, weight: 0 }]);
        });
        assert!(refused.is_err(), "{loss:?}");
    }
}

/// A number that is none has no gradient that looks like one.
#[test]
fn poison_is_seen() {
    for (backend, device) in devices() {
        let n = 30;
        let (mut rows, known) = (numbers(n * COLUMNS, 1), numbers(n * KNOWN, 2));
        for (row, column) in [(7, 1), (11, 3), (20, 5)] {
            rows[row * COLUMNS + column] = f32::NAN;
        }
        let [losses, gradient] = run(&device, &rows, &known, row_losses);
        assert!(losses.iter().all(|loss| loss.is_nan()), "{backend}");
        for (i, gradient) in gradient.iter().enumerate() {
            assert_eq!(
                gradient.is_nan(),
                rows[i].is_nan(),
                "column {} of row {}, {backend}: {gradient}",
                i % COLUMNS,
                i / COLUMNS
            );
        }
    }
}

#[test]
#[should_panic(
    expected = "row_losses: RowTerm { loss: Value { column: 7 }, weight: 0 } is of more than 7 columns"
)]
fn a_column_that_is_not_there_is_refused() {
    let (_, device) = devices().into_iter().next().expect("a device");
    let loss = RowLoss::Value { column: COLUMNS };
    let term = RowTerm { loss, weight: 0 };
    let _ = row_losses(
        matrix(&[0.0; 7], COLUMNS, &device),
        matrix(&[0.0; 6], KNOWN, &device),
        vec![term],
    );
}
