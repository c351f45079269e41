//! Activations over a tile, as loops that the compiler turns into vector code.

/// `exp(x)` for `x <= 0`, to about 2 ulp; below -87 it is zero.
#[inline(always)]
pub(crate) fn exp_non_positive(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    // ln 2 in two parts, so that x - k ln 2 keeps its low bits.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to an integer
    let x = x.max(-87.0);
    let shifted = x * LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = x - k * LN2_HIGH - k * LN2_LOW;
    // Taylor's polynomial on |r| <= ln 2 / 2; its seventh-order remainder is below 2^-25.
    let p = 1.0
        + r * (1.0
            + r * (0.5
                + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))));
    let bits = shifted.to_bits().wrapping_shl(23);
    let scale = f32::from_bits(bits.wrapping_add(0x3f80_0000));
    if x <= -87.0 { 0.0 } else { p * scale }
}

/// `ln(1 + e)` for `u = e / (2 + e)` with `e` in `[0, 1]`, by the series of `2 atanh(u)`.
#[inline(always)]
fn ln_1p_of(u: f32) -> f32 {
    let v = u * u;
    2.0 * u
        * (1.0
            + v * (1.0 / 3.0
                + v * (1.0 / 5.0
                    + v * (1.0 / 7.0 + v * (1.0 / 9.0 + v * (1.0 / 11.0 + v * (1.0 / 13.0)))))))
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    let e = exp_non_positive(-x.abs());
    let larger = 1.0 / (1.0 + e);
    if x >= 0.0 { larger } else { e * larger }
}

/// `exp(-FAR)` squared is still a normal number.
const FAR: f32 = 40.0;

/// `value = softplus_beta(z)` and `slope = sigmoid(beta z)`, its derivative.
///
/// softplus_beta(z) = ln(1 + exp(beta z)) / beta.
///
/// Where `|beta z|` is above [`FAR`] the exponential counts as zero, less than rounding to both.
/// Its square would be subnormal, and so would what later layers make of it: processors that leave
/// these numbers to microcode took half of a training step for them.
#[inline(always)]
pub(crate) fn softplus(beta: f32, z: &[f32], value: &mut [f32], slope: &mut [f32]) {
    let inverse = 1.0 / beta;
    for ((&z, value), slope) in z.iter().zip(value).zip(slope) {
        let t = beta * z;
        let e = if t.abs() > FAR {
            0.0
        } else {
            exp_non_positive(-t.abs())
        };
        // A division takes as long as a dozen products, so 1 / (1 + e) and e / (2 + e) share one.
        let (one, two) = (1.0 + e, 2.0 + e);
        let shared = 1.0 / (one * two);
        let larger = two * shared;
        *slope = if t >= 0.0 { larger } else { e * larger };
        *value = (t.max(0.0) + ln_1p_of(e * (one * shared))) * inverse;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn activations_agree_with_f64() {
        for i in -4000..=4000 {
            let x = i as f32 * 0.025;
            let exact = 1.0 / (1.0 + (-f64::from(x)).exp());
            assert!((f64::from(sigmoid(x)) - exact).abs() < 2e-7, "sigmoid({x})");
            let (mut value, mut slope) = ([0.0], [0.0]);
            softplus(100.0, &[x / 100.0], &mut value, &mut slope);
            let t = 100.0 * f64::from(x / 100.0);
            let exact = t.exp().ln_1p().min(t.max(0.0) + 1.0) / 100.0;
            assert!(
                (f64::from(value[0]) - exact).abs() < 1e-8 + 2e-7 * exact,
                "softplus({x})"
            );
            if x <= 0.0 {
                let relative = f64::from(exp_non_positive(x)) / f64::from(x).exp() - 1.0;
                assert!(x < -86.0 || relative.abs() < 4e-7, "exp({x}): {relative:e}");
            }
        }
    }
}
