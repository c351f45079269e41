//! A ray's intervals, and what stands in each of them.

use gpu_tensors::cubecl;

use super::opacity::{Kind, Opacity, Parameters, log_survival, nothing, opacity};
use super::workgroup::UNITS;
use super::{Kinds, Starts};
use crate::composite::{MatteRole, background_column, object_column};
use cubecl::prelude::*;

/// In the place of a row, where a field has no sample in an interval.
pub(super) const NO_ROW: u32 = u32::MAX;

/// A ray's intervals.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Ray {
    pub(super) first: usize,
    pub(super) end: usize,
    /// Sets of as many intervals as a workgroup has threads, the last one perhaps not full.
    pub(super) tiles: usize,
    /// Threads with an interval in any tile.
    pub(super) used: usize,
    /// Where the intervals' rows begin in the index.
    rows: usize,
}

/// Of a workgroup's ray; one without intervals for workgroups beyond the rays.
#[cube]
pub(super) fn ray_at(index: &[u32], starts: &Starts, number: usize) -> Ray {
    let rays = starts.rays as usize;
    let mut first = 0usize;
    let mut end = 0usize;
    if number < rays {
        first = index[number] as usize;
        end = index[number + 1] as usize;
    }
    Ray {
        first,
        end,
        tiles: (end - first + comptime!(UNITS - 1)) / UNITS,
        used: min(end - first, UNITS),
        rows: rays + 1,
    }
}

/// What stands in an interval: rows are zero and opacities [`nothing`]'s where a field has no sample.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Interval {
    pub(super) t: f32,
    pub(super) dt: f32,
    pub(super) has_f: bool,
    pub(super) has_b: bool,
    pub(super) object_row: usize,
    pub(super) background_row: usize,
    pub(super) f: Opacity,
    pub(super) b: Opacity,
}

/// What stands in the interval of this number; nothing beyond the ray's end.
#[cube]
pub(super) fn interval_at(
    object: &[f32],
    background: &[f32],
    index: &[u32],
    times: &[f32],
    ray: &Ray,
    number: usize,
    of_object: &Parameters,
    of_background: &Parameters,
    #[comptime] kinds: Kinds,
) -> Interval {
    let mut t = 0.0f32;
    let mut dt = 0.0f32;
    let mut has_f = false;
    let mut has_b = false;
    let mut object_row = 0usize;
    let mut background_row = 0usize;
    let mut f = nothing();
    let mut b = nothing();
    if number < ray.end {
        t = times[2 * number];
        dt = times[2 * number + 1];
        let row_f = index[ray.rows + 2 * number];
        let row_b = index[ray.rows + 2 * number + 1];
        has_f = row_f != NO_ROW;
        has_b = row_b != NO_ROW;
        if has_f {
            object_row = row_f as usize;
            let at = object_row * comptime!(kinds.object_width);
            f = object_opacity(object, at, of_object, dt, kinds);
        }
        if has_b {
            background_row = row_b as usize;
            let at = background_row * comptime!(kinds.background_width);
            b = background_opacity(background, at, of_background, dt, kinds.background);
        }
    }
    Interval {
        t,
        dt,
        has_f,
        has_b,
        object_row,
        background_row,
        f,
        b,
    }
}

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

/// The object's matte value as a factor of its opacity.
#[cube]
fn factor_of_opacity(value: f32, #[comptime] matte: MatteRole) -> f32 {
    if comptime!(matte == MatteRole::Opacity) {
        value
    } else {
        1.0f32.runtime()
    }
}

/// The object's matte value as a factor of its colour.
#[cube]
pub(super) fn factor_of_colour(value: f32, #[comptime] matte: MatteRole) -> f32 {
    if comptime!(matte == MatteRole::Colour) {
        value
    } else {
        1.0f32.runtime()
    }
}

/// Shares of the pixel.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Weights {
    pub(super) f: f32,
    pub(super) b: f32,
    pub(super) f_alone: f32,
    pub(super) b_alone: f32,
}

/// Where so much of the light is left by each field alone, and their product by both.
#[cube]
pub(super) fn weights(f: &Opacity, b: &Opacity, alone_f: f32, alone_b: f32) -> Weights {
    let joint = alone_f * alone_b;
    Weights {
        f: joint * f.alpha * (1.0f32 - 0.5f32 * b.alpha),
        b: joint * b.alpha * (1.0f32 - 0.5f32 * f.alpha),
        f_alone: alone_f * f.alpha,
        b_alone: alone_b * b.alpha,
    }
}
