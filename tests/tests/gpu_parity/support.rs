//! Devices, numbers and comparisons.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use burn::tensor::{Device, FloatDType, Tensor, TensorData};
use gpu_tensors::{CubeTensor, from_slice, points_at_once};

use crate::say;

/// What values of an op may differ by, as a part of the largest.
pub(crate) const VALUE: f64 = 1e-4;
/// The same for gradients.
pub(crate) const GRADIENT: f64 = 1e-3;

/// What the tests run on.
#[derive(Clone)]
pub(crate) struct UnderTest {
    /// Without autodiff.
    pub(crate) device: Device,
    /// What the command line calls it.
    pub(crate) option: &'static str,
    name: String,
}

/// The device under test, without autodiff: hardware where there is some, else lavapipe.
///
/// `None`, with the reason printed, where there is none at all and that is allowed.
pub(crate) fn gpu() -> Option<Device> {
    under_test().map(|found| found.device)
}

/// [`gpu`], and how to ask for it.
pub(crate) fn under_test() -> Option<UnderTest> {
    static FOUND: OnceLock<Option<UnderTest>> = OnceLock::new();
    FOUND
        .get_or_init(|| {
            gpu_tensors::poison_fresh_memory(true);
            let found = devices().into_iter().next();
            if let Some(found) = &found {
                say(&format!("on {}", found.name));
                return Some(found.clone());
            }
            assert!(
                std::env::var_os("SOS_REQUIRE_GPU").is_none(),
                "SOS_REQUIRE_GPU is set, but this build finds no device; for wgpu, Mesa's lavapipe \
                 (package mesa-vulkan-drivers) stands in for one"
            );
            say("skipped: this build finds no GPU");
            None
        })
        .clone()
}

/// The devices that this build can use; those of CUDA first.
fn devices() -> Vec<UnderTest> {
    let mut devices = Vec::new();
    #[cfg(feature = "cuda")]
    for device in Device::enumerate(burn::tensor::DeviceType::Cuda).iter() {
        devices.push(UnderTest {
            device: device.clone(),
            option: "cuda",
            name: "CUDA".to_owned(),
        });
    }
    #[cfg(feature = "wgpu")]
    for adapter in gpu_tensors::adapters() {
        if let Some(device) = adapter.device() {
            devices.push(UnderTest {
                device,
                option: "wgpu",
                name: format!("{} ({})", adapter.name, adapter.kind),
            });
        }
    }
    devices
}

/// While this lives, kernels add to sums of `f32` by compare and swap, as on devices without an
/// instruction for it. Other tests may run meanwhile: their sums are the same.
pub(crate) struct WithoutNativeSums(#[allow(dead_code)] MutexGuard<'static, ()>);

impl WithoutNativeSums {
    pub(crate) fn new() -> Self {
        let guard = native_sums();
        gpu_tensors::refuse_native_sums(true);
        Self(guard)
    }
}

impl Drop for WithoutNativeSums {
    fn drop(&mut self) {
        gpu_tensors::refuse_native_sums(false);
    }
}

/// Held while it matters how sums are added to.
pub(crate) fn native_sums() -> MutexGuard<'static, ()> {
    static SWITCH: Mutex<()> = Mutex::new(());
    SWITCH.lock().unwrap_or_else(PoisonError::into_inner)
}

/// NdArray in double precision, for references alone.
pub(crate) fn oracle() -> Device {
    static DEVICE: OnceLock<Device> = OnceLock::new();
    DEVICE
        .get_or_init(|| {
            let mut device = Device::ndarray();
            device.configure(FloatDType::F64).unwrap();
            let third = tensor(&[1.0], [1], &device) / tensor(&[3.0], [1], &device);
            assert!((numbers(third)[0] - 1.0 / 3.0).abs() < 1e-15, "in f64");
            device
        })
        .clone()
}

/// A seeded generator of numbers in `[-1, 1)`.
pub(crate) struct Random(pub(crate) u32);

impl Random {
    pub(crate) fn signed(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    pub(crate) fn list(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| self.signed()).collect()
    }

    /// Coordinates in `[-half_side, half_side)` of so few digits that cells are found without
    /// rounding, in single precision as in double.
    pub(crate) fn coordinates(&mut self, count: usize, half_side: f32) -> Vec<f32> {
        (0..count)
            .map(|_| ((self.signed() * 1024.0).floor() + 0.5) / 1024.0 * half_side)
            .collect()
    }
}

