//! Lists what wgpu finds, with the limits that kernels meet:
//! `cargo run --release -p gpu-tensors --features wgpu --example list_adapters`.

#[cfg(feature = "wgpu")]
fn main() {
    let adapters = gpu_tensors::adapters();
    if adapters.is_empty() {
        println!("no adapter; Mesa's lavapipe is one where there is no GPU");
    }
    for adapter in adapters {
        println!(
            "{}, {} through {} ({})",
            adapter.name, adapter.kind, adapter.api, adapter.driver
        );
        println!(
            "  tensors up to {} MiB, {} KiB shared by {} threads, {} buffers at once",
            adapter.largest_binding >> 20,
            adapter.shared_memory >> 10,
            adapter.workgroup_units,
            adapter.bindings
        );
        let sums = if adapter.float_atomics {
            "by itself"
        } else {
            "by compare and swap"
        };
        println!("  adds f32 atomically {sums}");
        match adapter.device() {
            Some(device) => println!("  Burn's device: {device:?}"),
            None => println!("  Burn has no name for it"),
        }
    }
}

#[cfg(not(feature = "wgpu"))]
fn main() {
    println!("without a GPU feature this crate is empty: add --features wgpu");
}
