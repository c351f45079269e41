//! Sums of `f32` that many threads add to.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use std::sync::atomic::{AtomicBool, Ordering};

use burn_cubecl::cubecl;
use burn_cubecl::cubecl::client::Client;
use burn_cubecl::cubecl::ir::Type;
use burn_cubecl::cubecl::ir::features::AtomicUsage;
use cubecl::prelude::*;

/// How a thread adds to a sum of `f32` that others add to as well.
#[cube]
pub trait AtomicSum: 'static + Send + Sync {
    /// What the sum's memory is bound as.
    type Word: Numeric;

    /// Adds `value`.
    fn add(sum: &Atomic<Self::Word>, value: f32);
}

/// By the device's own instruction.
pub struct NativeSum;

#[cube]
impl AtomicSum for NativeSum {
    type Word = f32;

    fn add(sum: &Atomic<f32>, value: f32) {
        sum.fetch_add(value);
    }
}

/// By compare and swap of the sum's bits, where the device lacks the instruction.
///
/// The swap is a weak one, which may fail though it finds what it expected. SPIR-V has no weak one, and CubeCL's own Metal
/// tries again until what it finds is another. On Metal by way of WGSL nobody does: there naga passes Metal's weak swap on
/// as it is, and CubeCL asks for what was found alone, not whether it was swapped. Such a failure, which passes for a
/// success here, would lose what was to be added. No value tells both apart, so that this has no remedy on this side;
/// devices with an instruction of their own ([`NativeSum`]), as Apple's have, are not asked.
pub struct CompareAndSwap;

#[cube]
impl AtomicSum for CompareAndSwap {
    type Word = u32;

    fn add(sum: &Atomic<u32>, value: f32) {
        let mut expected = sum.load();
        let mut done = false;
        while !done {
            let next = u32::reinterpret(f32::reinterpret(expected) + value);
            let found = sum.compare_exchange_weak(expected, next);
            done = found == expected;
            expected = found;
        }
    }
}

/// Whether [`has_native_sum`] says no whatever the device has.
static REFUSED: AtomicBool = AtomicBool::new(false);

/// Has [`has_native_sum`] say no from now on, in the whole process, so that ops add as they do on devices
/// without the instruction. For tests.
pub fn refuse_native_sums(on: bool) {
    REFUSED.store(on, Ordering::Relaxed);
}

/// Whether the device adds `f32` atomically by itself.
#[must_use]
pub fn has_native_sum(client: &Client) -> bool {
    if REFUSED.load(Ordering::Relaxed) {
        return false;
    }
    let word = Type::atomic(f32::elem_type_native());
    client
        .properties()
        .atomic_type_usage(word)
        .contains(AtomicUsage::Add)
}