/// The nearest number that IEEE's binary16 has, ties to even: what is left of a table's value in half precision.
pub(crate) fn halved(value: f32) -> f32 {
    let value = f64::from(value);
    // Numbers between 2^e and 2^(e + 1) are 2^(e - 10) apart, and the smallest ones as those above 2^-14.
    let exponent = value.abs().log2().floor().max(-14.0);
    let spacing = (exponent - 10.0).exp2();
    let nearest = (value / spacing).round_ties_even() * spacing;
    let largest = 65_504.0;
    if nearest.abs() > largest {
        (nearest * f64::INFINITY) as f32
    } else {
        nearest as f32
    }
}

/// A tensor in the device's own precision.
pub(crate) fn tensor<const D: usize>(
    values: &[f32],
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    let values: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// A tensor of the device under test, as kernels see it.
pub(crate) fn on_gpu<const D: usize>(values: &[f32], shape: [usize; D]) -> Option<CubeTensor> {
    // By way of Burn for the client; then a tensor of its own.
    let like = cube_tensor(tensor(&[0.0], [1], &gpu()?));
    Some(from_slice(&like, values, shape))
}

fn cube_tensor<const D: usize>(tensor: Tensor<D>) -> CubeTensor {
    let burn::backend::DispatchTensorKind::Cube(tensor) = tensor.into_dispatch().kind else {
        panic!("the device under test is not CubeCL's");
    };
    tensor.float()
}

/// The most points that an op takes at once on a device, however little it needs for each.
pub(crate) fn most_at_once(device: &Device) -> usize {
    points_at_once(&cube_tensor(tensor(&[0.0], [1], device)), 1)
}

/// A tensor's values.
pub(crate) fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor
        .into_data()
        .convert::<f64>()
        .try_to_vec::<f64>()
        .unwrap()
}

/// Asserts that no value differs from the expected one by more than `tolerance` times the largest
/// expected one.
pub(crate) fn assert_close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_columns_close(what, found, expected, 1, tolerance);
}

/// [`assert_close`] for each column of a row-major matrix by itself: one of small values cannot hide
/// behind one of large ones.
pub(crate) fn assert_columns_close(
    what: &str,
    found: &[f64],
    expected: &[f64],
    columns: usize,
    tolerance: f64,
) {
    assert_eq!(found.len(), expected.len(), "{what}: number of values");
    assert_eq!(expected.len() % columns, 0, "{what}: columns");
    let mut scales = vec![0.0f64; columns];
    for row in expected.chunks_exact(columns) {
        for (scale, value) in scales.iter_mut().zip(row) {
            *scale = scale.max(value.abs());
        }
    }
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let largest = scales[i % columns];
        let scale = if largest > 0.0 { largest } else { 1.0 };
        let error = (f - e).abs() / scale;
        assert!(
            error <= tolerance,
            "{what}[{}, {}]: {f} instead of {e}, an error of {error:.1e} of the largest, {largest}",
            i / columns,
            i % columns
        );
    }
}

/// Asserts that what is no number is none in both, and that the rest is close.
pub(crate) fn assert_same_numbers(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    let numbers = |from: &[f64], by: &[f64]| -> Vec<f64> {
        let both = from.iter().zip(by).filter(|(_, by)| !by.is_nan());
        both.map(|(value, _)| *value).collect()
    };
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert_eq!(f.is_nan(), e.is_nan(), "{what}[{i}]: {f} instead of {e}");
    }
    let (found, expected) = (numbers(found, expected), numbers(expected, expected));
    assert_close(what, &found, &expected, tolerance);
}

/// Asserts that two row-major matrices have the same bits in all rows but one, and numbers alone.
pub(crate) fn assert_equal_but_for_row(
    what: &str,
    found: &[f64],
    expected: &[f64],
    columns: usize,
    row: usize,
) {
    assert_eq!(found.len(), expected.len(), "{what}: number of values");
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let is_same = f == e && f.is_finite();
        assert!(
            is_same || i / columns == row,
            "{what}: {f} instead of {e} in row {}, though only row {row} is no number",
            i / columns
        );
    }
}
