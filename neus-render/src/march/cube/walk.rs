//! A ray's way through both grids, step by step: the arithmetic is that of [`Marcher`](crate::march::Marcher),
//! which says what for.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use gpu_tensors::cubecl;

use super::path::{
    Grid, Path, Point, Steps, clamped, contracted, is_occupied, larger, point_at, smaller,
};
use crate::march::{CLEARANCE, DeviceIntervals};
use cubecl::prelude::*;

/// Steps ahead that are looked at for the object.
const AHEAD: u32 = CLEARANCE as u32;

/// The flags of an interval.
const OBJECT: u32 = DeviceIntervals::OBJECT;
const BACKGROUND: u32 = DeviceIntervals::BACKGROUND;

/// Raster lines beyond these cannot be told apart in `f32`.
const MOST_STEPS: f32 = 16_777_216.0;

/// Steps of equal length across the box; the first and the last are what is left of one.
#[derive(CubeType, Clone, Copy)]
struct Raster {
    begin: f32,
    end: f32,
    /// Where the first step ends.
    first: f32,
    step: f32,
}

/// The raster outside the box, in `d / (d + unit)`.
#[derive(CubeType, Clone, Copy)]
struct Outside {
    unit: f32,
    first: f32,
    step: f32,
}

/// Marches a ray with all steps `stretch` times as long, until there are `room` intervals, and returns their number;
/// `offset` in (0, 1] is where in the first step the raster's first line lies. With `write`, intervals go to the
/// places from `first` on.
#[cube]
pub(super) fn march_once(
    path: &Path,
    object: &[u32],
    background: &[u32],
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    first: u32,
    room: u32,
    offset: f32,
    stretch: f32,
    steps: &Steps,
    of_object: &Grid,
    of_background: &Grid,
    #[comptime] write: bool,
) -> u32 {
    let step = stretch * steps.outside;
    let outside = Outside {
        unit: path.unit,
        first: offset * step,
        step,
    };
    let end = first + room;
    let mut at = first;
    let has_background = of_background.resolution > 0;
    if has_background && path.enter - steps.near > 0.0f32 {
        at = approach(
            path,
            &outside,
            background,
            of_background,
            t,
            dt,
            flags,
            at,
            end,
            steps.near,
            write,
        );
    }
    if path.crosses {
        let step = stretch * steps.object;
        let raster = Raster {
            begin: path.enter,
            end: path.leave,
            first: path.enter + offset * step,
            step,
        };
        at = cross(
            path,
            &raster,
            object,
            of_object,
            background,
            of_background,
            t,
            dt,
            flags,
            at,
            end,
            steps.stride,
            write,
        );
    }
    if has_background && steps.behind_box == 1 && steps.far - path.leave > 0.0f32 {
        at = recede(
            path,
            &outside,
            background,
            of_background,
            t,
            dt,
            flags,
            at,
            end,
            steps.far,
            write,
        );
    }
    at - first
}

/// Writes an interval, if it is to be written.
#[cube]
fn put(
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    at: u32,
    from: f32,
    to: f32,
    flag: u32,
    #[comptime] write: bool,
) {
    if comptime!(write) {
        t[at as usize] = 0.5f32 * (from + to);
        dt[at as usize] = to - from;
        flags[at as usize] = flag;
    }
}

#[cube]
fn position(outside: &Outside, distance: f32) -> f32 {
    distance / (distance + outside.unit)
}

#[cube]
fn distance(outside: &Outside, line: f32) -> f32 {
    let position = outside.first + line * outside.step;
    outside.unit * position / larger(1e-7f32, 1.0f32 - position)
}

/// Whether the background is to be evaluated outside the box.
#[cube]
fn is_background(background: &[u32], grid: &Grid, path: &Path, from: f32, to: f32) -> bool {
    let middle = point_at(path, 0.5f32 * (from + to));
    let middle = contracted(&middle);
    is_occupied(background, grid, &middle)
}

