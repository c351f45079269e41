//! One sample on the GPU: the same formulas as the CPU's, which say where they come from.

use gpu_tensors::{cubecl, exp_m1, ln_1p, sigmoid, softplus};

use cubecl::prelude::*;

/// How a field's samples become opacities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Kind {
    /// The first column is a density instead of a signed distance.
    pub(super) density: bool,
    /// The small constant is not zero.
    pub(super) epsilon: bool,
}

/// What a field's samples have in common.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Parameters {
    pub(super) sharpness: f32,
    pub(super) cos_anneal: f32,
    pub(super) log_epsilon: f32,
}

/// What one sample does to light.
#[derive(CubeType, CubeTypeMut, Clone, Copy)]
pub(super) struct Opacity {
    /// Including the matte value.
    pub(super) alpha: f32,
    /// `1 - alpha`, exact where alpha is near one.
    pub(super) survival: f32,
    /// `log(1 - alpha)`.
    pub(super) log: f32,
    /// Without the matte value: `a`.
    pub(super) bare_alpha: f32,
    /// The derivative of `log` by the logarithm without the matte value.
    pub(super) log_slope: f32,
}

/// Gradients of one sample.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Chain {
    pub(super) sdf: f32,
    pub(super) slope: f32,
    pub(super) sharpness: f32,
}

/// `x`, or zero where it is less. By a comparison, as on the CPU: `max` may drop what is no number.
#[cube]
fn at_least_zero(x: f32) -> f32 {
    select(x < 0.0f32, 0.0f32, x)
}

/// `x`, or zero where it is more.
#[cube]
fn at_most_zero(x: f32) -> f32 {
    select(x > 0.0f32, 0.0f32, x)
}

#[cube]
fn annealed_slope(slope: f32, cos_anneal: f32) -> f32 {
    let soft = at_least_zero(0.5f32 - 0.5f32 * slope);
    let hard = at_least_zero(-slope);
    -(soft * (1.0f32 - cos_anneal) + hard * cos_anneal)
}

/// `log(1 - a)` without the matte value.
#[cube]
pub(super) fn log_survival(
    parameters: &Parameters,
    sdf: f32,
    slope: f32,
    dt: f32,
    #[comptime] kind: Kind,
) -> f32 {
    if comptime!(kind.density) {
        -at_least_zero(sdf) * dt
    } else {
        let half = 0.5f32 * dt * annealed_slope(slope, parameters.cos_anneal);
        let s = parameters.sharpness;
        let before = softplus(-s * (sdf - half));
        let after = softplus(-s * (sdf + half));
        let mut log = before - after;
        if comptime!(kind.epsilon) {
            log -= softplus(before + parameters.log_epsilon);
        }
        at_most_zero(log)
    }
}

/// No sample.
#[cube]
pub(super) fn nothing() -> Opacity {
    Opacity {
        alpha: 0.0f32,
        survival: 1.0f32,
        log: 0.0f32,
        bare_alpha: 0.0f32,
        log_slope: 1.0f32,
    }
}

/// From `log(1 - a)` and the matte value.
#[cube]
pub(super) fn opacity(log: f32, matte: f32) -> Opacity {
    // The smaller of the two keeps its digits, and the other follows from it.
    let thin = log > -0.7f32;
    let decay = log.exp();
    let thin_alpha = -exp_m1(log);
    let bare_alpha = select(thin, thin_alpha, 1.0f32 - decay);
    let bare_survival = select(thin, 1.0f32 - thin_alpha, decay);
    // `clamp` may drop what is no number, too.
    let matte = select(
        matte > 1.0f32,
        1.0f32,
        select(matte < 0.0f32, 0.0f32, matte),
    );
    let whole = matte == 1.0f32;
    let alpha = matte * bare_alpha;
    let survival = (1.0f32 - matte) + matte * bare_survival;
    let fits = alpha < 0.5f32;
    let mixed = select(
        fits,
        ln_1p(-select(fits, alpha, 0.0f32)),
        select(fits, 1.0f32, survival).ln(),
    );
    Opacity {
        alpha: select(whole, bare_alpha, alpha),
        survival: select(whole, bare_survival, survival),
        log: select(whole, log, mixed),
        bare_alpha,
        log_slope: select(whole, 1.0f32, matte * bare_survival / survival),
    }
}

/// From the loss per unit of `log(1 - a)` to that per unit of the inputs.
#[cube]
pub(super) fn chain(
    parameters: &Parameters,
    sdf: f32,
    slope: f32,
    dt: f32,
    g_log: f32,
    #[comptime] kind: Kind,
) -> Chain {
    if comptime!(kind.density) {
        Chain {
            sdf: select(sdf <= 0.0f32, 0.0f32, -dt * g_log),
            slope: 0.0f32,
            sharpness: 0.0f32,
        }
    } else {
        let s = parameters.sharpness;
        let anneal = parameters.cos_anneal;
        let half = 0.5f32 * dt * annealed_slope(slope, anneal);
        let (first, last) = (sdf - half, sdf + half);
        let mut g_before = g_log;
        if comptime!(kind.epsilon) {
            g_before = g_log * sigmoid(-(softplus(-s * first) + parameters.log_epsilon));
        }
        let g_u = -g_before * sigmoid(-s * first);
        let g_v = g_log * sigmoid(-s * last);
        let g_half = s * (g_v - g_u);
        let soft = select(slope < 1.0f32, 0.5f32, 0.0f32);
        let hard = select(slope < 0.0f32, 1.0f32, 0.0f32);
        Chain {
            sdf: s * (g_u + g_v),
            slope: 0.5f32 * dt * g_half * (soft * (1.0f32 - anneal) + hard * anneal),
            sharpness: g_u * first + g_v * last,
        }
    }
}
