//! Every custom op and a whole training step on a GPU against the CPU: values and gradients.
//!
//! Ops with gradients are compared with their reference in `f64` (plain tensor operations on NdArray, set to
//! double precision), the step with the same step on Flex, and
//! marching with the CPU's. Without a device the tests are skipped
//! and say so; with `SOS_REQUIRE_GPU=1`, as `cargo xtask test --device wgpu` (or `cuda`) sets it, they fail.
//! All memory that kernels write to is filled with NaN beforehand, so that gaps show.
#![allow(clippy::unwrap_used)]

use std::io::Write as _;

#[cfg(feature = "gpu")]
mod adam;
#[cfg(feature = "gpu")]
mod colour_field;
#[cfg(feature = "gpu")]
mod composite;
#[cfg(feature = "gpu")]
mod devices;
#[cfg(feature = "gpu")]
mod encode;
#[cfg(feature = "gpu")]
mod march;
#[cfg(feature = "gpu")]
mod occupancy;
#[cfg(feature = "gpu")]
mod primitives;
#[cfg(feature = "gpu")]
mod refusals;
#[cfg(feature = "gpu")]
mod row_losses;
#[cfg(feature = "gpu")]
mod sdf_field;
#[cfg(feature = "gpu")]
mod step;
#[cfg(feature = "gpu")]
mod support;

#[cfg(not(feature = "gpu"))]
#[test]
fn ops_on_a_gpu_equal_those_on_the_cpu() {
    assert!(
        std::env::var_os("SOS_REQUIRE_GPU").is_none(),
        "SOS_REQUIRE_GPU is set, but this build has no GPU kernels; add --features wgpu"
    );
    say("skipped: this build has no GPU kernels; run `cargo xtask test --device wgpu`");
}

/// Prints a line even where a test passes: what `eprintln!` prints, the test harness then keeps back.
fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}
