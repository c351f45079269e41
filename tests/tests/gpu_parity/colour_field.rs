//! `colour_field`, with further inputs and without.

use burn::tensor::Device;
use scene_decomp::colour_field::{
    ColourFieldInputs, ColourFieldWeights, Reading, RowConfig, colour_field, reference, row_column,
    sample_rows,
};

use crate::support::{
    GRADIENT, Random, VALUE, assert_columns_close, assert_equal_but_for_row, gpu, most_at_once,
    numbers, oracle, tensor,
};

const COLUMNS: usize = 19;

/// How many points and columns there are, and what is asked for.
#[derive(Clone, Copy, Debug)]
struct Case {
    n: usize,
    extra: usize,
    hidden: usize,
    outputs: usize,
    /// Added to all first columns of the geometry.
    raw: f32,
    /// Rows for compositing, with stretched densities or without; colours where none.
    rows: Option<(RowConfig, usize)>,
    /// A point and a column of its geometry that is no number.
    spoilt: Option<(usize, usize)>,
}

impl Case {
    fn colours(n: usize, extra: usize, outputs: usize) -> Self {
        Self {
            n,
            extra,
            hidden: 64,
            outputs,
            raw: 0.0,
            rows: None,
            spoilt: None,
        }
    }

    /// Of what [`run`] returns by that name.
    fn columns(&self, name: &str) -> usize {
        match name {
            "value" => self.outputs + if self.rows.is_some() { 3 } else { 0 },
            "geometry" => COLUMNS,
            "w1" => 6 + COLUMNS + self.extra,
            "w2" | "w3" => self.hidden,
            _ => 1,
        }
    }

    fn rows(self, reading: Reading, view_share: f32, stretch: usize) -> Self {
        let config = RowConfig {
            reading,
            view_share,
        };
        Self {
            rows: Some((config, stretch)),
            ..self
        }
    }

    fn raw(self, raw: f32) -> Self {
        Self { raw, ..self }
    }

    fn check(&self, found: &[Vec<f64>], expected: &[Vec<f64>]) {
        for ((name, found), expected) in NAMES.iter().zip(found).zip(expected) {
            let tolerance = if *name == "value" { VALUE } else { GRADIENT };
            let what = format!("{name}, {self:?}");
            assert_columns_close(&what, found, expected, self.columns(name), tolerance);
        }
    }
}

/// The value, then the gradients of geometry, w1, b1, w2, b2, w3 and b3.
fn run(device: &Device, case: Case, kernel: bool) -> Vec<Vec<f64>> {
    let Case {
        n,
        extra,
        hidden,
        outputs,
        ..
    } = case;
    let device = &device.clone().autodiff();
    let mut random = Random(31);
    let mut scaled = |count: usize, scale: f32| -> Vec<f32> {
        random.list(count).iter().map(|v| scale * v).collect()
    };
    let inputs = 6 + COLUMNS + extra;
    let mut layer = |outputs: usize, inputs: usize| {
        let weight = scaled(outputs * inputs, (2.0 / inputs as f32).sqrt());
        (
            tensor(&weight, [outputs, inputs], device).require_grad(),
            tensor(&scaled(outputs, 0.1), [outputs], device).require_grad(),
        )
    };
    let (w1, b1) = layer(hidden, inputs);
    let (w2, b2) = layer(hidden, hidden);
    let (w3, b3) = layer(outputs, hidden);
    let mut geometry = scaled(n * COLUMNS, 1.0);
    for row in geometry.chunks_exact_mut(COLUMNS) {
        row[0] += case.raw;
    }
    if let Some((row, column)) = case.spoilt {
        geometry[row * COLUMNS + column] = f32::NAN;
    }
    let geometry = tensor(&geometry, [n, COLUMNS], device).require_grad();
    let mut matrix = |columns: usize| tensor(&scaled(n * columns, 1.0), [n, columns], device);
    let at = ColourFieldInputs {
        geometry: geometry.clone(),
        points: matrix(3),
        directions: matrix(3),
        extra: matrix(extra),
    };
    let upstream = matrix(outputs + if case.rows.is_some() { 3 } else { 0 });
    let weights = ColourFieldWeights {
        w1: w1.clone(),
        b1: b1.clone(),
        w2: w2.clone(),
        b2: b2.clone(),
        w3: w3.clone(),
        b3: b3.clone(),
    };
    let out = match case.rows {
        None if kernel => colour_field(at, weights),
        None => reference::colour_field(at, weights),
        Some((config, columns)) => {
            let stretch = matrix(columns).abs();
            if kernel {
                sample_rows(at, stretch, weights, config)
            } else {
                reference::sample_rows(at, stretch, weights, config)
            }
        }
    };
    let grads = out.clone().mul(upstream).sum().backward();
    vec![
        numbers(out),
        numbers(geometry.grad(&grads).unwrap()),
        numbers(w1.grad(&grads).unwrap()),
        numbers(b1.grad(&grads).unwrap()),
        numbers(w2.grad(&grads).unwrap()),
        numbers(b2.grad(&grads).unwrap()),
        numbers(w3.grad(&grads).unwrap()),
        numbers(b3.grad(&grads).unwrap()),
    ]
}

