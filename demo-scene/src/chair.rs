//! The thin target: a small chair with a hoop that stands on its seat's edge, and a bent wire from its back to the hoop.
//!
//! Its own frame is the can's: on the table at the origin, z up; metres.

use glam::{DVec2, DVec3};

use crate::paint::{Material, mottle, rgb};
use crate::primitives::{capsule, nearest, ring, rounded_box};
use crate::watering_can::{glaze, rattan};

/// Distances to seat, legs and back, hoop, wire.
fn parts(p: DVec3) -> [f64; 4] {
    let v = DVec3::new;
    let seat = rounded_box(p - v(0.0, 0.0, 0.100), v(0.060, 0.060, 0.004), 0.003);
    let leg = |(x, y): (f64, f64)| {
        let (top, foot) = (v(0.052 * x, 0.052 * y, 0.1), v(0.064 * x, 0.064 * y, 0.004));
        capsule(p, top, foot, 0.0042, 0.0036)
    };
    let legs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(leg);
    let bar = |y: f64| capsule(p, v(-0.052, y, 0.1), v(-0.066, y, 0.19), 0.0038, 0.0034);
    let bars = [-0.052, -0.017, 0.017, 0.052].map(bar);
    let (left, right) = (v(-0.066, -0.052, 0.19), v(-0.066, 0.052, 0.19));
    let rail = capsule(p, left, right, 0.0044, 0.0044);
    let wood = legs.into_iter().chain(bars).fold(rail, f64::min);
    // The hoop stands in the xz plane.
    let from = p - v(0.105, 0.0, 0.125);
    let across = DVec2::new(from.x, from.z).length();
    let hoop = ring(DVec2::new(across, from.y), 0.046, 0.0030);
    let (back, bend, end) = (
        v(-0.066, 0.0, 0.19),
        v(0.02, 0.0, 0.212),
        v(0.105, 0.0, 0.171),
    );
    let wire = capsule(p, back, bend, 0.0018, 0.0018).min(capsule(p, bend, end, 0.0018, 0.0018));
    [seat, wood, hoop, wire]
}

/// Signed distance (a lower bound with slope at most one).
pub(crate) fn sdf(p: DVec3) -> f64 {
    parts(p).into_iter().fold(f64::MAX, f64::min)
}

/// Paint at a surface point.
pub(crate) fn material(p: DVec3) -> Material {
    let colour = match nearest(&parts(p)) {
        0 => rattan(p),
        1 => glaze(p, rgb(0x8c3f35), rgb(0x5a1f22)),
        2 => mottle(rgb(0xb8703c), p, 0.006, 0.5, 71),
        _ => mottle(rgb(0x2a2c33), p, 0.006, 0.5, 77),
    };
    Material::glossy(colour, 0.15)
}
