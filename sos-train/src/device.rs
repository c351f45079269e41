//! Where to compute: what a name of the command line stands for on this machine.

use burn::tensor::{Device, Tensor};
use hashgrid::{GridConfig, HashGrid, encode};

use crate::prepare::error::PrepareError;

/// A device, and how to speak of it.
#[derive(Clone, Debug)]
pub struct ChosenDevice {
    /// Without autodiff.
    pub device: Device,
    /// As in "Flex on 8 threads" or "NVIDIA H200 (discrete GPU, Vulkan)".
    pub name: String,
    /// Bytes that a kernel can bind as one buffer; `None` where memory is the limit.
    pub largest_binding: Option<u64>,
    /// What it computes with.
    pub kind: DeviceKind,
}

/// What a device computes with, and how it is spoken to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceKind {
    /// The processor, by kernels of its own.
    Processor,
    /// The processor posing as a GPU: a software renderer, which takes its time from the host's cores.
    Renderer,
    /// A processor of its own.
    Gpu,
}

/// What every build but one with CUDA alone has besides.
const OTHERS: &str = if cfg!(feature = "wgpu") {
    "wgpu or cpu"
} else {
    "cpu"
};

/// Whether this build can use the device of such a name at all.
///
/// # Errors
/// When what it takes was not compiled in.
pub fn built_in(name: &str) -> Result<(), PrepareError> {
    let remedy = match name {
        "wgpu" if !cfg!(feature = "wgpu") => {
            "this build has no GPU kernels; build with --features wgpu (with cargo xtask: --device wgpu), or \
             choose cpu"
                .to_owned()
        }
        "cuda" if !cfg!(feature = "cuda") => {
            format!(
                "this build has no CUDA; build with --features cuda (with cargo xtask: --device cuda), or choose {OTHERS}"
            )
        }
        _ => return Ok(()),
    };
    Err(PrepareError::Device {
        name: name.to_owned(),
        remedy,
    })
}

/// The device of a name of the command line, one of [`DEVICES`](crate::config::DEVICES).
///
/// `auto` is a GPU where the build can use one and there is one, through CUDA, which is the faster way to an NVIDIA GPU
/// (docs/performance.md), before wgpu, else the CPU:
/// never a software renderer, which `wgpu` takes when there is nothing else.
///
/// # Errors
/// When the name is unknown, not compiled in, or there is no such device.
#[allow(deprecated)] // upstream prefers Flex; NdArray is supported as well
pub fn choose(name: &str) -> Result<ChosenDevice, PrepareError> {
    built_in(name)?;
    match name {
        "auto" => Ok(cuda()
            .or_else(|| gpu(Software::Refused))
            .unwrap_or_else(|| cpu("Flex", Device::flex()))),
        "cpu" | "flex" => Ok(cpu("Flex", Device::flex())),
        "ndarray" => Ok(cpu("NdArray", Device::ndarray())),
        "wgpu" => gpu(Software::Allowed).ok_or_else(|| PrepareError::Device {
            name: name.to_owned(),
            remedy: if cfg!(feature = "vulkan") {
                "wgpu finds no GPU here, and this build speaks SPIR-V, on which Mesa's software \
                 renderer crashes; build with --features wgpu alone, or choose cpu"
            } else {
                "wgpu finds no device here; install a graphics driver (Mesa's lavapipe, \
                 package mesa-vulkan-drivers, does without a GPU), or choose cpu"
            }
            .to_owned(),
        }),
        "cuda" => cuda().ok_or_else(|| PrepareError::Device {
            name: name.to_owned(),
            remedy: format!("there is no NVIDIA GPU with a driver here; choose {OTHERS}"),
        }),
        other => Err(PrepareError::Device {
            name: other.to_owned(),
            remedy: format!("choose one of {}", crate::config::DEVICES.join(", ")),
        }),
    }
}

/// Asks a GPU for an encoding and a gradient that are known.
///
/// A driver or a toolkit that does not fit need not report anything: kernels are then left out or do something else, and
/// a run would learn nothing for hours.
///
/// # Errors
/// When what comes back is not what the processor computes.
pub(crate) fn verify(chosen: &ChosenDevice, name: &str) -> Result<(), PrepareError> {
    if chosen.kind == DeviceKind::Processor {
        return Ok(());
    }
    let (found, expected) = (
        known_values(&chosen.device),
        known_values(&Device::flex()).unwrap_or_default(),
    );
    let matches = found.is_some_and(|found| {
        let mut pairs = found.iter().zip(&expected);
        found.len() == expected.len() && pairs.all(|(a, b)| (a - b).abs() < 1e-3)
    });
    if matches {
        return Ok(());
    }
    Err(PrepareError::Device {
        name: name.to_owned(),
        remedy: format!(
            "{} does not compute what it is asked for: its driver, or CUDA's toolkit, does not fit this build; \
             choose another --device, cpu at the least",
            chosen.name
        ),
    })
}

