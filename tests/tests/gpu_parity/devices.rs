//! Which device is taken, and what it refuses.

use hashgrid::GridLayout;
use sos_train::device::{DeviceKind, choose};
use sos_train::train::Trainer;
use sos_train::train::setup::scene_config;

use crate::say;
use crate::step::{config, prepared};
use crate::support::under_test;

/// Whether there is more than software that poses as a GPU.
fn has_hardware() -> bool {
    let found = under_test().is_some_and(|found| found.option == "cuda");
    #[cfg(feature = "wgpu")]
    let found = found
        || gpu_tensors::adapters()
            .iter()
            .any(|adapter| adapter.is_gpu() && adapter.device().is_some());
    found
}

#[test]
fn auto_takes_hardware_or_the_cpu_and_never_a_software_renderer() {
    let Some(found) = under_test() else {
        return;
    };
    let chosen = choose("auto").unwrap();
    let expected = if has_hardware() {
        DeviceKind::Gpu
    } else {
        DeviceKind::Processor
    };
    assert_eq!(chosen.kind, expected, "{}", chosen.name);
    assert!(!chosen.name.contains("software renderer"));
    // By its name it can be had.
    let named = choose(found.option).unwrap();
    assert_ne!(named.kind, DeviceKind::Processor, "{}", named.name);
    assert!(has_hardware() || named.name.contains("software renderer"));
}

#[test]
fn a_table_that_cannot_be_bound_is_refused_with_a_remedy() {
    let Some(found) = under_test() else {
        return;
    };
    let Some(limit) = choose(found.option).unwrap().largest_binding else {
        say("skipped: on this device memory is the limit, not what a kernel can bind");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let mut config = config(found.option);
    let data = prepared(folder.path(), &config);
    config.apply_override("model.levels=16").unwrap();
    config
        .apply_override("model.finest_resolution=2048")
        .unwrap();
    let bytes = |config: &_| {
        let layout = GridLayout::new(&scene_config(config, &data).object_grid);
        8 * layout.entries() as u64
    };
    while bytes(&config) <= limit && config.model.log2_table_size < 24 {
        config.model.log2_table_size += 1;
    }
    config.validate().unwrap();
    if bytes(&config) <= limit {
        say("skipped: this device can bind the largest table there is");
        return;
    }
    let refusal = Trainer::new(&config, &data).err().unwrap().to_string();
    for part in ["MiB", "model.log2_table_size", "--device cpu"] {
        assert!(refusal.contains(part), "{refusal}");
    }
}
