//! Every custom op and a whole training step on a GPU against the CPU: values and gradients.
//!
//! Ops are compared with their reference in `f64` (plain tensor operations on NdArray, set to
//! double precision), the step with the same step on Flex. Without a device the tests are skipped
//! and say so; with `SOS_REQUIRE_GPU=1`, as `cargo xtask test --device wgpu` sets it, they fail.
//! All memory that kernels write to is filled with NaN beforehand, so that gaps show.
#![allow(clippy::unwrap_used)]

#[cfg(feature = "wgpu")]
mod adam;
#[cfg(feature = "wgpu")]
mod colour_field;
#[cfg(feature = "wgpu")]
mod composite;
#[cfg(feature = "wgpu")]
mod encode;
#[cfg(feature = "wgpu")]
mod primitives;
#[cfg(feature = "wgpu")]
mod sdf_field;
#[cfg(feature = "wgpu")]
mod step;
#[cfg(feature = "wgpu")]
mod support;

#[cfg(not(feature = "wgpu"))]
#[test]
fn ops_on_a_gpu_equal_those_on_the_cpu() {
    assert!(
        std::env::var_os("SOS_REQUIRE_GPU").is_none(),
        "SOS_REQUIRE_GPU is set, but this build has no GPU kernels; add --features wgpu"
    );
    eprintln!("skipped: this build has no GPU kernels; run `cargo xtask test --device wgpu`");
}
