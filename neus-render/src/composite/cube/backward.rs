//! Gradients: a workgroup goes through a ray's tiles from front to back, leaving the transmittances, and back
//! again with the sums of what later intervals contribute.

use gpu_tensors::cubecl;

use super::interval::{Interval, Weights, factor_of_colour, interval_at, ray_at, weights};
use super::opacity::{Parameters, chain};
use super::workgroup::{Combined, Pair, SCAN, UNITS, column_sum, columns_size, scan};
use super::{KEPT, Kinds, Starts, parameters};
use crate::composite::{LEAST_SURVIVAL, MatteRole, background_column, column, object_column};
use cubecl::prelude::*;

/// The smallest normal number; below it devices may round to zero.
const TINY: f32 = f32::MIN_POSITIVE;

/// Loss per unit of an interval's weights: `w_F`, `w_B`, and of each field alone.
#[derive(CubeType, Clone, Copy)]
struct Per {
    f: f32,
    f_alone: f32,
    b: f32,
    b_alone: f32,
    /// What the object's colour is multiplied by, and the loss per unit of that times the weights.
    head: f32,
    of_head: f32,
    of_head_alone: f32,
}

/// The product of three values of `a` with three of `b`.
#[cube]
fn dot3(a: &[f32], at_a: usize, b: &[f32], at_b: usize) -> f32 {
    a[at_a] * b[at_b] + a[at_a + 1] * b[at_b + 1] + a[at_a + 2] * b[at_b + 2]
}

/// From the gradient of the pixel that begins at `pixel`.
#[cube]
fn loss_per_weight(
    object: &[f32],
    background: &[f32],
    marks: &[f32],
    grad: &[f32],
    pixel: usize,
    here: &Interval,
    starts: &Starts,
    #[comptime] kinds: Kinds,
) -> Per {
    let at_joint = pixel + comptime!(column::JOINT_COLOUR);
    let g_mark0 = grad[pixel + comptime!(column::MARKS)];
    let g_mark1 = grad[pixel + comptime!(column::MARKS + 1)];
    let g_depth = grad[pixel + comptime!(column::JOINT_DEPTH)] * here.t;
    let mut per_f = 0.0f32;
    let mut per_f_alone = 0.0f32;
    let mut per_b = 0.0f32;
    let mut per_b_alone = 0.0f32;
    let mut head = 1.0f32;
    let mut per_head = 0.0f32;
    let mut per_head_alone = 0.0f32;
    if here.has_f {
        let at = here.object_row * comptime!(kinds.object_width);
        let colour = at + comptime!(object_column::COLOUR);
        let at_object = pixel + comptime!(column::OBJECT_COLOUR);
        per_head = dot3(grad, at_joint, object, colour);
        per_head_alone = dot3(grad, at_object, object, colour);
        if comptime!(kinds.matte == MatteRole::Colour) {
            per_head += grad[pixel + comptime!(column::HEAD)];
            per_head_alone += grad[pixel + comptime!(column::HEAD_ALONE)];
        }
        let value = object[at + comptime!(object_column::MATTE)];
        head = factor_of_colour(value, kinds.matte);
        per_f = g_depth + grad[pixel + comptime!(column::MATTE)] + head * per_head;
        let g_object_depth = grad[pixel + comptime!(column::OBJECT_DEPTH)];
        per_f_alone = g_object_depth * here.t + head * per_head_alone;
        if comptime!(kinds.marked) {
            let row = here.object_row;
            per_f += g_mark0 * marks[2 * row] + g_mark1 * marks[2 * row + 1];
        }
    }
    if here.has_b {
        let at = here.background_row * comptime!(kinds.background_width);
        let colour = at + comptime!(background_column::COLOUR);
        let at_background = pixel + comptime!(column::BACKGROUND_COLOUR);
        per_b = g_depth + dot3(grad, at_joint, background, colour);
        per_b_alone = dot3(grad, at_background, background, colour);
        if comptime!(kinds.marked) {
            let row = starts.objects as usize + here.background_row;
            per_b += g_mark0 * marks[2 * row] + g_mark1 * marks[2 * row + 1];
        }
    }
    Per {
        f: per_f,
        f_alone: per_f_alone,
        b: per_b,
        b_alone: per_b_alone,
        head,
        of_head: per_head,
        of_head_alone: per_head_alone,
    }
}

