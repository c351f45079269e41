//! What this build can compute on, for people and for programs.

use std::fmt;

use serde::Serialize;

use crate::device::choose;

/// Everything there is, with the limits that matter.
#[derive(Clone, Debug, Serialize)]
pub struct Devices {
    /// Threads of the CPU's backends.
    pub cpu_threads: usize,
    /// NVIDIA's GPUs by name, in the driver's order; `None` where the build has no CUDA.
    pub cuda: Option<Vec<String>>,
    /// What wgpu finds; `None` where the build has no wgpu.
    pub wgpu: Option<Vec<WgpuDevice>>,
    /// What `--device auto` takes, or why it takes nothing.
    pub auto: String,
}

/// A device that wgpu finds.
#[derive(Clone, Debug, Serialize)]
pub struct WgpuDevice {
    /// Its name, from its driver.
    pub name: String,
    /// What sort of device it is.
    pub kind: String,
    /// The graphics API it is reached through.
    pub api: String,
    /// The driver and its version.
    pub driver: String,
    /// Bytes that a kernel can bind as one buffer.
    pub largest_binding: u64,
    /// Buffers that a kernel can bind at once.
    pub bindings: u32,
    /// Threads of a workgroup.
    pub workgroup_units: u32,
    /// Bytes of a workgroup's shared memory.
    pub shared_memory: u32,
    /// Whether it adds `f32` atomically by itself; else by compare and swap.
    pub float_atomics: bool,
}

impl Devices {
    /// Asks the drivers.
    #[must_use]
    pub fn find() -> Self {
        Self {
            cpu_threads: rayon::current_num_threads(),
            cuda: crate::device::cuda_names(),
            wgpu: wgpu_devices(),
            auto: match choose("auto") {
                Ok(chosen) => chosen.name,
                Err(error) => error.to_string(),
            },
        }
    }
}

#[cfg(not(feature = "wgpu"))]
fn wgpu_devices() -> Option<Vec<WgpuDevice>> {
    None
}

#[cfg(feature = "wgpu")]
fn wgpu_devices() -> Option<Vec<WgpuDevice>> {
    let adapters = gpu_tensors::adapters().into_iter();
    let devices = adapters.map(|adapter| WgpuDevice {
        kind: adapter.kind.to_string(),
        driver: adapter.driver.trim().to_owned(),
        name: adapter.name,
        api: adapter.api,
        largest_binding: adapter.largest_binding,
        bindings: adapter.bindings,
        workgroup_units: adapter.workgroup_units,
        shared_memory: adapter.shared_memory,
        float_atomics: adapter.float_atomics,
    });
    Some(devices.collect())
}

/// A table for people.
impl fmt::Display for Devices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = self.cpu_threads;
        writeln!(f, "cpu    {threads} threads (backends: flex, ndarray)")?;
        match self.cuda.as_deref() {
            None => {}
            Some([]) => writeln!(f, "cuda   no device found")?,
            Some(names) => {
                for name in names {
                    writeln!(f, "cuda   {name}")?;
                }
            }
        }
        match self.wgpu.as_deref() {
            None => writeln!(f, "wgpu   not in this build; build with --features wgpu")?,
            Some([]) => writeln!(f, "wgpu   no device found")?,
            Some(devices) => {
                for device in devices {
                    writeln!(f, "{device}")?;
                }
            }
        }
        writeln!(f, "auto takes: {}", self.auto)
    }
}

impl fmt::Display for WgpuDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            kind,
            api,
            driver,
            ..
        } = self;
        let atomics = if self.float_atomics {
            "yes"
        } else {
            "by compare and swap"
        };
        writeln!(f, "wgpu   {name} ({kind}, {api}, driver {driver})")?;
        write!(
            f,
            "       binds {} MiB at once in up to {} buffers; workgroups of {} threads and {} KiB; f32 atomics: {atomics}",
            self.largest_binding >> 20,
            self.bindings,
            self.workgroup_units,
            self.shared_memory >> 10,
        )
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_list_says_what_auto_takes() {
        let devices = Devices::find();
        let text = devices.to_string();
        assert!(text.starts_with("cpu "), "{text}");
        assert!(
            text.ends_with(&format!("\nauto takes: {}\n", devices.auto)),
            "{text}"
        );
        assert!(choose("auto").unwrap().name == devices.auto);
    }

    #[test]
    fn a_gpu_is_listed_with_its_limits() {
        let mut devices = Devices::find();
        devices.cuda = Some(Vec::new());
        devices.wgpu = Some(vec![WgpuDevice {
            name: "Thing".to_owned(),
            kind: "discrete GPU".to_owned(),
            api: "Vulkan".to_owned(),
            driver: "1.2".to_owned(),
            largest_binding: 128 << 20,
            bindings: 8,
            workgroup_units: 1024,
            shared_memory: 32 << 10,
            float_atomics: false,
        }]);
        let text = devices.to_string();
        for line in [
            "\ncuda   no device found\n",
            "\nwgpu   Thing (discrete GPU, Vulkan, driver 1.2)\n",
            "\n       binds 128 MiB at once in up to 8 buffers; workgroups of 1024 threads and 32 KiB; f32 atomics: by compare and swap\n",
        ] {
            assert!(text.contains(line), "{text}");
        }
    }
}
