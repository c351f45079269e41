//! Signed distances to simple solids (negative inside) and the ways to join them.
//!
//! All are exact or a lower bound with slope at most one, which is what sphere tracing needs.
//! Lengths in metres.

use glam::{DVec2, DVec3};

/// Axis-aligned box around the origin with edges rounded by `round` (kept inside `half`).
pub(crate) fn rounded_box(p: DVec3, half: DVec3, round: f64) -> f64 {
    let q = p.abs() - (half - round);
    q.max(DVec3::ZERO).length() + q.max_element().min(0.0) - round
}

/// Tapered capsule: radius `ra` at `a` to `rb` at `b`.
pub(crate) fn capsule(p: DVec3, a: DVec3, b: DVec3, ra: f64, rb: f64) -> f64 {
    let (pa, ba) = (p - a, b - a);
    let h = (pa.dot(ba) / ba.length_squared()).clamp(0.0, 1.0);
    // Scaled by the slope of the flank so that the distance stays a lower bound.
    let taper = (ra - rb) * (ra - rb) / ba.length_squared();
    ((pa - ba * h).length() - (ra + (rb - ra) * h)) * (1.0 - 0.5 * taper)
}

/// Cone frustum in its half plane: `q = (radius, height)`, radius `low` at `-half` and `high` at
/// `half`.
pub(crate) fn frustum(q: DVec2, half: f64, low: f64, high: f64) -> f64 {
    let k1 = DVec2::new(high, half);
    let k2 = DVec2::new(high - low, 2.0 * half);
    let cap = DVec2::new(
        q.x - q.x.min(if q.y < 0.0 { low } else { high }),
        q.y.abs() - half,
    );
    let flank = q - k1 + k2 * ((k1 - q).dot(k2) / k2.length_squared()).clamp(0.0, 1.0);
    let sign = if flank.x < 0.0 && cap.y < 0.0 {
        -1.0
    } else {
        1.0
    };
    sign * cap.length_squared().min(flank.length_squared()).sqrt()
}

/// Piece of a torus in the xy plane, symmetric about `+y`, reaching an angle with sine and cosine
/// `reach` to either side, with round ends.
pub(crate) fn arc(p: DVec3, reach: DVec2, major: f64, minor: f64) -> f64 {
    let q = DVec2::new(p.x.abs(), p.y);
    let k = if reach.y * q.x > reach.x * q.y {
        q.dot(reach)
    } else {
        q.length()
    };
    (p.length_squared() + major * major - 2.0 * major * k)
        .max(0.0)
        .sqrt()
        - minor
}

/// Full torus around the z axis.
pub(crate) fn ring(q: DVec2, major: f64, minor: f64) -> f64 {
    DVec2::new(q.x - major, q.y).length() - minor
}

/// Union whose seam is filled over a width `k`.
pub(crate) fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * h * h * k
}

/// Intersection whose edge is rounded over a width `k`.
pub(crate) fn smooth_max(a: f64, b: f64, k: f64) -> f64 {
    -smooth_min(-a, -b, k)
}

/// Which of several distances is the smallest; the first of equal ones.
pub(crate) fn nearest(distances: &[f64]) -> usize {
    (1..distances.len()).fold(0, |best, i| {
        if distances[i] < distances[best] {
            i
        } else {
            best
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Rng;

    /// Sphere tracing steps over a surface where the slope of a distance exceeds one.
    #[test]
    fn slopes_never_exceed_one() {
        let solids: [&dyn Fn(DVec3) -> f64; 5] = [
            &|p| rounded_box(p, DVec3::new(0.1, 0.2, 0.05), 0.01),
            &|p| capsule(p, DVec3::ZERO, DVec3::new(0.1, 0.0, 0.1), 0.03, 0.01),
            &|p| frustum(DVec2::new(p.truncate().length(), p.z), 0.1, 0.1, 0.05),
            &|p| arc(p, DVec2::new(0.96, -0.28), 0.1, 0.02),
            &|p| {
                smooth_min(
                    p.length() - 0.1,
                    ring(DVec2::new(p.truncate().length(), p.z), 0.1, 0.03),
                    0.02,
                )
            },
        ];
        let mut rng = Rng::new(11, 0);
        let mut point = || {
            DVec3::new(
                rng.range(-0.3, 0.3),
                rng.range(-0.3, 0.3),
                rng.range(-0.3, 0.3),
            )
        };
        for (index, solid) in solids.iter().enumerate() {
            for _ in 0..4000 {
                let (a, b) = (point(), point());
                let b = a + (b - a) * 0.05;
                let rise = (solid(a) - solid(b)).abs();
                assert!(rise <= (a - b).length() * 1.001 + 1e-12, "solid {index}");
            }
        }
    }
}
