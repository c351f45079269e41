//! Gradients: one thread walks a ray from front to back, leaving the transmittances, and back again
//! with the sums of what later intervals contribute.

use gpu_tensors::cubecl;

use super::opacity::{Kind, Opacity, Parameters, chain, log_survival, nothing, opacity};
use super::{KEPT, Kinds, Starts, factor_of_colour, factor_of_opacity, parameters, ray_at};
use crate::composite::{LEAST_SURVIVAL, MatteRole, background_column, column, object_column};
use cubecl::prelude::*;

/// The smallest normal number; below it devices may round to zero.
const TINY: f32 = f32::MIN_POSITIVE;

/// What a row of the object's does to light.
#[cube]
fn object_opacity(
    object: &[f32],
    at: usize,
    parameters: &Parameters,
    dt: f32,
    #[comptime] kinds: Kinds,
) -> Opacity {
    let sdf = object[at + comptime!(object_column::SDF)];
    let slope = object[at + comptime!(object_column::SLOPE)];
    let log = log_survival(parameters, sdf, slope, dt, kinds.object);
    let value = object[at + comptime!(object_column::MATTE)];
    opacity(log, factor_of_opacity(value, kinds.matte))
}

/// What a row of the background's does to light.
#[cube]
fn background_opacity(
    background: &[f32],
    at: usize,
    parameters: &Parameters,
    dt: f32,
    #[comptime] kind: Kind,
) -> Opacity {
    let sdf = background[at + comptime!(background_column::SDF)];
    let slope = background[at + comptime!(background_column::SLOPE)];
    opacity(log_survival(parameters, sdf, slope, dt, kind), 1.0f32)
}

/// The product of three values of `a` with three of `b`.
#[cube]
fn dot3(a: &[f32], at_a: usize, b: &[f32], at_b: usize) -> f32 {
    a[at_a] * b[at_b] + a[at_a + 1] * b[at_b + 1] + a[at_a + 2] * b[at_b + 2]
}

