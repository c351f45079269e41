//! Elementary functions that keep their relative precision near zero, which shader languages do
//! not promise: `exp(x) - 1` and `log(1 + x)` written out lose all digits of a small `x`.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use burn_cubecl::cubecl;
use cubecl::prelude::*;

/// `exp(x) - 1`.
#[cube]
pub fn exp_m1(x: f32) -> f32 {
    // Taylor to x^9 / 9!: the rest is below 3e-10 of the value for |x| < 0.5.
    let mut sum = x * comptime!(1.0f32 / 362_880.0) + comptime!(1.0f32 / 40_320.0);
    sum = sum * x + comptime!(1.0f32 / 5_040.0);
    sum = sum * x + comptime!(1.0f32 / 720.0);
    sum = sum * x + comptime!(1.0f32 / 120.0);
    sum = sum * x + comptime!(1.0f32 / 24.0);
    sum = sum * x + comptime!(1.0f32 / 6.0);
    sum = sum * x + 0.5f32;
    sum = sum * x + 1.0f32;
    select(x.abs() < 0.5f32, sum * x, x.exp() - 1.0f32)
}

/// `log(1 + x)` for `x > -1`.
#[cube]
pub fn ln_1p(x: f32) -> f32 {
    // 2 atanh(s) with s = x / (2 + x), by its odd series: the rest is below 1e-9 of the value for
    // |x| < 0.3.
    let near = x.abs() < 0.3f32;
    let small = select(near, x, 0.0f32);
    let s = small / (2.0f32 + small);
    let q = s * s;
    let mut sum = q * comptime!(1.0f32 / 9.0) + comptime!(1.0f32 / 7.0);
    sum = sum * q + comptime!(1.0f32 / 5.0);
    sum = sum * q + comptime!(1.0f32 / 3.0);
    sum = sum * q + 1.0f32;
    let large = select(near, 0.0f32, x);
    select(near, 2.0f32 * s * sum, (1.0f32 + large).ln())
}

/// `log(1 + exp(x))`.
#[cube]
pub fn softplus(x: f32) -> f32 {
    max(x, 0.0f32) + ln_1p((-x.abs()).exp())
}

/// `1 / (1 + exp(-x))`.
#[cube]
pub fn sigmoid(x: f32) -> f32 {
    // By the side on which the exponential does not overflow.
    let e = (-x.abs()).exp();
    select(x >= 0.0f32, 1.0f32, e) / (1.0f32 + e)
}