/// Writes the object's row and returns its share of the sharpness' gradient. `light` is what is left of it before the
/// interval, `behind` the loss per unit of `log(1 - a)` through what lies behind.
#[cube]
fn object_gradients(
    object: &[f32],
    grad: &[f32],
    d_object: &mut [f32],
    pixel: usize,
    here: &Interval,
    per: &Per,
    w: &Weights,
    light: &Pair,
    behind: f32,
    parameters: &Parameters,
    #[comptime] kinds: Kinds,
) -> f32 {
    let at = here.object_row * comptime!(kinds.object_width);
    let at_joint = pixel + comptime!(column::JOINT_COLOUR);
    let at_object = pixel + comptime!(column::OBJECT_COLOUR);
    let g_log = grad[pixel + comptime!(column::OBJECT_LOG_TRANSMITTANCE)];
    let survival = here.f.survival;
    let joint = light.object * light.background;
    // Loss per unit of a_F within this interval.
    let inside = joint * (per.f * (1.0f32 - 0.5f32 * here.b.alpha) - 0.5f32 * per.b * here.b.alpha)
        + light.object * per.f_alone;
    let g_l = behind + g_log - survival * inside;
    let back = chain(
        parameters,
        object[at + comptime!(object_column::SDF)],
        object[at + comptime!(object_column::SLOPE)],
        here.dt,
        g_l * here.f.log_slope,
        kinds.object,
    );
    d_object[at + comptime!(object_column::SDF)] = back.sdf;
    d_object[at + comptime!(object_column::SLOPE)] = back.slope;
    #[unroll]
    for c in 0..3usize {
        d_object[at + comptime!(object_column::COLOUR + c)] =
            per.head * (w.f * grad[at_joint + c] + w.f_alone * grad[at_object + c]);
    }
    if comptime!(kinds.matte == MatteRole::Colour) {
        d_object[at + comptime!(object_column::MATTE)] =
            w.f * per.of_head + w.f_alone * per.of_head_alone;
    }
    if comptime!(kinds.matte == MatteRole::Opacity) {
        // What lies behind is proportional to the survival, so its quotient is bounded.
        d_object[at + comptime!(object_column::MATTE)] = here.f.bare_alpha
            * (inside
                - behind / max(survival, comptime!(TINY))
                - g_log / max(survival, comptime!(LEAST_SURVIVAL)));
    }
    back.sharpness
}

/// As [`object_gradients`], for the background.
#[cube]
fn background_gradients(
    background: &[f32],
    grad: &[f32],
    d_background: &mut [f32],
    pixel: usize,
    here: &Interval,
    per: &Per,
    w: &Weights,
    light: &Pair,
    behind: f32,
    parameters: &Parameters,
    #[comptime] kinds: Kinds,
) -> f32 {
    let at = here.background_row * comptime!(kinds.background_width);
    let at_joint = pixel + comptime!(column::JOINT_COLOUR);
    let at_background = pixel + comptime!(column::BACKGROUND_COLOUR);
    let joint = light.object * light.background;
    let inside = joint * (per.b * (1.0f32 - 0.5f32 * here.f.alpha) - 0.5f32 * per.f * here.f.alpha)
        + light.background * per.b_alone;
    let back = chain(
        parameters,
        background[at + comptime!(background_column::SDF)],
        background[at + comptime!(background_column::SLOPE)],
        here.dt,
        behind - here.b.survival * inside,
        kinds.background,
    );
    d_background[at + comptime!(background_column::SDF)] = back.sdf;
    d_background[at + comptime!(background_column::SLOPE)] = back.slope;
    #[unroll]
    for c in 0..3usize {
        d_background[at + comptime!(background_column::COLOUR + c)] =
            w.b * grad[at_joint + c] + w.b_alone * grad[at_background + c];
    }
    back.sharpness
}

