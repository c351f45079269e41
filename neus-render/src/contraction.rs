//! All of space in a cube: the contraction of mip-NeRF 360 (Barron et al. 2022, eq. 10) with the
//! largest-coordinate norm instead of the Euclidean one.
//!
//! With `r = max(|x|, |y|, |z|)`: `c(p) = p` for `r <= 1`, else `(2 - 1/r) p / r`. The object box
//! [-1, 1]^3 is kept as it is, and the rest of R^3 fills the cube (-2, 2)^3 around it. Along a
//! fixed direction, equal steps in contracted space are equal steps of disparity `1/r`.

use glam::Vec3;

/// Contracts a point of R^3 into the cube [-2, 2]^3.
///
/// The limits of infinite points are not defined; everything finite stays finite.
///
/// ```
/// use glam::Vec3;
/// use neus_render::contraction::{contract, uncontract};
///
/// assert_eq!(contract(Vec3::new(0.3, -1.0, 0.5)), Vec3::new(0.3, -1.0, 0.5));
/// assert_eq!(contract(Vec3::new(4.0, 2.0, 0.0)), Vec3::new(1.75, 0.875, 0.0));
/// assert_eq!(uncontract(Vec3::new(1.75, 0.875, 0.0)), Vec3::new(4.0, 2.0, 0.0));
/// ```
#[inline]
pub fn contract(p: Vec3) -> Vec3 {
    let r = p.abs().max_element();
    if r <= 1.0 {
        p
    } else {
        let inverse = 1.0 / r;
        ((2.0 - inverse) * inverse) * p
    }
}

/// The inverse of [`contract`]. Points on or outside the cube's surface (`r >= 2`) have no
/// pre-image; they are taken as if just inside, at a distance of about 10^6.
#[inline]
pub fn uncontract(p: Vec3) -> Vec3 {
    let r = p.abs().max_element();
    if r <= 1.0 {
        p
    } else {
        // |c| = 2 - 1/r  =>  r = 1 / (2 - |c|).
        let gap = (2.0 - r).max(1e-6);
        p / (r * gap)
    }
}

/// The derivative of [`contract`] along `direction`: where a unit step in space leads in
/// contracted space.
///
/// A field that lives in contracted space has the slope `gradient . contract_direction(p, v)`
/// along a ray through `p` with direction `v`. On the box's surface the inner derivative counts.
///
/// ```
/// use glam::Vec3;
/// use neus_render::contraction::contract_direction;
///
/// let p = Vec3::new(2.0, 0.0, 0.0);
/// assert_eq!(contract_direction(p, Vec3::X), Vec3::new(0.25, 0.0, 0.0)); // 1/r^2
/// assert_eq!(contract_direction(p, Vec3::Y), Vec3::new(0.0, 0.75, 0.0)); // (2 - 1/r)/r
/// ```
#[inline]
pub fn contract_direction(p: Vec3, direction: Vec3) -> Vec3 {
    let size = p.abs();
    let r = size.max_element();
    if r <= 1.0 {
        return direction;
    }
    let axis = if size.x == r {
        0
    } else if size.y == r {
        1
    } else {
        2
    };
    let inverse = 1.0 / r;
    // c = g(r) p with g = 2/r - 1/r^2, so dc = g v + g'(r) (dr/dv) p.
    let scale = (2.0 - inverse) * inverse;
    let scale_slope = 2.0 * inverse * inverse * (inverse - 1.0);
    let r_slope = direction[axis] * p[axis].signum();
    scale * direction + (scale_slope * r_slope) * p
}
