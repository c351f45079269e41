//! `row_losses`: sums, and the gradient of the rows.

use burn::tensor::Device;
use losses::{ColourLoss, RowLoss, RowTerm, row_losses, row_losses_reference};

use crate::support::{
    GRADIENT, Random, VALUE, assert_close, assert_columns_close, assert_same_numbers, gpu, numbers,
    oracle, tensor,
};

/// Columns of the rows, and of what is known of them.
const COLUMNS: usize = 7;
const KNOWN: usize = 6;

fn terms() -> Vec<RowTerm> {
    let colour = |kind| RowLoss::Colour {
        kind,
        colour: 1,
        photo: 0,
    };
    [
        (colour(ColourLoss::L2), 4),
        (colour(ColourLoss::L1), 5),
        (colour(ColourLoss::Huber { delta: 0.2 }), 4),
        (
            RowLoss::Mask {
                opacity: 0,
                mask: 3,
            },
            5,
        ),
        (RowLoss::Shortfall { seen: 0, most: 4 }, 4),
        (RowLoss::Value { column: 5 }, 5),
        (RowLoss::UnitLength { length: 5 }, 4),
        (RowLoss::Sparsity { sdf: 5, tau: 2.5 }, 5),
        (RowLoss::Surface { sdf: 0 }, 4),
    ]
    .map(|(loss, weight)| RowTerm { loss, weight })
    .to_vec()
}

/// Numbers in `[0, 1)`.
fn units(count: usize, seed: u32) -> Vec<f32> {
    let values = Random(seed).list(count);
    values.iter().map(|value| 0.5 * (value + 1.0)).collect()
}

/// The sums, and the gradient of a mix of them.
fn run(rows: &[f32], known: &[f32], device: &Device, kernel: bool) -> [Vec<f64>; 2] {
    let device = &device.clone().autodiff();
    let n = rows.len() / COLUMNS;
    let rows = tensor(rows, [n, COLUMNS], device).require_grad();
    let known = tensor(known, [n, KNOWN], device);
    let sums = if kernel {
        row_losses(rows.clone(), known, terms())
    } else {
        row_losses_reference(rows.clone(), known, &terms())
    };
    let mix = tensor(
        &[1.0, -2.0, 0.5, 3.0, 1.5, -0.7, 0.2, -1.2, 0.8],
        [9],
        device,
    );
    let gradients = (sums.clone() * mix).sum().backward();
    let gradient = rows.grad(&gradients).map(numbers).unwrap_or_default();
    [numbers(sums), gradient]
}

/// One row, about a workgroup's, more than one workgroup takes, and more than all take at once.
#[test]
fn sums_and_gradients_are_the_references() {
    let Some(gpu) = gpu() else {
        return;
    };
    for n in [1, 255, 1025, 70_001] {
        let (rows, known) = (units(n * COLUMNS, 1), units(n * KNOWN, 2));
        let [sums, gradient] = run(&rows, &known, &gpu, true);
        let [expected_sums, expected_gradient] = run(&rows, &known, &oracle(), false);
        for (t, (found, expected)) in sums.iter().zip(&expected_sums).enumerate() {
            let what = format!("term {t} of {n} rows");
            assert_close(&what, &[*found], &[*expected], VALUE);
        }
        let what = format!("gradient of {n} rows");
        assert_columns_close(&what, &gradient, &expected_gradient, COLUMNS, GRADIENT);
    }
}

/// More terms than a workgroup adds up at once, and more than it has threads.
#[test]
fn there_may_be_many_terms() {
    let Some(gpu) = gpu() else {
        return;
    };
    let n = 5000;
    let (rows, known) = (units(n * COLUMNS, 3), units(n * KNOWN, 4));
    let on = |device: &Device| {
        let rows = tensor(&rows, [n, COLUMNS], device);
        (rows, tensor(&known, [n, KNOWN], device))
    };
    let (rows_there, known_there) = on(&oracle());
    let few = numbers(row_losses_reference(rows_there, known_there, &terms()));
    for count in [17, 300] {
        let (rows_there, known_there) = on(&gpu);
        let terms = terms().into_iter().cycle().take(count).collect();
        let many = numbers(row_losses(rows_there, known_there, terms));
        assert_eq!(many.len(), count);
        for (t, sum) in many.iter().enumerate() {
            let what = format!("term {t} of {count}");
            assert_close(&what, &[*sum], &[few[t % few.len()]], VALUE);
        }
    }
}

#[test]
fn there_may_be_no_rows() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [sums, gradient] = run(&[], &[], &gpu, true);
    assert_eq!(sums, [0.0; 9]);
    assert!(gradient.is_empty());
}

/// A number that is none makes the sums of its terms none, and no gradient but its own row's.
#[test]
fn poison_stays_where_it_is() {
    let Some(gpu) = gpu() else {
        return;
    };
    let n = 300;
    let (mut rows, known) = (units(n * COLUMNS, 1), units(n * KNOWN, 2));
    for (row, column) in [(20, 2), (130, 5), (260, 0)] {
        rows[row * COLUMNS + column] = f32::NAN;
    }
    let [sums, gradient] = run(&rows, &known, &gpu, true);
    let [expected_sums, expected_gradient] = run(&rows, &known, &oracle(), false);
    assert!(sums.iter().all(|sum| sum.is_nan()));
    assert_same_numbers("sums", &sums, &expected_sums, VALUE);
    assert_same_numbers("gradient", &gradient, &expected_gradient, GRADIENT);
}

/// A row of weight 0 is not there, whatever it and what is known of it are.
#[test]
fn rows_without_weight_are_ignored_even_where_they_are_no_numbers() {
    let Some(gpu) = gpu() else {
        return;
    };
    let (n, row) = (300, 130);
    let (clean, mut known) = (units(n * COLUMNS, 1), units(n * KNOWN, 2));
    known[row * KNOWN + 4..(row + 1) * KNOWN].fill(0.0);
    let [expected_sums, expected_gradient] = run(&clean, &known, &oracle(), false);
    let mut rows = clean;
    rows[row * COLUMNS..(row + 1) * COLUMNS].fill(f32::NAN);
    known[row * KNOWN..row * KNOWN + 4].fill(f32::NAN);
    let [sums, gradient] = run(&rows, &known, &gpu, true);
    assert_close("sums", &sums, &expected_sums, VALUE);
    assert_columns_close("gradient", &gradient, &expected_gradient, COLUMNS, GRADIENT);
}