/// One thread per ray; writes its rows of both gradients and its share of the sharpnesses'.
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
    let number = ABSOLUTE_POS;
    if number < starts.rays as usize {
        let ray = ray_at(index, &starts, number);
        let of_object = parameters(sharpness, 0usize, cos_anneal, log_epsilon);
        let of_background = parameters(sharpness, 1usize, cos_anneal, log_epsilon);
        let columns_f = comptime!(kinds.object_width);
        let columns_b = comptime!(kinds.background_width);

        let mut object_row = ray.object;
        let mut background_row = ray.background;
        let mut joint = 1.0f32;
        let mut alone_f = 1.0f32;
        let mut alone_b = 1.0f32;
        for interval in ray.first..ray.end {
            let dt = times[2 * interval + 1];
            let at = interval * comptime!(KEPT);
            kept[at] = joint;
            kept[at + 1] = alone_f;
            kept[at + 2] = alone_b;
            let mut has_f = false;
            let mut has_b = false;
            if object_row < ray.object_end {
                has_f = index[ray.object_index + object_row] as usize == interval;
            }
            if background_row < ray.background_end {
                has_b = index[ray.background_index + background_row] as usize == interval;
            }
            if has_f {
                let at = object_row * columns_f;
                let f = object_opacity(object, at, &of_object, dt, kinds);
                joint *= f.survival;
                alone_f *= f.survival;
                object_row += 1;
            }
            if has_b {
                let at = background_row * columns_b;
                let b = background_opacity(background, at, &of_background, dt, kinds.background);
                joint *= b.survival;
                alone_b *= b.survival;
                background_row += 1;
            }
        }

        let pixel = number * comptime!(column::COUNT);
        let at_joint = pixel + comptime!(column::JOINT_COLOUR);
        let at_object = pixel + comptime!(column::OBJECT_COLOUR);
        let at_background = pixel + comptime!(column::BACKGROUND_COLOUR);
        let g_log = grad[pixel + comptime!(column::OBJECT_LOG_TRANSMITTANCE)];
        let g_mark0 = grad[pixel + comptime!(column::MARKS)];
        let g_mark1 = grad[pixel + comptime!(column::MARKS + 1)];
        let g_matte = grad[pixel + comptime!(column::MATTE)];
        let g_joint_depth = grad[pixel + comptime!(column::JOINT_DEPTH)];
        let g_object_depth = grad[pixel + comptime!(column::OBJECT_DEPTH)];
        // Loss per unit of log(1 - a) through what lies behind, with the opacities' share first.
        let mut behind_joint = -grad[pixel + comptime!(column::JOINT_OPACITY)] * joint;
        let mut behind_f = -grad[pixel + comptime!(column::OBJECT_OPACITY)] * alone_f;
        let mut behind_b = -grad[pixel + comptime!(column::BACKGROUND_OPACITY)] * alone_b;
        let mut sharpness_f = 0.0f32;
        let mut sharpness_b = 0.0f32;
        for step in 0..ray.end - ray.first {
            let interval = ray.end - 1 - step;
            let t = times[2 * interval];
            let dt = times[2 * interval + 1];
            let at = interval * comptime!(KEPT);
            let joint = kept[at];
            let alone_f = kept[at + 1];
            let alone_b = kept[at + 2];
            let mut has_f = false;
            let mut has_b = false;
            if object_row > ray.object {
                has_f = index[ray.object_index + object_row - 1] as usize == interval;
            }
            if background_row > ray.background {
                has_b = index[ray.background_index + background_row - 1] as usize == interval;
            }
            let g_depth = g_joint_depth * t;
            let mut f = nothing();
            let mut b = nothing();
            // Loss per unit of the weights: w_F, w_B, and of each field alone.
            let mut per_f = 0.0f32;
            let mut per_f_alone = 0.0f32;
            let mut per_head = 0.0f32;
            let mut per_head_alone = 0.0f32;
            let mut head = 1.0f32;
            let mut per_b = 0.0f32;
            let mut per_b_alone = 0.0f32;
            if has_f {
                object_row -= 1;
                let at = object_row * columns_f;
                let colour = at + comptime!(object_column::COLOUR);
                f = object_opacity(object, at, &of_object, dt, kinds);
                per_head = dot3(grad, at_joint, object, colour);
                per_head_alone = dot3(grad, at_object, object, colour);
                if comptime!(kinds.matte == MatteRole::Colour) {
                    per_head += grad[pixel + comptime!(column::HEAD)];
                    per_head_alone += grad[pixel + comptime!(column::HEAD_ALONE)];
                }
                let value = object[at + comptime!(object_column::MATTE)];
                head = factor_of_colour(value, kinds.matte);
                per_f = g_depth + g_matte + head * per_head;
                per_f_alone = g_object_depth * t + head * per_head_alone;
                if comptime!(kinds.marked) {
                    per_f += g_mark0 * marks[2 * object_row] + g_mark1 * marks[2 * object_row + 1];
                }
            }
            if has_b {
                background_row -= 1;
                let at = background_row * columns_b;
                let colour = at + comptime!(background_column::COLOUR);
                b = background_opacity(background, at, &of_background, dt, kinds.background);
                per_b = g_depth + dot3(grad, at_joint, background, colour);
                per_b_alone = dot3(grad, at_background, background, colour);
                if comptime!(kinds.marked) {
                    let row = starts.objects as usize + background_row;
                    per_b += g_mark0 * marks[2 * row] + g_mark1 * marks[2 * row + 1];
                }
            }
            let w_f = joint * f.alpha * (1.0f32 - 0.5f32 * b.alpha);
            let w_b = joint * b.alpha * (1.0f32 - 0.5f32 * f.alpha);
            let single_f = alone_f * f.alpha;
            let single_b = alone_b * b.alpha;
            if has_f {
                let at = object_row * columns_f;
                // Loss per unit of a_F within this interval.
                let here = joint * (per_f * (1.0f32 - 0.5f32 * b.alpha) - 0.5f32 * per_b * b.alpha)
                    + alone_f * per_f_alone;
                let behind = behind_joint + behind_f;
                let g_l = behind + g_log - f.survival * here;
                let back = chain(
                    &of_object,
                    object[at + comptime!(object_column::SDF)],
                    object[at + comptime!(object_column::SLOPE)],
                    dt,
                    g_l * f.log_slope,
                    kinds.object,
                );
                d_object[at + comptime!(object_column::SDF)] = back.sdf;
                d_object[at + comptime!(object_column::SLOPE)] = back.slope;
                sharpness_f += back.sharpness;
                for c in 0..3usize {
                    d_object[at + comptime!(object_column::COLOUR) + c] =
                        head * (w_f * grad[at_joint + c] + single_f * grad[at_object + c]);
                }
                if comptime!(kinds.matte == MatteRole::Colour) {
                    d_object[at + comptime!(object_column::MATTE)] =
                        w_f * per_head + single_f * per_head_alone;
                }
                if comptime!(kinds.matte == MatteRole::Opacity) {
                    // What lies behind is proportional to the survival, so its quotient is bounded.
                    d_object[at + comptime!(object_column::MATTE)] = f.bare_alpha
                        * (here
                            - behind / max(f.survival, comptime!(TINY))
                            - g_log / max(f.survival, comptime!(LEAST_SURVIVAL)));
                }
            }
            if has_b {
                let at = background_row * columns_b;
                let here = joint * (per_b * (1.0f32 - 0.5f32 * f.alpha) - 0.5f32 * per_f * f.alpha)
                    + alone_b * per_b_alone;
                let g_l = behind_joint + behind_b - b.survival * here;
                let back = chain(
                    &of_background,
                    background[at + comptime!(background_column::SDF)],
                    background[at + comptime!(background_column::SLOPE)],
                    dt,
                    g_l,
                    kinds.background,
                );
                d_background[at + comptime!(background_column::SDF)] = back.sdf;
                d_background[at + comptime!(background_column::SLOPE)] = back.slope;
                sharpness_b += back.sharpness;
                for c in 0..3usize {
                    d_background[at + comptime!(background_column::COLOUR) + c] =
                        w_b * grad[at_joint + c] + single_b * grad[at_background + c];
                }
            }
            behind_joint += per_f * w_f + per_b * w_b;
            behind_f += per_f_alone * single_f;
            behind_b += per_b_alone * single_b;
        }
        d_sharpness[2 * number] = sharpness_f;
        d_sharpness[2 * number + 1] = sharpness_b;
    }
}
