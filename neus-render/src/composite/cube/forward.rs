//! Pixels: one thread walks a ray from front to back.

use gpu_tensors::cubecl;

use super::opacity::{log_survival, nothing, opacity};
use super::{Kinds, Starts, factor_of_colour, factor_of_opacity, parameters, ray_at};
use crate::composite::{MatteRole, background_column, column, object_column};
use cubecl::prelude::*;

/// One thread per ray; writes all columns of its pixel.
#[cube(launch_unchecked)]
pub(super) fn forward_kernel(
    object: &[f32],
    background: &[f32],
    sharpness: &[f32],
    index: &[u32],
    times: &[f32],
    marks: &[f32],
    out: &mut [f32],
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
        let mut object_row = ray.object;
        let mut background_row = ray.background;
        let mut joint = 1.0f32;
        let mut alone_f = 1.0f32;
        let mut alone_b = 1.0f32;
        let mut object_log = 0.0f32;
        let mut matte = 0.0f32;
        let mut joint_depth = 0.0f32;
        let mut object_depth = 0.0f32;
        let mut mark0 = 0.0f32;
        let mut mark1 = 0.0f32;
        let mut held = 0.0f32;
        let mut held_alone = 0.0f32;
        let mut joint_colour = Array::<f32>::new(3usize);
        let mut object_colour = Array::<f32>::new(3usize);
        let mut background_colour = Array::<f32>::new(3usize);
        for interval in ray.first..ray.end {
            let t = times[2 * interval];
            let dt = times[2 * interval + 1];
            let mut f = nothing();
            let mut b = nothing();
            let mut has_f = false;
            let mut has_b = false;
            if object_row < ray.object_end {
                has_f = index[ray.object_index + object_row] as usize == interval;
            }
            if background_row < ray.background_end {
                has_b = index[ray.background_index + background_row] as usize == interval;
            }
            let at_f = object_row * comptime!(kinds.object_width);
            let at_b = background_row * comptime!(kinds.background_width);
            if has_f {
                let sdf = object[at_f + comptime!(object_column::SDF)];
                let slope = object[at_f + comptime!(object_column::SLOPE)];
                let log = log_survival(&of_object, sdf, slope, dt, kinds.object);
                let value = object[at_f + comptime!(object_column::MATTE)];
                f = opacity(log, factor_of_opacity(value, kinds.matte));
            }
            if has_b {
                let sdf = background[at_b + comptime!(background_column::SDF)];
                let slope = background[at_b + comptime!(background_column::SLOPE)];
                let log = log_survival(&of_background, sdf, slope, dt, kinds.background);
                b = opacity(log, 1.0f32);
            }
            let w_f = joint * f.alpha * (1.0f32 - 0.5f32 * b.alpha);
            let w_b = joint * b.alpha * (1.0f32 - 0.5f32 * f.alpha);
            if has_f {
                let weight = alone_f * f.alpha;
                let value = object[at_f + comptime!(object_column::MATTE)];
                let head = factor_of_colour(value, kinds.matte);
                for c in 0..3usize {
                    let colour = object[at_f + comptime!(object_column::COLOUR) + c];
                    joint_colour[c] += w_f * head * colour;
                    object_colour[c] += weight * head * colour;
                }
                if comptime!(kinds.matte == MatteRole::Colour) {
                    held += w_f * head;
                    held_alone += weight * head;
                }
                if comptime!(kinds.marked) {
                    mark0 += w_f * marks[2 * object_row];
                    mark1 += w_f * marks[2 * object_row + 1];
                }
                matte += w_f;
                object_depth += weight * t;
                object_row += 1;
            }
            if has_b {
                let weight = alone_b * b.alpha;
                for c in 0..3usize {
                    let colour = background[at_b + comptime!(background_column::COLOUR) + c];
                    joint_colour[c] += w_b * colour;
                    background_colour[c] += weight * colour;
                }
                if comptime!(kinds.marked) {
                    let row = starts.objects as usize + background_row;
                    mark0 += w_b * marks[2 * row];
                    mark1 += w_b * marks[2 * row + 1];
                }
                background_row += 1;
            }
            joint_depth += (w_f + w_b) * t;
            joint *= f.survival * b.survival;
            alone_f *= f.survival;
            alone_b *= b.survival;
            object_log += f.log;
        }
        let at = number * comptime!(column::COUNT);
        for c in 0..3usize {
            out[at + comptime!(column::JOINT_COLOUR) + c] = joint_colour[c];
            out[at + comptime!(column::OBJECT_COLOUR) + c] = object_colour[c];
            out[at + comptime!(column::BACKGROUND_COLOUR) + c] = background_colour[c];
        }
        out[at + comptime!(column::MATTE)] = matte;
        out[at + comptime!(column::OBJECT_OPACITY)] = 1.0f32 - alone_f;
        out[at + comptime!(column::OBJECT_LOG_TRANSMITTANCE)] = object_log;
        out[at + comptime!(column::BACKGROUND_OPACITY)] = 1.0f32 - alone_b;
        out[at + comptime!(column::JOINT_DEPTH)] = joint_depth;
        out[at + comptime!(column::OBJECT_DEPTH)] = object_depth;
        out[at + comptime!(column::JOINT_OPACITY)] = 1.0f32 - joint;
        out[at + comptime!(column::MARKS)] = mark0;
        out[at + comptime!(column::MARKS + 1)] = mark1;
        out[at + comptime!(column::HEAD)] = held;
        out[at + comptime!(column::HEAD_ALONE)] = held_alone;
    }
}
