//! `sdf_field`, with normals and without.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout, Hash, Interpolation, SparseGrad, TableReads};
use scene_decomp::sdf_field::{
    Forward, Normal, SdfFieldConfig, SdfFieldWeights, Tape, reference, sdf_field,
};

use crate::support::{
    GRADIENT, Random, VALUE, WithoutNativeSums, assert_columns_close, assert_equal_but_for_row,
    assert_same_numbers, gpu, halved, most_at_once, numbers, oracle, tensor,
};

const OUTPUTS: usize = 16;
/// Outputs and the normal.
const COLUMNS: usize = OUTPUTS + 3;

#[derive(Clone, Copy, Debug)]
struct Case {
    n: usize,
    active: usize,
    normal: Normal,
    levels: usize,
    hidden: usize,
    interpolation: Interpolation,
    hash: Hash,
    reads: TableReads,
}

impl Default for Case {
    /// A part of a workgroup.
    fn default() -> Self {
        Self {
            n: 65,
            active: 5,
            normal: Normal::Computed,
            levels: 5,
            hidden: 64,
            interpolation: Interpolation::Linear,
            hash: Hash::Nodes,
            reads: TableReads::Single,
        }
    }
}

impl Case {
    fn layout(&self) -> Arc<GridLayout> {
        Arc::new(GridLayout::new(&GridConfig {
            levels: self.levels,
            base_resolution: 4,
            finest_resolution: 40,
            log2_table_size: 10,
            interpolation: self.interpolation,
            hash: self.hash,
            device_reads: self.reads,
            ..GridConfig::default()
        }))
    }

    fn config(&self, sparse: Option<SparseGrad>) -> SdfFieldConfig {
        SdfFieldConfig {
            layout: self.layout(),
            active_levels: self.active,
            half_side: 2.0,
            beta: 20.0,
            normal: self.normal,
            sparse,
            forward: Forward::Alone,
        }
    }

    /// With the table as kernels on GPUs read it, if wanted.
    fn weights(&self, device: &Device, as_read: bool) -> SdfFieldWeights {
        let mut random = Random(7);
        let (inputs, hidden) = (3 + 2 * self.levels, self.hidden);
        let mut scaled = |count: usize, scale: f32| -> Vec<f32> {
            random.list(count).iter().map(|v| scale * v).collect()
        };
        let entries = self.layout().entries();
        let mut table = scaled(2 * entries, 0.3);
        if as_read && self.reads == TableReads::Half {
            table.iter_mut().for_each(|value| *value = halved(*value));
        }
        SdfFieldWeights {
            table: tensor(&table, [entries, 2], device).require_grad(),
            w1: tensor(&scaled(hidden * inputs, 0.4), [hidden, inputs], device).require_grad(),
            b1: tensor(&scaled(hidden, 0.2), [hidden], device).require_grad(),
            w2: tensor(&scaled(OUTPUTS * hidden, 0.3), [OUTPUTS, hidden], device).require_grad(),
            b2: tensor(&scaled(OUTPUTS, 0.2), [OUTPUTS], device).require_grad(),
        }
    }

    /// The value, then the gradients of table, w1, b1, w2 and b2.
    fn run(&self, device: &Device, kernel: bool, sparse: Option<SparseGrad>) -> Vec<Vec<f64>> {
        self.run_at(
            &Random(11).coordinates(3 * self.n, 2.0),
            device,
            kernel,
            sparse,
        )
    }

    fn run_at(
        &self,
        points: &[f32],
        device: &Device,
        kernel: bool,
        sparse: Option<SparseGrad>,
    ) -> Vec<Vec<f64>> {
        let device = &device.clone().autodiff();
        let (n, columns) = (self.n, COLUMNS);
        let points = tensor(points, [n, 3], device);
        let weights = self.weights(device, !kernel);
        let config = self.config(sparse.clone());
        let op = if kernel {
            sdf_field
        } else {
            reference::sdf_field
        };
        let out = op(points, weights.clone(), config);
        let upstream = tensor(&Random(12).list(n * columns), [n, columns], device);
        let grads = out.clone().mul(upstream).sum().backward();
        let table = match sparse {
            Some(sparse) => {
                assert!(weights.table.grad(&grads).is_none());
                sparse.to_dense().into_iter().map(f64::from).collect()
            }
            None => numbers(weights.table.grad(&grads).unwrap()),
        };
        vec![
            numbers(out),
            table,
            numbers(weights.w1.grad(&grads).unwrap()),
            numbers(weights.b1.grad(&grads).unwrap()),
            numbers(weights.w2.grad(&grads).unwrap()),
            numbers(weights.b2.grad(&grads).unwrap()),
        ]
    }

    fn check(&self, found: &[Vec<f64>], expected: &[Vec<f64>]) {
        let parts = [
            ("value", COLUMNS),
            ("table", 2),
            ("w1", 3 + 2 * self.levels),
            ("b1", 1),
            ("w2", self.hidden),
            ("b2", 1),
        ];
        for (((name, columns), found), expected) in parts.iter().zip(found).zip(expected) {
            let what = format!("{name}, {self:?}");
            let tolerance = if *name == "value" { VALUE } else { GRADIENT };
            assert_columns_close(&what, found, expected, *columns, tolerance);
        }
    }
}

