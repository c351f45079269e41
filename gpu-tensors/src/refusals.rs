//! Tests, on a device, of what is refused before a kernel, which checks nothing, would read or write beyond its tensors.

use std::panic::{AssertUnwindSafe, catch_unwind};

use burn::backend::DispatchTensorKind;
use burn::tensor::{DType, Tensor};
use burn_cubecl::tensor::CubeTensor;

use crate::adapters::{Adapter, adapters};
use crate::dense::{Packed, WeightReads};
use crate::outer::layer_gradients;
use crate::points::PointMatrix;
use crate::sums::column_sums;
use crate::tensor::{buffer, zeros};

/// A tensor on the device under test; `None` where there is none and that is allowed, as in `tests/gpu_parity`.
fn like() -> Option<CubeTensor> {
    let Some(device) = adapters().iter().find_map(Adapter::device) else {
        assert!(
            std::env::var_os("SOS_REQUIRE_GPU").is_none(),
            "SOS_REQUIRE_GPU is set, but this build finds no device"
        );
        return None;
    };
    let like = Tensor::<1>::zeros([1], &device).into_dispatch();
    match like.kind {
        DispatchTensorKind::Cube(like) => Some(like.float()),
        _ => panic!("the device under test is not CubeCL's"),
    }
}

fn refused<R>(call: impl FnOnce() -> R) -> bool {
    catch_unwind(AssertUnwindSafe(call)).is_err()
}

#[test]
fn memory_of_other_sizes_than_kernels_index() {
    let Some(like) = like() else {
        return;
    };
    let whole = zeros(&like, [2, 3]);
    for (dtype, is_refused) in [
        (DType::F32, false),
        (DType::I32, false),
        (DType::U32, false),
        (DType::F16, true),
        (DType::BF16, true),
        (DType::U8, true),
        (DType::F64, true),
    ] {
        let tensor = CubeTensor {
            dtype,
            ..whole.clone()
        };
        assert_eq!(refused(|| buffer(&tensor)), is_refused, "{dtype:?}");
    }
}

#[test]
fn columns_that_a_matrix_does_not_have() {
    let Some(like) = like() else {
        return;
    };
    let matrix = zeros(&like, [4, 3]);
    assert!(!refused(|| column_sums(&matrix, 1, 2)));
    assert!(refused(|| column_sums(&matrix, 1, 3)));
    assert!(refused(|| column_sums(&matrix, 4, 0)));
    let none = zeros(&like, [0, 3]);
    assert!(refused(|| column_sums(&none, 1, 3)));
}

#[test]
fn layers_that_do_not_fit_their_matrices() {
    let Some(like) = like() else {
        return;
    };
    let (weight, bias) = (zeros(&like, [5, 2]), zeros(&like, [5]));
    let short = zeros(&like, [4]);
    assert!(refused(|| Packed::forward(&weight, &short)));
    let empty = zeros(&like, [5, 0]);
    assert!(refused(|| Packed::forward(&empty, &bias)));
    assert!(refused(|| Packed::backward(&empty)));
    let layer = Packed::forward(&weight, &bias).reading(WeightReads::Cached);
    let x = PointMatrix::zeros(&like, 3, 16);

    assert!(!refused(|| layer.apply_to(&x, 8)));
    assert!(refused(|| layer.apply_to(&x, 24)));
    assert!(refused(|| layer.apply_to(&x, 12)));
    assert!(!refused(|| layer.apply_first(&x, 2)));
    assert!(refused(|| layer.apply_first(&x, 3)));
    assert!(!refused(|| layer.first_outputs(&x, 5)));
    assert!(refused(|| layer.first_outputs(&x, 6)));

    // A gate may have the row of ones that the next layer wants.
    let gate = |rows, points| PointMatrix::zeros(&like, rows, points);
    assert!(!refused(|| layer.gated(&x, &gate(6, 16))));
    assert!(refused(|| layer.gated(&x, &gate(4, 16))));
    assert!(refused(|| layer.gated(&x, &gate(5, 8))));
}

#[test]
fn matrices_of_less_data_than_they_promise() {
    let Some(like) = like() else {
        return;
    };
    let whole = PointMatrix::zeros(&like, 3, 16);
    let layer = Packed::backward(&zeros(&like, [3, 2])).reading(WeightReads::Cached);
    assert!(!refused(|| layer.apply(&whole)));
    assert!(!refused(|| layer_gradients(&whole, &whole)));
    let hollow = PointMatrix {
        data: zeros(&like, [3, 16]),
        ..whole.clone()
    };
    assert!(refused(|| layer.apply(&hollow)));
    assert!(refused(|| layer_gradients(&whole, &hollow)));
    assert!(refused(|| layer_gradients(&hollow, &whole)));
    let rowless = PointMatrix::zeros(&like, 0, 16);
    assert!(refused(|| layer_gradients(&whole, &rowless)));
    assert!(refused(|| PointMatrix::fresh(&like, 3, 12)));
}
