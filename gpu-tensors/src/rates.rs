//! What a device does at best, measured now: memory copied and multiply-adds.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use std::fmt;
use std::time::Instant;

use burn::backend::DispatchTensorKind;
use burn::tensor::{Device, Tensor};
use burn_cubecl::cubecl;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::points::{LANES, Quad};
use crate::tensor::{buffer, fresh, units_for, zeros};

/// Bytes that are copied, where a buffer may be so large: no cache holds them.
const LARGEST: u64 = 512 << 20;
/// Threads that multiply and add.
const THREADS: usize = 1 << 18;
/// Operations of one round of a thread: four independent quads, eight times.
const ROUND: f64 = (4 * LANES * 8 * 2) as f64;
/// A measurement is repeated until it takes so many seconds, for launches to be no part of it.
const LONG_ENOUGH: f64 = 0.02;
/// The best of so many measurements counts.
const ATTEMPTS: usize = 5;

/// Peak rates of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Bytes read and written by copies, in 10^9 a second.
    pub copy_gbs: f64,
    /// Multiply-adds of `f32`, each counting two, in 10^9 a second.
    pub gflops: f64,
}

/// A device did not finish its work, in its own words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceFailed(String);

impl fmt::Display for DeviceFailed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the device failed: {}", self.0)
    }
}

impl std::error::Error for DeviceFailed {}

/// Waits for all that a device has been given to do.
///
/// # Errors
/// [`DeviceFailed`] when some of it could not be done.
pub fn finish(device: &Device) -> Result<(), DeviceFailed> {
    device
        .sync()
        .map_err(|error| DeviceFailed(error.to_string()))
}

impl Rates {
    /// Measures `device`, which binds buffers of up to `largest_binding` bytes; `None` where CubeCL does not
    /// run it.
    ///
    /// # Errors
    /// [`DeviceFailed`] when it does not finish.
    pub fn measure(
        device: &Device,
        largest_binding: Option<u64>,
    ) -> Result<Option<Self>, DeviceFailed> {
        let like = Tensor::<1>::zeros([1], device).into_dispatch();
        let DispatchTensorKind::Cube(like) = like.kind else {
            return Ok(None);
        };
        let like = like.float();
        let bytes = largest_binding.map_or(LARGEST, |most| most.min(LARGEST));
        Ok(Some(Self {
            copy_gbs: copies(device, &like, bytes as usize / size_of::<f32>())?,
            gflops: multiply_adds(device, &like)?,
        }))
    }
}

/// The best rate of `work(repeats)`, which returns how much it did, in 10^9 a second.
fn best(device: &Device, mut work: impl FnMut(u32) -> f64) -> Result<f64, DeviceFailed> {
    let mut timed = |repeats: u32| -> Result<(f64, f64), DeviceFailed> {
        finish(device)?;
        let begun = Instant::now();
        let amount = work(repeats);
        finish(device)?;
        Ok((amount, begun.elapsed().as_secs_f64()))
    };
    // The first one compiles.
    timed(1)?;
    let mut repeats = 1;
    while repeats < 1 << 20 && timed(repeats)?.1 < LONG_ENOUGH {
        repeats *= 2;
    }
    let mut rate = 0.0f64;
    for _ in 0..ATTEMPTS {
        let (amount, seconds) = timed(repeats)?;
        rate = rate.max(amount / seconds);
    }
    Ok(1e-9 * rate)
}

/// The better of a number and of four at once a thread: devices differ in what suits them.
fn copies(device: &Device, like: &CubeTensor, values: usize) -> Result<f64, DeviceFailed> {
    let values = values.next_multiple_of(LANES);
    let from = zeros(like, [values]);
    let to = fresh(like, [values]);
    let client = &like.client;
    let moved = |repeats: u32| f64::from(repeats) * (2 * values * size_of::<f32>()) as f64;
    let one = best(device, |repeats| {
        for _ in 0..repeats {
            let (count, dim) = units_for(client, values);
            let (from, to) = (buffer(&from), buffer(&to));
            // SAFETY: threads beyond the values return at once, and there are as many of either.
            unsafe { copy_one::launch_unchecked(client, count, dim, from, to, values as u32) };
        }
        moved(repeats)
    })?;
    let four = best(device, |repeats| {
        let quads = values / LANES;
        for _ in 0..repeats {
            let (count, dim) = units_for(client, quads);
            let (from, to) = (buffer(&from), buffer(&to));
            // SAFETY: as above.
            unsafe { copy_four::launch_unchecked(client, count, dim, from, to, quads as u32) };
        }
        moved(repeats)
    })?;
    Ok(one.max(four))
}

fn multiply_adds(device: &Device, like: &CubeTensor) -> Result<f64, DeviceFailed> {
    let sums = fresh(like, [THREADS * LANES]);
    best(device, |repeats| {
        let rounds = 16 * repeats;
        let (count, dim) = units_for(&like.client, THREADS);
        // SAFETY: threads beyond the sums return at once.
        unsafe {
            multiply_add_kernel::launch_unchecked(
                &like.client,
                count,
                dim,
                buffer(&sums),
                THREADS as u32,
                rounds,
                0.999_999,
                1e-6,
            );
        }
        THREADS as f64 * f64::from(rounds) * ROUND
    })
}

#[cube(launch_unchecked)]
fn copy_one(from: &[f32], to: &mut [f32], count: u32) {
    if ABSOLUTE_POS < count as usize {
        to[ABSOLUTE_POS] = from[ABSOLUTE_POS];
    }
}

#[cube(launch_unchecked)]
fn copy_four(from: &[Quad], to: &mut [Quad], count: u32) {
    if ABSOLUTE_POS < count as usize {
        to[ABSOLUTE_POS] = from[ABSOLUTE_POS];
    }
}

/// Chains of multiply-adds that stay in registers, four quads wide.
#[cube(launch_unchecked)]
fn multiply_add_kernel(sums: &mut [Quad], threads: u32, rounds: u32, factor: f32, summand: f32) {
    if ABSOLUTE_POS < threads as usize {
        let factor = Quad::new(factor);
        let summand = Quad::new(summand);
        let start = f32::cast_from(ABSOLUTE_POS as u32) * 1e-6f32;
        let mut a = Quad::new(start);
        let mut b = Quad::new(start + 0.25f32);
        let mut c = Quad::new(start + 0.5f32);
        let mut d = Quad::new(start + 0.75f32);
        for _ in 0..rounds {
            #[unroll]
            for _ in 0..8 {
                a = fma(a, factor, summand);
                b = fma(b, factor, summand);
                c = fma(c, factor, summand);
                d = fma(d, factor, summand);
            }
        }
        sums[ABSOLUTE_POS] = a + b + c + d;
    }
}
