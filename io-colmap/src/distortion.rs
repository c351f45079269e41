//! Lens distortion as a map of the plane, and its inverse.
//!
//! `(u, v)` is the undistorted point: `x/z, y/z` for perspective lenses, and the point at angle
//! theta from the axis, `theta * (x, y) / |(x, y)|`, for fisheye lenses. The distorted point times
//! the focal length plus the principal point is the pixel. Polynomials as in COLMAP and OpenCV:
//! `radial = 1 + k1 r^2 + k2 r^4 + ...`. Lenses with a closed form (FOV, division, EUCM,
//! panoramas) are in `camera.rs` and never come here.

use crate::camera_model::CameraModel;
use crate::jet::{Jet, Number};
use glam::DVec2;

/// Newton steps before giving up; well-behaved lenses need three to six.
const MAX_STEPS: usize = 40;

/// How far (in units of the normalised image plane) an inverse may miss and still count as found:
/// under a millionth of a pixel at any focal length in use.
const TOLERANCE: f64 = 1e-10;

/// Norm by which the Jacobian may differ from the identity without a doubt: at 1 it may be singular.
const GENTLE: f64 = 0.9;

/// `1 + k[0] t + k[1] t^2 + ...`
fn series<N: Number>(t: N, k: &[f64]) -> N {
    let tail = k
        .iter()
        .rev()
        .fold(N::constant(0.0), |sum, &k| (sum + N::constant(k)) * t);
    tail + N::constant(1.0)
}

/// Decentring (tangential) displacement; `(a, b)` are OpenCV's `(p1, p2)`.
fn tangential<N: Number>(u: N, v: N, r2: N, a: f64, b: f64) -> (N, N) {
    let uv = u * v * 2.0;
    (
        uv * a + (r2 + u * u * 2.0) * b,
        uv * b + (r2 + v * v * 2.0) * a,
    )
}

/// The lens map. `k` are the parameters after the principal point.
fn distort<N: Number>(model: CameraModel, k: &[f64], u: N, v: N) -> (N, N) {
    let r2 = u * u + v * v;
    match (model, k) {
        (CameraModel::OpenCv, &[k1, k2, p1, p2]) => {
            let radial = series(r2, &[k1, k2]);
            let (du, dv) = tangential(u, v, r2, p1, p2);
            (u * radial + du, v * radial + dv)
        }
        (CameraModel::FullOpenCv, &[k1, k2, p1, p2, k3, k4, k5, k6]) => {
            let radial = series(r2, &[k1, k2, k3]) / series(r2, &[k4, k5, k6]);
            let (du, dv) = tangential(u, v, r2, p1, p2);
            (u * radial + du, v * radial + dv)
        }
        (CameraModel::ThinPrismFisheye, &[k1, k2, p1, p2, k3, k4, sx, sy]) => {
            let radial = series(r2, &[k1, k2, k3, k4]);
            let (du, dv) = tangential(u, v, r2, p1, p2);
            (u * radial + du + r2 * sx, v * radial + dv + r2 * sy)
        }
        // Project Aria's Fisheye624: the tangential and prism terms act on the point that the
        // radial polynomial has already moved, and p0, p1 are in the other order than OpenCV's.
        (
            CameraModel::RadTanThinPrismFisheye,
            &[k0, k1, k2, k3, k4, k5, p0, p1, s0, s1, s2, s3],
        ) => {
            let radial = series(r2, &[k0, k1, k2, k3, k4, k5]);
            let (x, y) = (u * radial, v * radial);
            let q2 = x * x + y * y;
            let (dx, dy) = tangential(x, y, q2, p1, p0);
            (
                x + dx + q2 * s0 + q2 * q2 * s1,
                y + dy + q2 * s2 + q2 * q2 * s3,
            )
        }
        // The rest are radial only: SIMPLE_RADIAL, RADIAL and the plain fisheye models; no
        // parameters at all for the pinholes.
        _ => {
            let radial = series(r2, k);
            (u * radial, v * radial)
        }
    }
}

/// The distorted point and the Jacobian's determinant there.
fn distort_with_det(model: CameraModel, k: &[f64], p: DVec2) -> (DVec2, f64) {
    let (x, y) = distort(model, k, Jet::u(p.x), Jet::v(p.y));
    (
        DVec2::new(x.value, y.value),
        x.by_u * y.by_v - x.by_v * y.by_u,
    )
}

/// Whether the map keeps its orientation all the way from the axis to `p`. Past the fold a
/// polynomial fitted to the picture returns points from far outside it into the middle.
fn before_fold(model: CameraModel, k: &[f64], p: DVec2) -> bool {
    const PROBES: [f64; 4] = [0.25, 0.5, 0.75, 0.875];
    PROBES
        .iter()
        .all(|&t| distort_with_det(model, k, p * t).1 > 0.0)
}

