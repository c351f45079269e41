//! `sdf_field`, with normals and without.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout, Hash, SparseGrad, TableReads};
use scene_decomp::sdf_field::{
    Forward, Normal, SdfFieldConfig, SdfFieldWeights, reference, sdf_field,
};

use crate::support::{
    GRADIENT, Random, VALUE, WithoutNativeSums, assert_columns_close, assert_equal_but_for_row,
    assert_same_numbers, gpu, halved, numbers, oracle, tensor,
};

const HIDDEN: usize = 64;
const OUTPUTS: usize = 16;
/// Outputs and the normal.
const COLUMNS: usize = OUTPUTS + 3;

struct Case {
    n: usize,
    active: usize,
    normal: Normal,
    levels: usize,
    hash: Hash,
    reads: TableReads,
}

impl Case {
    fn layout(&self) -> Arc<GridLayout> {
        Arc::new(GridLayout::new(&GridConfig {
            levels: self.levels,
            base_resolution: 4,
            finest_resolution: 40,
            log2_table_size: 10,
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
        let inputs = 3 + 2 * self.levels;
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
            w1: tensor(&scaled(HIDDEN * inputs, 0.4), [HIDDEN, inputs], device).require_grad(),
            b1: tensor(&scaled(HIDDEN, 0.2), [HIDDEN], device).require_grad(),
            w2: tensor(&scaled(OUTPUTS * HIDDEN, 0.3), [OUTPUTS, HIDDEN], device).require_grad(),
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
            ("w2", HIDDEN),
            ("b2", 1),
        ];
        for (((name, columns), found), expected) in parts.iter().zip(found).zip(expected) {
            let what = format!(
                "{name}, {} points, {} of {} levels, {:?}, {:?}, {:?}",
                self.n, self.active, self.levels, self.normal, self.hash, self.reads
            );
            let tolerance = if *name == "value" { VALUE } else { GRADIENT };
            assert_columns_close(&what, found, expected, *columns, tolerance);
        }
    }
}

fn cases() -> [Case; 7] {
    [
        (1, 5, Normal::Computed, 5, Hash::Nodes, TableReads::Single),
        (65, 2, Normal::Zero, 5, Hash::Blocks, TableReads::Single),
        (300, 3, Normal::Computed, 5, Hash::Nodes, TableReads::Single),
        (
            300,
            9,
            Normal::Computed,
            9,
            Hash::Blocks,
            TableReads::Single,
        ),
        (1000, 5, Normal::Zero, 5, Hash::Nodes, TableReads::Single),
        (65, 2, Normal::Zero, 5, Hash::Nodes, TableReads::Half),
        (300, 9, Normal::Computed, 9, Hash::Blocks, TableReads::Half),
    ]
    .map(|(n, active, normal, levels, hash, reads)| Case {
        n,
        active,
        normal,
        levels,
        hash,
        reads,
    })
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
fn more_points_than_one_chunk_of_rows() {
    let Some(gpu) = gpu() else {
        return;
    };
    let case = Case {
        n: 33_000,
        active: 3,
        normal: Normal::Computed,
        levels: 3,
        hash: Hash::Blocks,
        reads: TableReads::Single,
    };
    // Against the CPU kernel, which has its own test against the reference.
    let found = case.run(&gpu, true, None);
    case.check(&found, &case.run(&Device::flex(), true, None));
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