/// The stretch from `near` to the box, where steps are finest. Returns where the next interval's place is.
#[cube]
fn approach(
    path: &Path,
    outside: &Outside,
    background: &[u32],
    grid: &Grid,
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    first: u32,
    room_end: u32,
    near: f32,
    #[comptime] write: bool,
) -> u32 {
    let mut at = first;
    let end = path.enter;
    let length = end - near;
    let last = position(outside, length);
    // Raster lines from far to near; the first cut is the farthest line short of `last`.
    let mut line = i32::cast_from(((last - outside.first) / outside.step).ceil());
    let mut from = end - length;
    let mut goes_on = true;
    while goes_on && from < end && at < room_end {
        line -= 1;
        let mut to = end;
        if line >= 0 {
            to = clamped(end - distance(outside, f32::cast_from(line)), from, end);
        }
        if to > from {
            if is_background(background, grid, path, from, to) {
                put(t, dt, flags, at, from, to, BACKGROUND, write);
                at += 1;
            }
            from = to;
        }
        goes_on = line >= 0;
    }
    at
}

/// The stretch from the box to `far`, where steps are finest close to the box; its last interval is always there.
#[cube]
fn recede(
    path: &Path,
    outside: &Outside,
    background: &[u32],
    grid: &Grid,
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    first: u32,
    room_end: u32,
    far: f32,
    #[comptime] write: bool,
) -> u32 {
    let mut at = first;
    let begin = path.leave;
    let length = far - begin;
    let last = position(outside, length);
    let end = begin + length;
    let mut from = begin;
    let mut line = 0.0f32;
    while from < end && at < room_end {
        let mut to = end;
        if outside.first + line * outside.step < last {
            to = clamped(begin + distance(outside, line), from, end);
        }
        line += 1.0f32;
        if to > from {
            if to >= end || is_background(background, grid, path, from, to) {
                put(t, dt, flags, at, from, to, BACKGROUND, write);
                at += 1;
            }
            from = to;
        }
    }
    at
}

/// Where step `k - 1` ends and step `k` begins.
#[cube]
fn line(raster: &Raster, k: u32) -> f32 {
    let line = raster.first + (f32::cast_from(k) - 1.0f32) * raster.step;
    select(k == 0, raster.begin, smaller(raster.end, line))
}

/// 1 if the middle of step `k` lies in an occupied cell, else 0; 0 for steps without a length.
#[cube]
fn step_flag(bits: &[u32], grid: &Grid, path: &Path, raster: &Raster, k: u32) -> u32 {
    let (from, to) = (line(raster, k), line(raster, k + 1));
    let mut flag = 0u32;
    if to > from {
        let p = point_at(path, 0.5f32 * (from + to));
        // Rounding may put it beside the box.
        let p = Point {
            x: clamped(p.x, -1.0f32, 1.0f32),
            y: clamped(p.y, -1.0f32, 1.0f32),
            z: clamped(p.z, -1.0f32, 1.0f32),
        };
        flag = select(is_occupied(bits, grid, &p), 1u32, 0u32);
    }
    flag
}

/// The stretch inside the box.
#[cube]
fn cross(
    path: &Path,
    raster: &Raster,
    object: &[u32],
    of_object: &Grid,
    background: &[u32],
    of_background: &Grid,
    t: &mut [f32],
    dt: &mut [f32],
    flags: &mut [u32],
    first: u32,
    room_end: u32,
    stride: u32,
    #[comptime] write: bool,
) -> u32 {
    let mut at = first;
    // One more than rounding could ask for: steps without a length are never occupied.
    let rest = (raster.end - raster.first) / raster.step;
    let count = u32::cast_from(smaller(MOST_STEPS, larger(0.0f32, rest))) + 3;
    // Bit `i` is the object's flag of step `k + i`, from the second round on.
    let mut ahead = 0u32;
    for i in 0..AHEAD - 1 {
        ahead |= step_flag(object, of_object, path, raster, i) << (i + 1);
    }
    let mut next = 0u32;
    let mut k = 0u32;
    while k < count && at < room_end {
        let farthest = step_flag(object, of_object, path, raster, k + AHEAD - 1);
        ahead = ahead >> 1 | farthest << (AHEAD - 1);
        if k >= next {
            let has_background = step_flag(background, of_background, path, raster, k);
            let flag = select(ahead & 1 == 1, OBJECT, 0u32)
                | select(has_background == 1, BACKGROUND, 0u32);
            if flag > 0 {
                // Not close to the object: there the background is what its plate shows.
                next = k + select(ahead == 0, stride, 1u32);
                put(
                    t,
                    dt,
                    flags,
                    at,
                    line(raster, k),
                    line(raster, next),
                    flag,
                    write,
                );
                at += 1;
            }
        }
        k += 1;
    }
    at
}