fn cases() -> [Case; 9] {
    let zero = Case {
        normal: Normal::Zero,
        ..Case::default()
    };
    let many = Case {
        n: 300,
        ..Case::default()
    };
    let levels = Case {
        active: 9,
        levels: 9,
        hash: Hash::Blocks,
        ..many
    };
    [
        Case {
            n: 1,
            ..Case::default()
        },
        Case {
            active: 2,
            hash: Hash::Blocks,
            ..zero
        },
        Case { active: 3, ..many },
        levels,
        Case { n: 1000, ..zero },
        Case {
            active: 2,
            reads: TableReads::Half,
            ..zero
        },
        Case {
            reads: TableReads::Half,
            ..levels
        },
        Case {
            interpolation: Interpolation::Smoothstep,
            ..many
        },
        Case {
            interpolation: Interpolation::Smoothstep,
            reads: TableReads::Half,
            ..levels
        },
    ]
}

#[test]
fn values_and_gradients_are_the_references() {
    let Some(gpu) = gpu() else {
        return;
    };
    for case in cases() {
        let found = case.run(&gpu, true, None);
        case.check(&found, &case.run(&oracle(), false, None));
    }
}

/// Where a device has no instruction to add to an `f32` that others add to as well.
#[test]
fn gradients_are_the_same_by_compare_and_swap() {
    let Some(gpu) = gpu() else {
        return;
    };
    let _without = WithoutNativeSums::new();
    let [_, _, case, ..] = cases();
    let found = case.run(&gpu, true, None);
    case.check(&found, &case.run(&oracle(), false, None));
}

#[test]
fn a_sparse_gradient_collects_from_call_to_call() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [_, _, case, ..] = cases();
    let sparse = SparseGrad::new(&case.layout());
    let mut expected = case.run(&oracle(), false, None);
    let found = case.run(&gpu, true, Some(sparse.clone()));
    case.check(&found, &expected);
    let found = case.run(&gpu, true, Some(sparse.clone()));
    for value in &mut expected[1] {
        *value *= 2.0;
    }
    case.check(&found, &expected);
    // What the host reads has left the device: nothing is counted twice.
    sparse.drain(|_, _| {});
    assert!(sparse.to_dense().iter().all(|value| *value == 0.0));
}

#[test]
fn more_points_than_are_taken_at_once() {
    let Some(gpu) = gpu() else {
        return;
    };
    let case = Case {
        n: (1 << 17) + 77,
        active: 2,
        levels: 2,
        hidden: 8,
        hash: Hash::Blocks,
        ..Case::default()
    };
    assert!(case.n > most_at_once(&gpu), "one part");
    // Against the CPU kernel, which has its own test against the reference.
    let found = case.run(&gpu, true, None);
    case.check(&found, &case.run(&Device::flex(), true, None));
}

/// A GPU writes nothing down, and computes what would be taken from an empty tape.
#[test]
fn a_tape_stays_empty_and_is_done_without() {
    let Some(gpu) = gpu() else {
        return;
    };
    let case = Case::default();
    let device = &gpu.autodiff();
    let points = tensor(
        &Random(11).coordinates(3 * case.n, 2.0),
        [case.n, 3],
        device,
    );
    let weights = case.weights(device, false);
    let config = |forward| SdfFieldConfig {
        forward,
        ..case.config(None)
    };
    let tape = Tape::default();
    let constants = SdfFieldWeights {
        table: weights.table.clone().inner(),
        w1: weights.w1.clone().inner(),
        b1: weights.b1.clone().inner(),
        w2: weights.w2.clone().inner(),
        b2: weights.b2.clone().inner(),
    };
    let taped = config(Forward::Taped(tape.clone()));
    let looked = sdf_field(points.clone().inner(), constants, taped);
    let rows = tape.finish();
    assert!(rows.is_empty());
    let learnt = sdf_field(points, weights, config(Forward::FromTape(rows)));
    assert_eq!(numbers(looked), numbers(learnt));
}

#[test]
fn no_points_give_no_rows_and_zero_gradients() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [mut case, ..] = cases();
    case.n = 0;
    let found = case.run(&gpu, true, None);
    assert!(found[0].is_empty());
    for gradient in &found[1..] {
        assert!(!gradient.is_empty() && gradient.iter().all(|value| *value == 0.0));
    }
}

/// A point that is no number has a row that is none. No other row knows of it, nor do entries of the table
/// in other cells.
#[test]
fn a_point_that_is_no_number_spoils_its_own_row_alone() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [_, _, case, ..] = cases();
    let row = 70;
    let clean = Random(11).coordinates(3 * case.n, 2.0);
    let mut points = clean.clone();
    points[3 * row + 1] = f32::NAN;
    let found = case.run_at(&points, &gpu, true, None);
    let without = case.run_at(&clean, &gpu, true, None);
    assert_equal_but_for_row("value", &found[0], &without[0], COLUMNS, row);
    assert!(
        found[0][COLUMNS * row..COLUMNS * (row + 1)]
            .iter()
            .any(|v| v.is_nan())
    );
    let expected = case.run_at(&points, &Device::flex(), true, None);
    let spoilt = found[1].iter().filter(|value| value.is_nan()).count();
    assert!(spoilt > 0 && spoilt <= 16 * case.active, "{spoilt} values");
    assert_same_numbers("table", &found[1], &expected[1], GRADIENT);
}
