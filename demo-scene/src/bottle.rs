//! The target in two pieces: a spray bottle whose neck is as clear as glass, so that its head hangs in the air.
//!
//! Its own frame is the can's: on the table at the origin, z up, nozzle towards +x; metres.

use glam::{DVec2, DVec3};

use crate::paint::{Material, mottle, rgb};
use crate::primitives::{capsule, frustum, nearest, rounded_box, smooth_min};
use crate::watering_can::glaze;

/// Distances to body, label, head, nozzle and trigger.
fn parts(p: DVec3) -> [f64; 5] {
    let v = DVec3::new;
    let q = DVec2::new(p.truncate().length(), p.z);
    let lower = frustum(q - DVec2::new(0.0, 0.046), 0.042, 0.040, 0.038) - 0.004;
    let shoulder = frustum(q - DVec2::new(0.0, 0.104), 0.012, 0.038, 0.016) - 0.004;
    let body = smooth_min(lower, shoulder, 0.006);
    // As wide as the body and hardly more, so that it lies on it.
    let label = frustum(q - DVec2::new(0.0, 0.050), 0.024, 0.0446, 0.0435);
    let head = rounded_box(p - v(0.006, 0.0, 0.186), v(0.040, 0.017, 0.017), 0.008);
    let nozzle = capsule(
        p,
        v(0.044, 0.0, 0.190),
        v(0.062, 0.0, 0.190),
        0.0085,
        0.0070,
    );
    let trigger = capsule(
        p,
        v(0.036, 0.0, 0.176),
        v(0.048, 0.0, 0.150),
        0.0060,
        0.0050,
    );
    [body, label, head, nozzle, trigger]
}

/// Signed distance (a lower bound with slope at most one).
pub(crate) fn sdf(p: DVec3) -> f64 {
    parts(p).into_iter().fold(f64::MAX, f64::min)
}

/// Paint at a surface point.
pub(crate) fn material(p: DVec3) -> Material {
    let colour = match nearest(&parts(p)) {
        0 => glaze(p, rgb(0x3f7d4f), rgb(0x23543a)),
        1 => mottle(rgb(0xe6dfc8), p, 0.012, 0.4, 31),
        2 => glaze(p, rgb(0xe9dcc0), rgb(0xd3bd94)),
        3 => mottle(rgb(0xb8703c), p, 0.006, 0.5, 71),
        _ => mottle(rgb(0xb23a32), p, 0.006, 0.4, 77),
    };
    Material::glossy(colour, 0.15)
}
