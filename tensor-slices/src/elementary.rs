//! Elementary functions as polynomials: a few ulp from exact, and without calls or branches, so that
//! the compiler turns loops over them into vector code and overlaps neighbours in scalar code.
//!
//! Where a range is given it is not checked; outside, results are numbers without meaning. NaN stays
//! NaN.

/// `exp(x)` for `x <= 0`, to about 2 ulp; below -87 it is zero.
#[inline(always)]
#[must_use]
pub fn exp_non_positive(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    // ln 2 in two parts, so that x - k ln 2 keeps its low bits.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to an integer
    let within = if x < -87.0 { -87.0 } else { x };
    let shifted = within * LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = within - k * LN2_HIGH - k * LN2_LOW;
    // Taylor's polynomial on |r| <= ln 2 / 2; its seventh-order remainder is below 2^-25.
    let p = 1.0
        + r * (1.0
            + r * (0.5
                + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))));
    let bits = shifted.to_bits().wrapping_shl(23);
    let scale = f32::from_bits(bits.wrapping_add(0x3f80_0000));
    if x <= -87.0 { 0.0 } else { p * scale }
}

/// `exp(x) - 1` for `x` in `[-0.7, 0]`, relative to its own size.
#[inline(always)]
#[must_use]
pub fn exp_m1_of_small(x: f32) -> f32 {
    // Taylor's polynomial; what is left off is below 0.7^9 / 10! = 1.2e-8 of the result.
    let p = 1.0 / 720.0 + x * (1.0 / 5040.0 + x * (1.0 / 40320.0 + x * (1.0 / 362_880.0)));
    let p = 1.0 / 24.0 + x * (1.0 / 120.0 + x * p);
    x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * p)))
}

/// `ln(1 + e)` for `u = e / (2 + e)` with `e` in `[0, 1]`, by the series of `2 atanh(u)`.
#[inline(always)]
#[must_use]
pub fn ln_1p_of_ratio(u: f32) -> f32 {
    let v = u * u;
    2.0 * u
        * (1.0
            + v * (1.0 / 3.0
                + v * (1.0 / 5.0
                    + v * (1.0 / 7.0 + v * (1.0 / 9.0 + v * (1.0 / 11.0 + v * (1.0 / 13.0)))))))
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
#[must_use]
pub fn sigmoid(x: f32) -> f32 {
    let e = exp_non_positive(-x.abs());
    let larger = 1.0 / (1.0 + e);
    if x >= 0.0 { larger } else { e * larger }
}

/// `ln(1 + exp(x))`, for very negative `x` with full relative precision down to 1e-38.
#[inline(always)]
#[must_use]
pub fn softplus(x: f32) -> f32 {
    let e = exp_non_positive(-x.abs());
    let positive = if x > 0.0 { x } else { 0.0 };
    positive + ln_1p_of_ratio(e / (2.0 + e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_agree_with_f64() {
        for i in -4000..=4000 {
            let x = i as f32 * 0.025;
            let wide = f64::from(x);
            let exact = 1.0 / (1.0 + (-wide).exp());
            assert!((f64::from(sigmoid(x)) - exact).abs() < 2e-7, "sigmoid({x})");
            let exact = wide.max(0.0) + (-wide.abs()).exp().ln_1p();
            let relative = f64::from(softplus(x)) / exact - 1.0;
            assert!(x < -86.0 || relative.abs() < 4e-7, "softplus({x})");
            if x <= 0.0 {
                let relative = f64::from(exp_non_positive(x)) / wide.exp() - 1.0;
                assert!(x < -86.0 || relative.abs() < 4e-7, "exp({x}): {relative:e}");
            }
            let (small, wide) = (x * 7e-3, f64::from(x * 7e-3));
            if (-0.7..0.0).contains(&small) {
                let relative = f64::from(exp_m1_of_small(small)) / wide.exp_m1() - 1.0;
                assert!(relative.abs() < 2e-7, "exp_m1({small}): {relative:e}");
            }
        }
        assert_eq!(exp_m1_of_small(0.0), 0.0);
        assert_eq!(exp_non_positive(f32::NEG_INFINITY), 0.0);
    }

    #[test]
    fn what_is_no_number_stays_none() {
        for function in [exp_non_positive, exp_m1_of_small, sigmoid, softplus] {
            assert!(function(f32::NAN).is_nan());
        }
    }
}
