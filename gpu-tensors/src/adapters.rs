//! What wgpu finds on this machine, with the limits that kernels meet.

use std::fmt;
use std::sync::OnceLock;

use burn::tensor::{Device, DeviceKind};
use burn_cubecl::cubecl::future::block_on;
use burn_cubecl::cubecl::wgpu::{AutoGraphicsApi, wgpu};

/// What sort of device computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// A graphics card with memory of its own.
    Discrete,
    /// A graphics unit that shares the processor's memory.
    Integrated,
    /// A part of a graphics card, handed to a virtual machine.
    Virtual,
    /// The processor, posing as a GPU: Mesa's lavapipe, Microsoft's WARP.
    Software,
    /// The driver does not say.
    Other,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Discrete => "discrete GPU",
            Self::Integrated => "integrated GPU",
            Self::Virtual => "virtual GPU",
            Self::Software => "software renderer",
            Self::Other => "other",
        })
    }
}

/// An adapter and its limits.
#[derive(Clone, Debug)]
pub struct Adapter {
    /// The device's name, from its driver.
    pub name: String,
    /// The driver and its version.
    pub driver: String,
    /// The graphics API it is reached through.
    pub api: String,
    /// What sort of device it is.
    pub kind: AdapterKind,
    /// Its number among the adapters of its kind.
    pub index: usize,
    /// Bytes that a kernel can bind as one buffer: no tensor may be larger.
    pub largest_binding: u64,
    /// Bytes of a workgroup's shared memory.
    pub shared_memory: u32,
    /// Threads of a workgroup.
    pub workgroup_units: u32,
    /// Buffers that a kernel can bind at once.
    pub bindings: u32,
    /// Whether it adds `f32` atomically by itself.
    pub float_atomics: bool,
}

impl Adapter {
    /// Burn's device on this adapter; `None` where Burn has no way to name it, and for software renderers in
    /// builds for SPIR-V, on which Mesa's crashes.
    #[must_use]
    pub fn device(&self) -> Option<Device> {
        let kind = match self.kind {
            AdapterKind::Discrete => DeviceKind::DiscreteGpu(self.index),
            AdapterKind::Integrated => DeviceKind::IntegratedGpu(self.index),
            AdapterKind::Virtual => DeviceKind::VirtualGpu(self.index),
            // Burn's name for software takes the first. Built for SPIR-V, it would be fed that, and Mesa's
            // lavapipe crashes on it.
            AdapterKind::Software if self.index == 0 && !cfg!(feature = "vulkan") => {
                DeviceKind::Cpu
            }
            AdapterKind::Software | AdapterKind::Other => return None,
        };
        Some(Device::wgpu(kind))
    }

    /// Whether this is hardware.
    #[must_use]
    pub fn is_gpu(&self) -> bool {
        matches!(
            self.kind,
            AdapterKind::Discrete | AdapterKind::Integrated | AdapterKind::Virtual
        )
    }
}

/// The adapters of the graphics API that Burn's devices come up on, the likely fastest kind first.
///
/// That is the first in CubeCL's order (on Apple's computers Metal, elsewhere Vulkan, DirectX 12, OpenGL) through which
/// a GPU is reached, or where none is, the first that has anything. Asked once: what is plugged in later is
/// not listed.
#[must_use]
pub fn adapters() -> Vec<Adapter> {
    static FOUND: OnceLock<Vec<Adapter>> = OnceLock::new();
    FOUND
        .get_or_init(|| settled(AutoGraphicsApi::chain().into_iter().map(adapters_of)))
        .clone()
}

/// The first list with hardware, or else the first with anything.
fn settled(lists: impl Iterator<Item = Vec<Adapter>>) -> Vec<Adapter> {
    let mut software = Vec::new();
    for list in lists {
        if list.iter().any(|a| a.kind != AdapterKind::Software) {
            return list;
        }
        if software.is_empty() {
            software = list;
        }
    }
    software
}

/// All adapters of a graphics API, the likely fastest kind first.
fn adapters_of(api: wgpu::Backend) -> Vec<Adapter> {
    let backends = wgpu::Backends::from(api);
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut found: Vec<Adapter> = Vec::new();
    for adapter in block_on(instance.enumerate_adapters(backends)) {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
            wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
            wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
            wgpu::DeviceType::Cpu => AdapterKind::Software,
            wgpu::DeviceType::Other => AdapterKind::Other,
        };
        found.push(Adapter {
            name: info.name,
            driver: format!("{} {}", info.driver, info.driver_info),
            api: info.backend.to_string(),
            kind,
            index: found.iter().filter(|other| other.kind == kind).count(),
            largest_binding: limits
                .max_storage_buffer_binding_size
                .min(limits.max_buffer_size),
            shared_memory: limits.max_compute_workgroup_storage_size,
            workgroup_units: limits.max_compute_invocations_per_workgroup,
            bindings: limits.max_storage_buffers_per_shader_stage,
            float_atomics: adapter
                .features()
                .contains(wgpu::Features::SHADER_FLOAT32_ATOMIC),
        });
    }
    let rank = |kind| match kind {
        AdapterKind::Discrete => 0,
        AdapterKind::Virtual => 1,
        AdapterKind::Integrated => 2,
        AdapterKind::Other => 3,
        AdapterKind::Software => 4,
    };
    found.sort_by_key(|adapter| rank(adapter.kind));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, kind: AdapterKind) -> Adapter {
        Adapter {
            name: name.to_owned(),
            driver: String::new(),
            api: String::new(),
            kind,
            index: 0,
            largest_binding: 1 << 27,
            shared_memory: 1 << 14,
            workgroup_units: 256,
            bindings: 8,
            float_atomics: true,
        }
    }

    #[test]
    fn a_graphics_api_with_software_alone_is_passed_over_for_one_with_a_gpu() {
        let software = |name| vec![adapter(name, AdapterKind::Software)];
        let gpu = vec![
            adapter("card", AdapterKind::Discrete),
            adapter("its software", AdapterKind::Software),
        ];
        let first = |lists: Vec<Vec<Adapter>>| {
            let taken = settled(lists.into_iter());
            taken.first().map(|adapter| adapter.name.clone())
        };
        let card = Some("card".to_owned());
        assert_eq!(first(vec![gpu.clone(), software("b")]), card);
        assert_eq!(first(vec![software("a"), vec![], gpu]), card);
        let a = Some("a".to_owned());
        assert_eq!(first(vec![vec![], software("a"), software("b")]), a);
        assert_eq!(first(vec![vec![], vec![]]), None);
    }
}
