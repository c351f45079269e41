//! Elementary functions as polynomials: a few ulp from exact, and without calls or branches, so that
//! the compiler turns loops over them into vector code and overlaps neighbours in scalar code.
//!
//! Where a range is given it is not checked; outside, results are numbers without meaning. NaN stays
//! NaN.
//!
//! `FUSED` functions round `a b + c` once. They are for loops compiled for a processor with that
//! instruction, where they take half as many; elsewhere each would be a call.

/// `a b + c`.
#[inline(always)]
fn mul_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// The polynomial with these coefficients, the constant one first.
#[inline(always)]
fn polynomial<const FUSED: bool, const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    let mut sum = coefficients[N - 1];
    for i in (0..N - 1).rev() {
        sum = mul_add::<FUSED>(x, sum, coefficients[i]);
    }
    sum
}

/// `exp(x)` for `x` in `[-87, 0]`, to about 2 ulp.
#[inline(always)]
#[must_use]
pub fn exp_of_moderate<const FUSED: bool>(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    // ln 2 in two parts, so that x - k ln 2 keeps its low bits.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to an integer
    let shifted = mul_add::<FUSED>(x, LOG2_E, ROUND);
    let k = shifted - ROUND;
    let r = mul_add::<FUSED>(k, -LN2_LOW, mul_add::<FUSED>(k, -LN2_HIGH, x));
    // Taylor's polynomial on |r| <= ln 2 / 2; its seventh-order remainder is below 2^-23.
    let p = polynomial::<FUSED, 7>(
        r,
        [
            1.0,
            1.0,
            0.5,
            1.0 / 6.0,
            1.0 / 24.0,
            1.0 / 120.0,
            1.0 / 720.0,
        ],
    );
    let bits = shifted.to_bits().wrapping_shl(23);
    p * f32::from_bits(bits.wrapping_add(0x3f80_0000))
}

/// `exp(x)` for `x <= 0`, to about 2 ulp; below -87 it is zero.
#[inline(always)]
#[must_use]
pub fn exp_non_positive<const FUSED: bool>(x: f32) -> f32 {
    let within = if x < -87.0 { -87.0 } else { x };
    let exp = exp_of_moderate::<FUSED>(within);
    if x <= -87.0 { 0.0 } else { exp }
}

/// `exp(x) - 1` for `x` in `[-0.7, 0]`, relative to its own size.
#[inline(always)]
#[must_use]
pub fn exp_m1_of_small<const FUSED: bool>(x: f32) -> f32 {
    // Taylor's polynomial; what is left off is below 0.7^9 / 10! = 1.2e-8 of the result.
    x * polynomial::<FUSED, 9>(
        x,
        [
            1.0,
            0.5,
            1.0 / 6.0,
            1.0 / 24.0,
            1.0 / 120.0,
            1.0 / 720.0,
            1.0 / 5040.0,
            1.0 / 40320.0,
            1.0 / 362_880.0,
        ],
    )
}

/// `ln(1 + e)` for `e` in `[0, 1]`, to about 2 ulp.
#[inline(always)]
#[must_use]
pub fn ln_1p_of_unit<const FUSED: bool>(e: f32) -> f32 {
    // ln(1 + e) / e with the least largest relative error, fitted by reweighted least squares: 6e-8 with coefficients
    // rounded to f32.
    e * polynomial::<FUSED, 10>(
        e,
        [
            1.0,
            -0.499_999,
            0.333_299_64,
            -0.249_541_37,
            0.196_759_5,
            -0.153_056_16,
            0.106_036_864,
            -0.056_959_774,
            0.019_851_56,
            -0.003_244_040_5,
        ],
    )
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
#[must_use]
pub fn sigmoid<const FUSED: bool>(x: f32) -> f32 {
    let e = exp_non_positive::<FUSED>(-x.abs());
    let larger = 1.0 / (1.0 + e);
    if x >= 0.0 { larger } else { e * larger }
}

/// `ln(1 + exp(x))`, for very negative `x` with full relative precision down to 1e-38.
#[inline(always)]
#[must_use]
pub fn softplus<const FUSED: bool>(x: f32) -> f32 {
    let e = exp_non_positive::<FUSED>(-x.abs());
    let positive = if x > 0.0 { x } else { 0.0 };
    positive + ln_1p_of_unit::<FUSED>(e)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agree_with_f64<const FUSED: bool>() {
        for i in -4000..=4000 {
            let x = i as f32 * 0.025;
            let wide = f64::from(x);
            let exact = 1.0 / (1.0 + (-wide).exp());
            let error = f64::from(sigmoid::<FUSED>(x)) - exact;
            assert!(error.abs() < 2e-7, "sigmoid({x})");
            let exact = wide.max(0.0) + (-wide.abs()).exp().ln_1p();
            let relative = f64::from(softplus::<FUSED>(x)) / exact - 1.0;
            assert!(x < -86.0 || relative.abs() < 4e-7, "softplus({x})");
            if x <= 0.0 {
                let relative = f64::from(exp_non_positive::<FUSED>(x)) / wide.exp() - 1.0;
                assert!(x < -86.0 || relative.abs() < 4e-7, "exp({x}): {relative:e}");
            }
            let (small, wide) = (x * 7e-3, f64::from(x * 7e-3));
            if (-0.7..0.0).contains(&small) {
                let relative = f64::from(exp_m1_of_small::<FUSED>(small)) / wide.exp_m1() - 1.0;
                assert!(relative.abs() < 2e-7, "exp_m1({small}): {relative:e}");
            }
        }
        assert_eq!(exp_m1_of_small::<FUSED>(0.0), 0.0);
        assert_eq!(exp_non_positive::<FUSED>(f32::NEG_INFINITY), 0.0);
    }

    #[test]
    fn functions_agree_with_f64() {
        agree_with_f64::<false>();
        agree_with_f64::<true>();
    }

    #[test]
    fn what_is_no_number_stays_none() {
        for function in [
            exp_non_positive::<false>,
            exp_m1_of_small::<false>,
            sigmoid::<false>,
            softplus::<false>,
            exp_non_positive::<true>,
            exp_m1_of_small::<true>,
            sigmoid::<true>,
            softplus::<true>,
        ] {
            assert!(function(f32::NAN).is_nan());
        }
    }
}
