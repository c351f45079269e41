//! Activations over a tile, as loops that the compiler turns into vector code.

use pulp::Simd;
use tensor_slices::elementary::{self, exp_of_moderate, ln_1p_of_unit};

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
pub(crate) fn softplus<S: Simd>(
    _simd: S,
    beta: f32,
    z: &[f32],
    value: &mut [f32],
    slope: &mut [f32],
) {
    // Vectors come with fused multiply-adds; on their own those would be calls.
    if S::IS_SCALAR {
        softplus_of::<false>(beta, z, value, slope);
    } else {
        softplus_of::<true>(beta, z, value, slope);
    }
}

#[inline(always)]
fn softplus_of<const FUSED: bool>(beta: f32, z: &[f32], value: &mut [f32], slope: &mut [f32]) {
    let inverse = 1.0 / beta;
    for ((&z, value), slope) in z.iter().zip(value).zip(slope) {
        let t = beta * z;
        let distance = t.abs();
        let near = if distance > FAR { FAR } else { distance };
        let e = exp_of_moderate::<FUSED>(-near);
        let e = if distance > FAR { 0.0 } else { e };
        let larger = 1.0 / (1.0 + e);
        *slope = if t >= 0.0 { larger } else { e * larger };
        let positive = if t > 0.0 { t } else { 0.0 };
        *value = (positive + ln_1p_of_unit::<FUSED>(e)) * inverse;
    }
}

/// The `slope` of [`softplus`] from its `value`: `sigmoid(t) = 1 - exp(-ln(1 + exp(t)))`, to a rounding of 1.
#[inline(always)]
pub(crate) fn slope_of_softplus<S: Simd>(_simd: S, beta: f32, value: &[f32], slope: &mut [f32]) {
    if S::IS_SCALAR {
        slope_of_softplus_of::<false>(beta, value, slope);
    } else {
        slope_of_softplus_of::<true>(beta, value, slope);
    }
}

#[inline(always)]
fn slope_of_softplus_of<const FUSED: bool>(beta: f32, value: &[f32], slope: &mut [f32]) {
    for (&value, slope) in value.iter().zip(slope) {
        let t = beta * value;
        let near = if t > FAR { FAR } else { t };
        *slope = 1.0 - exp_of_moderate::<FUSED>(-near);
    }
}

/// `values` become `1 / (1 + exp(-values))`.
#[inline(always)]
pub(crate) fn sigmoid<S: Simd>(_simd: S, values: &mut [f32]) {
    if S::IS_SCALAR {
        for value in values {
            *value = elementary::sigmoid::<false>(*value);
        }
    } else {
        for value in values {
            *value = elementary::sigmoid::<true>(*value);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn softplus_agrees_with_f64<const FUSED: bool>() {
        for i in -4000..=4000 {
            let x = i as f32 * 0.025;
            let (mut value, mut slope) = ([0.0], [0.0]);
            softplus_of::<FUSED>(100.0, &[x / 100.0], &mut value, &mut slope);
            let t = 100.0 * f64::from(x / 100.0);
            let exact = t.exp().ln_1p().min(t.max(0.0) + 1.0) / 100.0;
            assert!(
                (f64::from(value[0]) - exact).abs() < 1e-8 + 2e-7 * exact,
                "softplus({x})"
            );
            let exact = 1.0 / (1.0 + (-t).exp());
            assert!((f64::from(slope[0]) - exact).abs() < 3e-7, "sigmoid({x})");
            slope_of_softplus_of::<FUSED>(100.0, &value, &mut slope);
            assert!((f64::from(slope[0]) - exact).abs() < 4e-7, "sigmoid({x})");
        }
    }

    #[test]
    fn poison_does_not_become_a_number() {
        let (mut value, mut slope) = ([0.0; 3], [0.0; 3]);
        let poison = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        softplus_of::<true>(100.0, &poison, &mut value, &mut slope);
        assert!(value[0].is_nan());
        assert_eq!((value[1], slope[1]), (f32::INFINITY, 1.0));
        assert_eq!((value[2], slope[2]), (0.0, 0.0));
        slope_of_softplus_of::<true>(100.0, &value, &mut slope);
        assert!(slope[0].is_nan());
        assert_eq!(slope[1..], [1.0, 0.0]);
    }

    #[test]
    fn softplus_is_right_with_and_without_fused_products() {
        softplus_agrees_with_f64::<false>();
        softplus_agrees_with_f64::<true>();
    }
}
