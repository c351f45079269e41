//! How moments are kept.

use serde::{Deserialize, Serialize};

use crate::sparse_grad::BLOCK_VALUES;

/// A block's first moments, then its second ones: next to each other, two cache lines or one.
pub(super) const STATE: usize = 2 * BLOCK_VALUES;

/// How a CPU keeps the moments of [`LazyAdam`](crate::LazyAdam).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MomentPrecision {
    /// As `f32`.
    #[default]
    Single,
    /// As bfloat16: `f32` without the lower half of its bits.
    ///
    /// A step on a table of which most is touched waits for memory; this moves a third less of it. A
    /// value is rounded up as often as its distance to the lower neighbour says: to the nearest, the
    /// second moment would stand still where a step changes it by less than half of its last bit, within
    /// 40 % of where it is going. What decides is a hash of the value and the step, so that a run
    /// repeated has the same bits.
    Half,
}

/// Both moments of all blocks, `[blocks, 2, 16]`.
#[derive(Clone, Debug)]
pub(super) enum Moments {
    Single(Vec<f32>),
    Half(Vec<u16>),
}

impl Moments {
    pub(super) fn zeros(precision: MomentPrecision, count: usize) -> Self {
        match precision {
            MomentPrecision::Single => Self::Single(vec![0.0; count]),
            MomentPrecision::Half => Self::Half(vec![0; count]),
        }
    }

    pub(super) fn of(precision: MomentPrecision, values: &[f32]) -> Self {
        match precision {
            MomentPrecision::Single => Self::Single(values.to_vec()),
            MomentPrecision::Half => {
                Self::Half(values.iter().map(|v| u16::rounded(*v, 0)).collect())
            }
        }
    }

    pub(super) fn values(&self) -> Vec<f32> {
        match self {
            Self::Single(values) => values.clone(),
            Self::Half(values) => values.iter().map(|v| v.value()).collect(),
        }
    }
}

/// What a moment is kept as.
pub(super) trait Stored: Copy + Send + Sync {
    fn value(self) -> f32;

    /// `value`, or one of its neighbours; `salt` and the value itself decide which.
    fn rounded(value: f32, salt: u32) -> Self;
}

impl Stored for f32 {
    #[inline(always)]
    fn value(self) -> f32 {
        self
    }

    #[inline(always)]
    fn rounded(value: f32, _salt: u32) -> Self {
        value
    }
}

/// The upper half of an `f32`.
impl Stored for u16 {
    #[inline(always)]
    fn value(self) -> f32 {
        f32::from_bits(u32::from(self) << 16)
    }

    #[inline(always)]
    fn rounded(value: f32, salt: u32) -> Self {
        let bits = value.to_bits();
        // The finaliser of MurmurHash3, halfway.
        let mixed = (bits ^ salt).wrapping_mul(0x85EB_CA6B);
        let noise = (mixed ^ (mixed >> 13)).wrapping_mul(0xC2B2_AE35) >> 16;
        // A value that can be kept as it is stays: its lower half is zero, and the noise below one.
        (bits.wrapping_add(noise) >> 16) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_right_on_average_and_keeps_what_fits() {
        for value in [1.0f32, 1.234_567, -0.003_21, 3.0e-21, 0.0] {
            let rounds = 20_000u32;
            let sum: f64 = (0..rounds)
                .map(|step| f64::from(u16::rounded(value, step.wrapping_mul(0x9E37_79B9)).value()))
                .sum();
            let error = sum / f64::from(rounds) - f64::from(value);
            // A bit of the upper half is 1/128 of the value at most; the mean of so many, 200 times less.
            assert!(
                error.abs() <= f64::from(value.abs()) / 128.0 * 0.02,
                "{value}: {error}"
            );
        }
        for fits in [0.0f32, -1.5, 3.25e-20] {
            let kept = u16::rounded(f32::from_bits(fits.to_bits() & 0xFFFF_0000), 77);
            assert_eq!(kept.value().to_bits(), fits.to_bits() & 0xFFFF_0000);
        }
    }
}
