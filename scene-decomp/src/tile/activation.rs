//! Activations over a tile, as loops that the compiler turns into vector code.

use tensor_slices::elementary::{exp_non_positive, ln_1p_of_ratio};

pub(crate) use tensor_slices::elementary::sigmoid;

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
        *value = (t.max(0.0) + ln_1p_of_ratio(e * (one * shared))) * inverse;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn softplus_agrees_with_f64() {
        for i in -4000..=4000 {
            let x = i as f32 * 0.025;
            let (mut value, mut slope) = ([0.0], [0.0]);
            softplus(100.0, &[x / 100.0], &mut value, &mut slope);
            let t = 100.0 * f64::from(x / 100.0);
            let exact = t.exp().ln_1p().min(t.max(0.0) + 1.0) / 100.0;
            assert!(
                (f64::from(value[0]) - exact).abs() < 1e-8 + 2e-7 * exact,
                "softplus({x})"
            );
            let exact = 1.0 / (1.0 + (-t).exp());
            assert!((f64::from(slope[0]) - exact).abs() < 3e-7, "sigmoid({x})");
        }
    }
}
