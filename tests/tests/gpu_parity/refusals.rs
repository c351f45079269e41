//! What ops refuse on a GPU, whose kernels check nothing, when they are called past their public functions.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use burn::backend::Cube;
use gpu_tensors::CubeTensor;
use hashgrid::{GridConfig, GridLayout};
use losses::row_losses::RowLossesOps;
use losses::{RowLoss, RowTerm};
use neus_render::composite::{CompositeConfig, CompositeOps, Packing};
use scene_decomp::colour_field::{ColourFieldOps, Output};
use scene_decomp::sdf_field::{Forward, Normal, SdfFieldConfig, SdfFieldOps};

use crate::support::{gpu, on_gpu};

fn refused<R>(call: impl FnOnce() -> R) -> bool {
    catch_unwind(AssertUnwindSafe(call)).is_err()
}

/// Ones on the device under test.
fn ones<const D: usize>(shape: [usize; D]) -> CubeTensor {
    on_gpu(&vec![1.0; shape.iter().product()], shape).unwrap()
}

#[test]
fn composite_refuses_rows_that_are_not_its_packings() {
    if gpu().is_none() {
        return;
    }
    // A ray of two intervals, of which the object has both and the background one.
    let ask = |object: [usize; 2], background: [usize; 2], sharpness: [usize; 1]| {
        let packing = Packing::new(
            vec![0, 2],
            vec![1.0, 2.0],
            vec![1.0; 2],
            vec![0, 1],
            vec![1],
        );
        refused(|| {
            <Cube as CompositeOps>::composite(
                ones(object),
                ones(background),
                ones(sharpness),
                Arc::new(packing),
                CompositeConfig::default(),
            )
        })
    };
    assert!(!ask([2, 6], [1, 5], [2]));
    assert!(!ask([2, 7], [1, 6], [2]));
    assert!(ask([1, 6], [1, 5], [2]));
    assert!(ask([2, 5], [1, 5], [2]));
    assert!(ask([2, 6], [2, 5], [2]));
    assert!(ask([2, 6], [1, 4], [2]));
    assert!(ask([2, 6], [1, 5], [1]));
}

#[test]
fn row_losses_refuse_columns_that_are_not_there() {
    if gpu().is_none() {
        return;
    }
    let ask = |rows: [usize; 2], known: [usize; 2], column: usize, weight: usize| {
        let loss = RowLoss::Value { column };
        let terms = vec![RowTerm { loss, weight }];
        refused(|| <Cube as RowLossesOps>::row_losses(ones(rows), ones(known), terms))
    };
    assert!(!ask([3, 2], [3, 1], 1, 0));
    assert!(ask([3, 2], [3, 1], 2, 0));
    assert!(ask([3, 2], [3, 1], 1, 1));
    assert!(ask([3, 2], [2, 1], 1, 0));
}

#[test]
fn sdf_field_refuses_shapes_of_another_layout() {
    if gpu().is_none() {
        return;
    }
    let layout = Arc::new(GridLayout::new(&GridConfig {
        levels: 2,
        base_resolution: 4,
        finest_resolution: 8,
        ..GridConfig::default()
    }));
    let entries = layout.entries();
    let ask = |points: [usize; 2], table: usize, w1: [usize; 2], w2: [usize; 2], active: usize| {
        let config = SdfFieldConfig {
            layout: layout.clone(),
            active_levels: active,
            half_side: 1.0,
            beta: 20.0,
            normal: Normal::Computed,
            sparse: None,
            forward: Forward::Alone,
        };
        refused(|| {
            let (b1, b2) = (ones([w1[0]]), ones([w2[0]]));
            let (points, table) = (ones(points), ones([table, 2]));
            <Cube as SdfFieldOps>::sdf_field(points, table, ones(w1), b1, ones(w2), b2, config)
        })
    };
    assert!(!ask([9, 3], entries, [8, 7], [4, 8], 2));
    assert!(ask([9, 2], entries, [8, 7], [4, 8], 2));
    assert!(ask([9, 3], entries - 8, [8, 7], [4, 8], 2));
    assert!(ask([9, 3], entries, [8, 6], [4, 8], 2));
    assert!(ask([9, 3], entries, [8, 7], [4, 7], 2));
    assert!(ask([9, 3], entries, [8, 7], [4, 8], 3));
}

#[test]
fn colour_field_refuses_shapes_that_do_not_fit() {
    if gpu().is_none() {
        return;
    }
    let ask = |geometry: [usize; 2], points: usize, stretch: [usize; 2], w2: [usize; 2]| {
        refused(|| {
            <Cube as ColourFieldOps>::colour_field(
                ones(geometry),
                ones([points, 3]),
                ones([points, 3]),
                ones([points, 1]),
                ones(stretch),
                ones([8, 12]),
                ones([8]),
                ones(w2),
                ones([w2[0]]),
                ones([3, 8]),
                ones([3]),
                Output::Colour,
            )
        })
    };
    assert!(!ask([9, 5], 9, [9, 1], [8, 8]));
    assert!(ask([9, 4], 9, [9, 1], [8, 8]));
    assert!(ask([9, 5], 8, [9, 1], [8, 8]));
    assert!(ask([9, 5], 9, [8, 1], [8, 8]));
    assert!(ask([9, 5], 9, [9, 1], [8, 7]));
}
