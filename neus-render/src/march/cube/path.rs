//! A ray, where it meets the box, and what cells lie at a point.
//!
//! Comparisons are written so that what is no number decides as it does on the CPU: `min`, `max` and `clamp` don't
//! promise anything about it on devices.

// What the macros generate has no documentation of its own.
#![allow(missing_docs)]

use gpu_tensors::cubecl;

use cubecl::prelude::*;

/// Stands for infinity, which WGSL has no constant of.
const ENDLESS: f32 = f32::MAX;

/// How densely and how far rays are marched.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct Steps {
    /// Length inside the box.
    pub(super) object: f32,
    /// How many of these the background alone is marched at once.
    pub(super) stride: u32,
    /// Spacing of the raster outside the box.
    pub(super) outside: f32,
    /// 1 if rays go on behind the box, else 0.
    pub(super) behind_box: u32,
    pub(super) near: f32,
    pub(super) far: f32,
}

/// A grid's cells.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct Grid {
    /// Cells per axis; 0 where there is no grid.
    pub(super) resolution: u32,
    /// Half the edge of the cube.
    pub(super) half: f32,
    /// Cells per unit of length.
    pub(super) scale: f32,
}

/// A point or a direction.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Point {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) z: f32,
}

/// A ray, and where it meets the box.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Path {
    origin: Point,
    direction: Point,
    /// Whether it passes through the box.
    pub(super) crosses: bool,
    /// Where it enters the box, or where it is closest to its centre.
    pub(super) enter: f32,
    /// Where it leaves the box, or the same.
    pub(super) leave: f32,
    /// The distance `d` from there at which `d / (d + unit)` is one half.
    pub(super) unit: f32,
}

/// The larger one; `a` if `b` is no number.
#[cube]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    select(b > a, b, a)
}

/// The smaller one; `a` if `b` is no number.
#[cube]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    select(b < a, b, a)
}

/// `x` within `[low, high]`; itself if it is no number.
#[cube]
pub(super) fn clamped(x: f32, low: f32, high: f32) -> f32 {
    select(x > high, high, select(x < low, low, x))
}

#[cube]
pub(super) fn point_at(path: &Path, t: f32) -> Point {
    Point {
        x: path.origin.x + t * path.direction.x,
        y: path.origin.y + t * path.direction.y,
        z: path.origin.z + t * path.direction.z,
    }
}

/// The largest coordinate's size.
#[cube]
fn extent(p: &Point) -> f32 {
    larger(larger(larger(0.0f32, p.x.abs()), p.y.abs()), p.z.abs())
}

/// See [`contract`](crate::contraction::contract).
#[cube]
pub(super) fn contracted(p: &Point) -> Point {
    let r = extent(p);
    let inverse = 1.0f32 / r;
    let factor = select(r <= 1.0f32, 1.0f32, (2.0f32 - inverse) * inverse);
    Point {
        x: factor * p.x,
        y: factor * p.y,
        z: factor * p.z,
    }
}

/// The coordinate of the cell along an axis.
#[cube]
fn cell_along(x: f32, grid: &Grid) -> u32 {
    let q = larger(0.0f32, (x + grid.half) * grid.scale);
    min(u32::cast_from(q), grid.resolution - 1)
}

/// Whether the cell that `p` lies in is occupied; false outside the grid.
#[cube]
pub(super) fn is_occupied(bits: &[u32], grid: &Grid, p: &Point) -> bool {
    let mut occupied = false;
    let inside = p.x.abs() <= grid.half && p.y.abs() <= grid.half && p.z.abs() <= grid.half;
    if inside && grid.resolution > 0 {
        let rows = cell_along(p.y, grid) + grid.resolution * cell_along(p.z, grid);
        let cell = cell_along(p.x, grid) + grid.resolution * rows;
        occupied = bits[(cell / 32) as usize] >> (cell % 32) & 1 == 1;
    }
    occupied
}

/// Narrows `[near, far]` to where the ray is between -1 and 1 along an axis; an empty range where it never is.
#[cube]
fn slab(origin: f32, direction: f32, near: f32, far: f32) -> (f32, f32) {
    let still = direction == 0.0f32;
    let beside = origin.abs() > 1.0f32;
    let a = (-1.0f32 - origin) / direction;
    let b = (1.0f32 - origin) / direction;
    let narrow_near = larger(near, select(a < b, a, b));
    let narrow_far = smaller(far, select(a < b, b, a));
    (
        select(still, select(beside, ENDLESS, near), narrow_near),
        select(still, select(beside, comptime!(-ENDLESS), far), narrow_far),
    )
}

/// Ray `ray` of `[rays, 6]`.
#[cube]
pub(super) fn path_of(rays: &[f32], ray: usize, steps: &Steps) -> Path {
    let at = 6 * ray;
    let origin = Point {
        x: rays[at],
        y: rays[at + 1],
        z: rays[at + 2],
    };
    let direction = Point {
        x: rays[at + 3],
        y: rays[at + 4],
        z: rays[at + 5],
    };
    let (near_x, far_x) = slab(origin.x, direction.x, comptime!(-ENDLESS), ENDLESS);
    let (near_y, far_y) = slab(origin.y, direction.y, near_x, far_x);
    let (near_z, far_z) = slab(origin.z, direction.z, near_y, far_y);
    let enter = larger(near_z, steps.near);
    let leave = smaller(far_z, steps.far);
    let crosses = near_z <= far_z && enter < leave;
    let towards = -(origin.x * direction.x + origin.y * direction.y + origin.z * direction.z);
    let closest = clamped(towards, steps.near, larger(steps.far, steps.near));
    let there = Point {
        x: origin.x + closest * direction.x,
        y: origin.y + closest * direction.y,
        z: origin.z + closest * direction.z,
    };
    Path {
        origin,
        direction,
        crosses,
        enter: select(crosses, enter, closest),
        leave: select(crosses, leave, closest),
        unit: select(crosses, 1.0f32, larger(1.0f32, extent(&there))),
    }
}
