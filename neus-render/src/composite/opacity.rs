//! One sample: from a field's first two columns and a matte value to what the interval lets through,
//! and the way back for gradients.

use tensor_slices::elementary::{exp_m1_of_small, exp_non_positive, sigmoid, softplus};

use super::Transparency;
use crate::alpha::{NeusParameters, at_least_zero};

/// What one sample does to light.
#[derive(Clone, Copy)]
pub(super) struct Opacity {
    /// Including the matte value.
    pub(super) alpha: f32,
    /// `1 - alpha`, exact where alpha is near one.
    pub(super) survival: f32,
    /// `log(1 - alpha)`.
    pub(super) log: f32,
    /// Without the matte value: `1 - a` and `a`.
    pub(super) bare_survival: f32,
    pub(super) bare_alpha: f32,
    pub(super) matte: f32,
}

impl Opacity {
    pub(super) const NONE: Self = Self {
        alpha: 0.0,
        survival: 1.0,
        log: 0.0,
        bare_survival: 1.0,
        bare_alpha: 0.0,
        matte: 1.0,
    };

    #[inline]
    pub(super) fn new(log: f32, matte: f32) -> Self {
        // The smaller of the two keeps its digits, and the other follows from it.
        let (bare_alpha, bare_survival) = if log > -0.7 {
            let alpha = -exp_m1_of_small::<false>(log);
            (alpha, 1.0 - alpha)
        } else {
            let survival = exp_non_positive::<false>(log);
            (1.0 - survival, survival)
        };
        let matte = matte.clamp(0.0, 1.0);
        if matte == 1.0 {
            return Self {
                alpha: bare_alpha,
                survival: bare_survival,
                log,
                bare_survival,
                bare_alpha,
                matte,
            };
        }
        let alpha = matte * bare_alpha;
        let survival = (1.0 - matte) + matte * bare_survival;
        let log = if alpha < 0.5 {
            (-alpha).ln_1p()
        } else {
            survival.ln()
        };
        Self {
            alpha,
            survival,
            log,
            bare_survival,
            bare_alpha,
            matte,
        }
    }

    /// The derivative of `log` with respect to the logarithm without the matte value.
    #[inline]
    pub(super) fn log_slope(&self) -> f32 {
        if self.matte == 1.0 {
            1.0
        } else {
            self.matte * self.bare_survival / self.survival
        }
    }
}

/// From a field's first two columns to `log(1 - a)` and back.
pub(super) struct Kernel {
    transparency: Transparency,
    neus: NeusParameters,
    log_epsilon: f32,
}

/// Gradients of one sample.
pub(super) struct Chain {
    pub(super) sdf: f32,
    pub(super) slope: f32,
    pub(super) sharpness: f32,
}

impl Kernel {
    pub(super) fn new(transparency: Transparency, neus: NeusParameters) -> Self {
        Self {
            transparency,
            neus,
            log_epsilon: neus.log_epsilon(),
        }
    }

    #[inline(always)]
    pub(super) fn log_survival(&self, sdf: f32, slope: f32, dt: f32) -> f32 {
        match self.transparency {
            Transparency::Sdf => self.neus.log_survival(sdf, slope, dt, self.log_epsilon),
            Transparency::Density => -at_least_zero(sdf) * dt,
        }
    }

    /// From the loss per unit of `log(1 - a)` to that per unit of the inputs.
    #[inline]
    pub(super) fn backward(&self, sdf: f32, slope: f32, dt: f32, g_log: f32) -> Chain {
        if self.transparency == Transparency::Density {
            return Chain {
                sdf: if sdf <= 0.0 { 0.0 } else { -dt * g_log },
                slope: 0.0,
                sharpness: 0.0,
            };
        }
        let s = self.neus.sharpness;
        let half = 0.5 * dt * self.neus.annealed_slope(slope);
        let (first, last) = (sdf - half, sdf + half);
        // log(1 - a) = before - after - softplus(before + log e), before = softplus(-s first).
        let g_before = if self.log_epsilon == f32::NEG_INFINITY {
            g_log
        } else {
            g_log * sigmoid::<false>(-(softplus::<false>(-s * first) + self.log_epsilon))
        };
        let g_u = -g_before * sigmoid::<false>(-s * first);
        let g_v = g_log * sigmoid::<false>(-s * last);
        let g_half = s * (g_v - g_u);
        Chain {
            sdf: s * (g_u + g_v),
            slope: 0.5 * dt * g_half * self.neus.annealed_slope_derivative(slope),
            sharpness: g_u * first + g_v * last,
        }
    }
}