/// One workgroup per ray; writes its rows of both gradients and its share of the sharpnesses'.
#[cube(launch_unchecked)]
pub(super) fn backward_kernel(
    object: &[f32],
    background: &[f32],
    sharpness: &[f32],
    index: &[u32],
    times: &[f32],
    marks: &[f32],
    grad: &[f32],
    kept: &mut [f32],
    d_object: &mut [f32],
    d_background: &mut [f32],
    d_sharpness: &mut [f32],
    starts: Starts,
    cos_anneal: f32,
    log_epsilon: f32,
    #[comptime] kinds: Kinds,
) {
    let mut scanned = Shared::<[f32]>::new_slice(comptime!(SCAN));
    let mut summed = Shared::<[f32]>::new_slice(comptime!(columns_size(2)));
    let unit = UNIT_POS as usize;
    let ray = ray_at(index, &starts, CUBE_POS);
    let of_object = parameters(sharpness, 0usize, cos_anneal, log_epsilon);
    let of_background = parameters(sharpness, 1usize, cos_anneal, log_epsilon);

    let mut alone_f = 1.0f32;
    let mut alone_b = 1.0f32;
    for tile in 0..ray.tiles {
        let number = ray.first + tile * UNITS + unit;
        let here = interval_at(
            object,
            background,
            index,
            times,
            &ray,
            number,
            &of_object,
            &of_background,
            kinds,
        );
        let survival = Pair {
            object: here.f.survival,
            background: here.b.survival,
        };
        let so_far = Pair {
            object: alone_f,
            background: alone_b,
        };
        let light = scan(&mut scanned, unit, survival, so_far, Combined::Product);
        // For the same thread alone, on its way back.
        if number < ray.end {
            kept[number * comptime!(KEPT)] = light.before.object;
            kept[number * comptime!(KEPT) + 1] = light.before.background;
        }
        alone_f = light.all.object;
        alone_b = light.all.background;
    }

    // Loss per unit of log(1 - a) of either field through what lies behind: through the joint weights and its own, with
    // the opacities' share first. Workgroups beyond the rays have no pixel.
    let mut behind_f = 0.0f32;
    let mut behind_b = 0.0f32;
    let pixel = CUBE_POS * comptime!(column::COUNT);
    if CUBE_POS < starts.rays as usize {
        let joint = -grad[pixel + comptime!(column::JOINT_OPACITY)] * alone_f * alone_b;
        behind_f = joint - grad[pixel + comptime!(column::OBJECT_OPACITY)] * alone_f;
        behind_b = joint - grad[pixel + comptime!(column::BACKGROUND_OPACITY)] * alone_b;
    }
    let mut of_sharpness = Array::<f32>::new(2usize);
    of_sharpness[0] = 0.0f32;
    of_sharpness[1] = 0.0f32;
    for step in 0..ray.tiles {
        let number = ray.first + (ray.tiles - 1 - step) * UNITS + unit;
        let here = interval_at(
            object,
            background,
            index,
            times,
            &ray,
            number,
            &of_object,
            &of_background,
            kinds,
        );
        let mut light_f = 0.0f32;
        let mut light_b = 0.0f32;
        if number < ray.end {
            light_f = kept[number * comptime!(KEPT)];
            light_b = kept[number * comptime!(KEPT) + 1];
        }
        let light = Pair {
            object: light_f,
            background: light_b,
        };
        let w = weights(&here.f, &here.b, light_f, light_b);
        let per = loss_per_weight(
            object, background, marks, grad, pixel, &here, &starts, kinds,
        );
        let joint = per.f * w.f + per.b * w.b;
        let own = Pair {
            object: joint + per.f_alone * w.f_alone,
            background: joint + per.b_alone * w.b_alone,
        };
        let so_far = Pair {
            object: behind_f,
            background: behind_b,
        };
        // The last thread's interval comes first.
        let position = comptime!(UNITS - 1) - unit;
        let behind = scan(&mut scanned, position, own, so_far, Combined::Sum);
        if here.has_f {
            of_sharpness[0] += object_gradients(
                object,
                grad,
                d_object,
                pixel,
                &here,
                &per,
                &w,
                &light,
                behind.before.object,
                &of_object,
                kinds,
            );
        }
        if here.has_b {
            of_sharpness[1] += background_gradients(
                background,
                grad,
                d_background,
                pixel,
                &here,
                &per,
                &w,
                &light,
                behind.before.background,
                &of_background,
                kinds,
            );
        }
        behind_f = behind.all.object;
        behind_b = behind.all.background;
    }
    let sum = column_sum(&mut summed, &of_sharpness, ray.used, 2usize);
    if CUBE_POS < starts.rays as usize && unit < 2 {
        d_sharpness[2 * CUBE_POS + unit] = sum;
    }
}
