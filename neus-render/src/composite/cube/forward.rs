//! Pixels: a workgroup takes a ray, and its threads an interval each, tile after tile.

use gpu_tensors::cubecl;

use super::interval::{factor_of_colour, interval_at, ray_at, weights};
use super::workgroup::{Combined, Pair, SCAN, UNITS, column_sum, columns_size, scan};
use super::{Kinds, Starts, parameters};
use crate::composite::{MatteRole, background_column, column, object_column};
use cubecl::prelude::*;

/// One workgroup per ray; writes all columns of its pixel.
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
    let mut scanned = Shared::<[f32]>::new_slice(comptime!(SCAN));
    let mut summed = Shared::<[f32]>::new_slice(comptime!(columns_size(column::COUNT)));
    let unit = UNIT_POS as usize;
    let ray = ray_at(index, &starts, CUBE_POS);
    let of_object = parameters(sharpness, 0usize, cos_anneal, log_epsilon);
    let of_background = parameters(sharpness, 1usize, cos_anneal, log_epsilon);
    // What this thread's intervals add to the pixel.
    let mut pixel = Array::<f32>::new(comptime!(column::COUNT));
    #[unroll]
    for c in 0..comptime!(column::COUNT) {
        pixel[c] = 0.0f32;
    }
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
        let w = weights(
            &here.f,
            &here.b,
            light.before.object,
            light.before.background,
        );
        if here.has_f {
            let at = here.object_row * comptime!(kinds.object_width);
            let value = object[at + comptime!(object_column::MATTE)];
            let head = factor_of_colour(value, kinds.matte);
            #[unroll]
            for c in 0..3usize {
                let colour = object[at + comptime!(object_column::COLOUR + c)];
                pixel[comptime!(column::JOINT_COLOUR + c)] += w.f * head * colour;
                pixel[comptime!(column::OBJECT_COLOUR + c)] += w.f_alone * head * colour;
            }
            if comptime!(kinds.matte == MatteRole::Colour) {
                pixel[comptime!(column::HEAD)] += w.f * head;
                pixel[comptime!(column::HEAD_ALONE)] += w.f_alone * head;
            }
            if comptime!(kinds.marked) {
                let row = here.object_row;
                pixel[comptime!(column::MARKS)] += w.f * marks[2 * row];
                pixel[comptime!(column::MARKS + 1)] += w.f * marks[2 * row + 1];
            }
            pixel[comptime!(column::MATTE)] += w.f;
            pixel[comptime!(column::OBJECT_DEPTH)] += w.f_alone * here.t;
            pixel[comptime!(column::OBJECT_LOG_TRANSMITTANCE)] += here.f.log;
        }
        if here.has_b {
            let at = here.background_row * comptime!(kinds.background_width);
            #[unroll]
            for c in 0..3usize {
                let colour = background[at + comptime!(background_column::COLOUR + c)];
                pixel[comptime!(column::JOINT_COLOUR + c)] += w.b * colour;
                pixel[comptime!(column::BACKGROUND_COLOUR + c)] += w.b_alone * colour;
            }
            if comptime!(kinds.marked) {
                let row = starts.objects as usize + here.background_row;
                pixel[comptime!(column::MARKS)] += w.b * marks[2 * row];
                pixel[comptime!(column::MARKS + 1)] += w.b * marks[2 * row + 1];
            }
        }
        pixel[comptime!(column::JOINT_DEPTH)] += (w.f + w.b) * here.t;
        alone_f = light.all.object;
        alone_b = light.all.background;
    }
    // All threads know how much light is left, and one says so.
    if unit == 0 {
        pixel[comptime!(column::OBJECT_OPACITY)] = 1.0f32 - alone_f;
        pixel[comptime!(column::BACKGROUND_OPACITY)] = 1.0f32 - alone_b;
        pixel[comptime!(column::JOINT_OPACITY)] = 1.0f32 - alone_f * alone_b;
    }
    let sum = column_sum(&mut summed, &pixel, ray.used, comptime!(column::COUNT));
    if CUBE_POS < starts.rays as usize && unit < comptime!(column::COUNT) {
        out[CUBE_POS * comptime!(column::COUNT) + unit] = sum;
    }
}