const NAMES: [&str; 8] = ["value", "geometry", "w1", "b1", "w2", "b2", "w3", "b3"];

#[test]
fn values_and_gradients_are_the_references() {
    let Some(gpu) = gpu() else {
        return;
    };
    for case in [
        Case::colours(1, 1, 3),
        Case::colours(65, 0, 4),
        Case::colours(1000, 1, 3),
        Case::colours(65, 0, 4).rows(Reading::Distance, 0.25, 0),
        Case::colours(300, 1, 3).rows(Reading::Density, 1.0, 1),
        Case::colours(1, 1, 3).rows(Reading::Density, 0.0, 0),
        // At both ends of what densities may be, where they have no gradient.
        Case::colours(65, 0, 3)
            .rows(Reading::Density, 1.0, 1)
            .raw(20.0),
        Case::colours(65, 0, 3)
            .rows(Reading::Density, 1.0, 0)
            .raw(-20.0),
    ] {
        case.check(&run(&gpu, case, true), &run(&oracle(), case, false));
    }
}

#[test]
fn more_points_than_are_taken_at_once() {
    let Some(gpu) = gpu() else {
        return;
    };
    let case = Case {
        hidden: 8,
        ..Case::colours((1 << 17) + 77, 1, 3).rows(Reading::Density, 1.0, 1)
    };
    assert!(case.n > most_at_once(&gpu), "one part");
    // Against the CPU kernel, which has its own test against the reference.
    case.check(&run(&gpu, case, true), &run(&Device::flex(), case, true));
}

/// A point that is no number spoils what comes of it, forward and backward, and no other point's.
#[test]
fn a_point_that_is_no_number_spoils_its_own_row_alone() {
    let Some(gpu) = gpu() else {
        return;
    };
    let clean = Case::colours(130, 1, 3);
    for (clean, column) in [
        (clean, 5),
        (clean.rows(Reading::Distance, 0.25, 0), 5),
        (clean.rows(Reading::Density, 1.0, 1), 0),
    ] {
        let row = 70;
        let spoilt = Case {
            spoilt: Some((row, column)),
            ..clean
        };
        let (found, without) = (run(&gpu, spoilt, true), run(&gpu, clean, true));
        for (i, name) in ["value", "geometry"].iter().enumerate() {
            let columns = clean.columns(name);
            assert_equal_but_for_row(name, &found[i], &without[i], columns, row);
        }
        let columns = clean.columns("value");
        let own = &found[0][columns * row..columns * (row + 1)];
        assert!(own.iter().any(|value| value.is_nan()), "{own:?}");
        // A density that is no number is no empty space.
        assert!(column > 0 || own[row_column::FIRST].is_nan(), "{own:?}");
    }
}

#[test]
fn no_points_give_no_rows_and_zero_gradients() {
    let Some(gpu) = gpu() else {
        return;
    };
    let found = run(&gpu, Case::colours(0, 1, 3), true);
    assert!(found[0].is_empty() && found[1].is_empty());
    for gradient in &found[2..] {
        assert!(!gradient.is_empty() && gradient.iter().all(|value| *value == 0.0));
    }
}
