//! Devices, numbers and comparisons.

// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

use std::sync::OnceLock;

use burn::tensor::{Device, FloatDType, Tensor, TensorData};

/// What values of an op may differ by, as a part of the largest.
pub(crate) const VALUE: f64 = 1e-4;
/// The same for gradients.
pub(crate) const GRADIENT: f64 = 1e-3;

/// The device under test, without autodiff: hardware where there is some, else lavapipe.
///
/// `None`, with the reason printed, where there is none at all and that is allowed.
pub(crate) fn gpu() -> Option<Device> {
    static DEVICE: OnceLock<Option<Device>> = OnceLock::new();
    DEVICE
        .get_or_init(|| {
            gpu_tensors::poison_fresh_memory(true);
            let found = devices().into_iter().next();
            if let Some((name, device)) = found {
                eprintln!("on {name}");
                return Some(device);
            }
            assert!(
                std::env::var_os("SOS_REQUIRE_GPU").is_none(),
                "SOS_REQUIRE_GPU is set, but this build finds no device; for wgpu, Mesa's lavapipe \
                 (package mesa-vulkan-drivers) stands in for one"
            );
            eprintln!("skipped: this build finds no GPU");
            None
        })
        .clone()
}

/// The devices that this build can use, with their names; those of CUDA first.
fn devices() -> Vec<(String, Device)> {
    let mut devices = Vec::new();
    #[cfg(feature = "cuda")]
    for device in Device::enumerate(burn::tensor::DeviceType::Cuda).iter() {
        devices.push(("CUDA".to_owned(), device.clone()));
    }
    #[cfg(feature = "wgpu")]
    for adapter in gpu_tensors::adapters() {
        if let Some(device) = adapter.device() {
            devices.push((format!("{} ({})", adapter.name, adapter.kind), device));
        }
    }
    devices
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
    assert_eq!(found.len(), expected.len(), "{what}: number of values");
    let largest = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let scale = if largest > 0.0 { largest } else { 1.0 };
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let error = (f - e).abs() / scale;
        assert!(
            error <= tolerance,
            "{what}[{i}]: {f} instead of {e}, an error of {error:.1e} of the largest, {largest}"
        );
    }
}