/// Whether the map's Jacobian is so near to the identity all the way from the axis to `p` that it cannot fold there: what
/// holds of most photos' lenses, and costs a fraction of looking.
fn is_gentle(model: CameraModel, k: &[f64], p: DVec2) -> bool {
    let (radial, decentring) = match (model, k) {
        (CameraModel::OpenCv, &[k1, k2, p1, p2]) => ([k1, k2, 0.0, 0.0], p1.abs() + p2.abs()),
        (
            CameraModel::FullOpenCv
            | CameraModel::ThinPrismFisheye
            | CameraModel::RadTanThinPrismFisheye,
            _,
        ) => return false,
        (_, k) if k.len() <= 4 => {
            let mut radial = [0.0; 4];
            radial[..k.len()].copy_from_slice(k);
            (radial, 0.0)
        }
        _ => return false,
    };
    let r2 = p.length_squared();
    // Bounds of the norms of what the terms add to the identity, which grow with r: of k_i r^(2i) p, of the decentring.
    let [k1, k2, k3, k4] = radial.map(f64::abs);
    let bent = r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * (7.0 * k3 + r2 * (9.0 * k4))));
    bent + 6.0 * r2.sqrt() * decentring < GENTLE
}

/// Undistorted to distorted; `None` beyond the lens polynomial's fold or where it overflows.
pub(crate) fn forward(model: CameraModel, k: &[f64], p: DVec2) -> Option<DVec2> {
    if k.iter().all(|&k| k == 0.0) {
        return p.is_finite().then_some(p);
    }
    if is_gentle(model, k, p) {
        return Some(DVec2::from(distort(model, k, p.x, p.y)));
    }
    let (q, det) = distort_with_det(model, k, p);
    (q.is_finite() && det > 0.0 && before_fold(model, k, p)).then_some(q)
}

/// Distorted to undistorted by Newton's method; `None` where no undistorted point leads there.
pub(crate) fn inverse(model: CameraModel, k: &[f64], q: DVec2) -> Option<DVec2> {
    if k.iter().all(|&k| k == 0.0) {
        return q.is_finite().then_some(q);
    }
    let sound = |p: &DVec2| {
        is_gentle(model, k, *p)
            || distort_with_det(model, k, *p).1 > 0.0 && before_fold(model, k, *p)
    };
    if let Some(p) = newton(model, k, q, q).filter(sound) {
        return Some(p);
    }
    // Strong lenses: walk out from the axis, each answer starting the next search.
    let mut p = DVec2::ZERO;
    for step in 1..=16 {
        p = newton(model, k, q * (f64::from(step) / 16.0), p)?;
    }
    Some(p).filter(sound)
}

/// Solves `distort(p) = q` from a start, halving a step for as long as it does not help.
fn newton(model: CameraModel, k: &[f64], q: DVec2, start: DVec2) -> Option<DVec2> {
    let miss = |p: DVec2| {
        let (x, y) = distort(model, k, Jet::u(p.x), Jet::v(p.y));
        (DVec2::new(x.value, y.value) - q, x, y)
    };
    let accept = TOLERANCE * (1.0 + q.length());
    let mut p = start;
    let (mut error, mut x, mut y) = miss(p);
    for _ in 0..MAX_STEPS {
        let det = x.by_u * y.by_v - x.by_v * y.by_u;
        let step = DVec2::new(
            y.by_v * error.x - x.by_v * error.y,
            x.by_u * error.y - y.by_u * error.x,
        ) / det;
        if !step.is_finite() {
            return None;
        }
        if step.length() <= 1e-15 * (1.0 + p.length()) {
            break;
        }
        let mut scale = 1.0;
        loop {
            let next = p - step * scale;
            let (next_error, next_x, next_y) = miss(next);
            if next_error.length() < error.length() {
                (p, error, x, y) = (next, next_error, next_x, next_y);
                break;
            }
            scale *= 0.5;
            if scale < 1e-4 {
                // No smaller miss in this direction: rounding has been reached, or a dead end.
                return (error.length() <= accept).then_some(p);
            }
        }
    }
    (error.length() <= accept).then_some(p)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As [`forward`] without the short way.
    fn looked_at(model: CameraModel, k: &[f64], p: DVec2) -> Option<DVec2> {
        let (q, det) = distort_with_det(model, k, p);
        (det > 0.0 && before_fold(model, k, p)).then_some(q)
    }

    #[test]
    fn a_gentle_lens_is_what_looking_finds_to_the_bit() {
        let lenses: [(CameraModel, &[f64]); 5] = [
            (CameraModel::SimpleRadial, &[-0.4]),
            (CameraModel::Radial, &[-0.4, 0.05]),
            (CameraModel::OpenCv, &[0.2, -0.35, 0.02, -0.01]),
            (CameraModel::OpenCvFisheye, &[0.05, -0.04, 0.02, -0.01]),
            (
                CameraModel::FullOpenCv,
                &[0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0],
            ),
        ];
        for (model, k) in lenses {
            let (mut gentle, mut folded) = (0, 0);
            for i in 0..2000 {
                let (angle, radius) = (0.7 * f64::from(i), 0.002 * f64::from(i));
                let p = radius * DVec2::from_angle(angle);
                let looked = looked_at(model, k, p);
                assert_eq!(forward(model, k, p), looked, "{model} at {p}");
                gentle += usize::from(is_gentle(model, k, p));
                folded += usize::from(looked.is_none());
            }
            let is_judged = model != CameraModel::FullOpenCv;
            assert_eq!(gentle > 200, is_judged, "{model}: {gentle}");
            assert_eq!(folded > 0, is_judged, "{model}: {folded}");
        }
    }
}