/// An encoding and its table's gradient, of a size of one; `None` where the device fails.
fn known_values(device: &Device) -> Option<Vec<f32>> {
    let config = GridConfig {
        levels: 2,
        base_resolution: 2,
        finest_resolution: 16,
        log2_table_size: 8,
        ..GridConfig::default()
    };
    let device = device.clone().autodiff();
    let grid = HashGrid::new(&config, 1, &device);
    let points = Tensor::from_floats([[0.1, 0.2, 0.3], [0.9, 0.5, 0.7]], &device);
    let table = grid.table.val().detach().require_grad();
    let encoded = encode(points, table.clone(), grid.layout(), config.levels);
    let mut gradients = encoded.clone().sum().backward();
    let gradient = table.grad_remove(&mut gradients)?;
    // The table's values begin at 1e-4.
    let mut values = on_host(encoded.mul_scalar(1e4))?;
    values.extend(on_host(gradient)?);
    Some(values)
}

fn on_host(tensor: Tensor<2>) -> Option<Vec<f32>> {
    tensor.try_into_data().ok()?.try_to_vec::<f32>().ok()
}

/// What to say besides the device that was taken when `asked` for: that `auto` had the CPU alone to take
/// in this build, and which builds have more.
#[must_use]
pub fn remark(asked: &str) -> &'static str {
    if asked == "auto" && !cfg!(any(feature = "wgpu", feature = "cuda")) {
        "; this build has no GPU kernels: the feature `wgpu`, or `cargo xtask train --device wgpu`, makes \
         one that has"
    } else {
        ""
    }
}

fn cpu(backend: &str, device: Device) -> ChosenDevice {
    let threads = match rayon::current_num_threads() {
        1 => "one thread".to_owned(),
        n => format!("{n} threads"),
    };
    ChosenDevice {
        device,
        name: format!("{backend} on {threads}"),
        largest_binding: None,
        kind: DeviceKind::Processor,
    }
}

#[cfg(not(feature = "cuda"))]
fn cuda() -> Option<ChosenDevice> {
    None
}

/// NVIDIA's GPUs; `None` where the build has no CUDA.
#[cfg(not(feature = "cuda"))]
pub(crate) fn cuda_names() -> Option<Vec<String>> {
    None
}

/// The first of NVIDIA's GPUs, in the driver's order.
#[cfg(feature = "cuda")]
fn cuda() -> Option<ChosenDevice> {
    let device = cuda_devices().into_iter().next()?;
    Some(ChosenDevice {
        name: format!("{} (CUDA)", name_of(&device)),
        device,
        largest_binding: None,
        kind: DeviceKind::Gpu,
    })
}

#[cfg(feature = "cuda")]
fn cuda_devices() -> Vec<Device> {
    use burn::tensor::DeviceType;
    Device::enumerate(DeviceType::Cuda)
        .iter()
        .cloned()
        .collect()
}

#[cfg(feature = "cuda")]
fn name_of(device: &Device) -> String {
    device
        .identity()
        .map_or_else(|| "NVIDIA GPU".to_owned(), |identity| identity.name)
}

/// NVIDIA's GPUs; `None` where the build has no CUDA.
#[cfg(feature = "cuda")]
pub(crate) fn cuda_names() -> Option<Vec<String>> {
    Some(cuda_devices().iter().map(name_of).collect())
}

/// Whether the processor may pose as a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Software {
    Allowed,
    Refused,
}

#[cfg(not(feature = "wgpu"))]
fn gpu(_software: Software) -> Option<ChosenDevice> {
    None
}

#[cfg(feature = "wgpu")]
fn gpu(software: Software) -> Option<ChosenDevice> {
    gpu_tensors::adapters()
        .into_iter()
        .filter(|adapter| adapter.is_gpu() || software == Software::Allowed)
        .find_map(|adapter| {
            Some(ChosenDevice {
                device: adapter.device()?,
                name: format!("{} ({}, {})", adapter.name, adapter.kind, adapter.api),
                largest_binding: Some(adapter.largest_binding),
                kind: if adapter.is_gpu() {
                    DeviceKind::Gpu
                } else {
                    DeviceKind::Renderer
                },
            })
        })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn auto_never_takes_a_software_renderer() {
        let chosen = choose("auto").unwrap();
        assert!(
            !chosen.name.contains("software renderer"),
            "{}",
            chosen.name
        );
    }

    #[test]
    fn auto_says_when_the_build_leaves_it_no_choice() {
        if cfg!(any(feature = "wgpu", feature = "cuda")) {
            assert_eq!(remark("auto"), "");
        } else {
            assert!(remark("auto").contains("cargo xtask train --device wgpu"));
        }
        // Who names a device needs no other.
        assert_eq!(remark("cpu"), "");
    }

    #[test]
    fn a_device_that_computes_passes() {
        let mut cpu = choose("cpu").unwrap();
        verify(&cpu, "cpu").unwrap();
        // As if it were a GPU: asked, it gives the known values.
        cpu.kind = DeviceKind::Gpu;
        verify(&cpu, "cpu").unwrap();
    }

    #[test]
    fn cpu_backends_are_told_apart() {
        assert!(choose("cpu").unwrap().name.starts_with("Flex on "));
        assert!(choose("ndarray").unwrap().name.starts_with("NdArray on "));
        assert_eq!(choose("flex").unwrap().largest_binding, None);
    }

    #[test]
    fn a_device_that_is_not_there_comes_with_a_remedy() {
        let error = choose("tpu").unwrap_err().to_string();
        assert!(
            error.contains("--device tpu: choose one of auto"),
            "{error}"
        );
        if !cfg!(feature = "wgpu") {
            let error = choose("wgpu").unwrap_err().to_string();
            assert!(error.contains("--features wgpu"), "{error}");
        }
    }
}
