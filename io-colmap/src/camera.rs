//! A camera's intrinsics: from camera space to pixels and back.

use crate::camera_model::CameraModel;
use crate::distortion;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Rays at least this far in front of the camera plane (as z of a unit vector) are given with
/// `z = 1`; the others would grow without bound.
const MIN_FORWARD: f64 = 1e-6;
/// No photo has a longer side, and products of two such numbers stay exact everywhere.
pub(crate) const LARGEST_SIDE: u32 = 1 << 20;

/// Intrinsics of one camera, shared by any number of views.
///
/// Camera space: +x right, +y down, +z forward. Pixels: the top left pixel's centre is at
/// `(0.5, 0.5)`, the image's corners are `(0, 0)` and `(width, height)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// The number by which views refer to it.
    pub id: u32,
    /// How rays map to pixels.
    pub model: CameraModel,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// In the order listed at [`CameraModel`]; focal lengths and principal point in pixels.
    pub params: Vec<f64>,
}

/// The parameters by role.
struct Lens<'a> {
    focal: DVec2,
    centre: DVec2,
    extra: &'a [f64],
}

impl Camera {
    /// `None` if the number of parameters does not fit the model.
    fn lens(&self) -> Option<Lens<'_>> {
        if self.params.len() != self.model.param_count() {
            return None;
        }
        match (self.model.focal_count(), self.params.as_slice()) {
            (1, [f, cx, cy, extra @ ..]) => Some(Lens {
                focal: DVec2::splat(*f),
                centre: DVec2::new(*cx, *cy),
                extra,
            }),
            (2, [fx, fy, cx, cy, extra @ ..]) => Some(Lens {
                focal: DVec2::new(*fx, *fy),
                centre: DVec2::new(*cx, *cy),
                extra,
            }),
            // Panorama: pixels per radian take the place of focal lengths.
            (0, [w, h]) => Some(Lens {
                focal: DVec2::new(w / TAU, h / PI),
                centre: DVec2::new(w / 2.0, h / 2.0),
                extra: &[],
            }),
            _ => None,
        }
    }

    /// Why the parameters cannot describe a camera, if they cannot.
    pub(crate) fn complaint(&self) -> Option<String> {
        let sides = [self.width, self.height];
        if sides.iter().any(|side| !(1..=LARGEST_SIDE).contains(side)) {
            return Some(format!(
                "camera {} has the size {}x{}",
                self.id, self.width, self.height
            ));
        }
        if self.params.len() != self.model.param_count() {
            return Some(format!(
                "camera {} has {} parameters but {} takes {}",
                self.id,
                self.params.len(),
                self.model,
                self.model.param_count()
            ));
        }
        if let Some(bad) = self.params.iter().find(|p| !p.is_finite()) {
            return Some(format!("camera {} has the parameter {bad}", self.id));
        }
        let (fx, fy) = self.focal();
        if fx <= 0.0 || fy <= 0.0 {
            return Some(format!(
                "camera {} has a focal length that is not positive ({fx}, {fy})",
                self.id
            ));
        }
        if let (CameraModel::Eucm, [.., alpha, beta]) = (self.model, self.params.as_slice())
            && (!(0.0..=1.0).contains(alpha) || *beta <= 0.0)
        {
            return Some(format!(
                "camera {} has alpha {alpha} and beta {beta}, outside [0, 1] and (0, inf)",
                self.id
            ));
        }
        None
    }

    /// Focal lengths along x and y in pixels (pixels per radian for panoramas). NaN if the
    /// parameters do not fit the model, which [`Model::read`](crate::Model::read) never returns.
    #[must_use]
    pub fn focal(&self) -> (f64, f64) {
        self.lens()
            .map_or((f64::NAN, f64::NAN), |lens| (lens.focal.x, lens.focal.y))
    }

    /// Where the optical axis meets the image, in pixels. NaN as for [`Camera::focal`].
    #[must_use]
    pub fn principal_point(&self) -> (f64, f64) {
        self.lens()
            .map_or((f64::NAN, f64::NAN), |lens| (lens.centre.x, lens.centre.y))
    }

    /// The pixel at which a camera-space point is seen; it may lie outside the image.
    ///
    /// `None` behind the camera and beyond the lens's reach: past the fold of its distortion
    /// polynomial, or past its largest angle. Fisheye lenses and panoramas do see points with
    /// negative z.
    #[must_use]
    pub fn project(&self, p: DVec3) -> Option<DVec2> {
        let lens = self.lens()?;
        let across = DVec2::new(p.x, p.y);
        let off_axis = across.length();
        if !p.is_finite() || p.length_squared() == 0.0 {
            return None;
        }
        let plane = match (self.model, lens.extra) {
            (CameraModel::Fov, &[omega]) => {
                let flat = perspective(p)?;
                flat * fov_forward(omega, flat.length())
            }
            (CameraModel::SimpleDivision | CameraModel::Division, &[k]) => {
                // Of the two roots of k rho s^2 - z s + rho = 0 the one that is 1/z for k = 0.
                let root = (p.z * p.z - 4.0 * k * off_axis * off_axis).sqrt();
                let scale = 2.0 / (p.z + root);
                (scale > 0.0).then_some(across * scale)?
            }
            (CameraModel::Eucm, &[alpha, beta]) => {
                let distance = (beta * off_axis * off_axis + p.z * p.z).sqrt();
                // Largest angle at which the map is still one to one (Usenko et al. 2018, eq. 17).
                let reach = if alpha <= 0.5 {
                    alpha / (1.0 - alpha)
                } else {
                    (1.0 - alpha) / alpha
                };
                let depth = alpha * distance + (1.0 - alpha) * p.z;
                (p.z > -reach * distance && depth > 0.0).then_some(across / depth)?
            }
            (CameraModel::Equirectangular, _) => {
                DVec2::new(p.x.atan2(p.z), p.y.atan2(p.x.hypot(p.z)))
            }
            _ if is_fisheye(self.model) => {
                let theta = off_axis.atan2(p.z);
                let undistorted = if off_axis > 0.0 {
                    across * (theta / off_axis)
                } else if p.z > 0.0 {
                    DVec2::ZERO
                } else {
                    return None;
                };
                distortion::forward(self.model, lens.extra, undistorted)?
            }
            _ => distortion::forward(self.model, lens.extra, perspective(p)?)?,
        };
        let pixel = plane * lens.focal + lens.centre;
        pixel.is_finite().then_some(pixel)
    }

    /// The camera-space direction seen at a pixel: with `z = 1` where it points forward, of unit
    /// length where a fisheye lens or panorama looks sideways or back.
    ///
    /// `None` where no ray reaches the pixel (the corners of a round fisheye picture), or the
    /// distortion cannot be inverted there.
    #[must_use]
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let lens = self.lens()?;
        let q = (pixel - lens.centre) / lens.focal;
        if !q.is_finite() {
            return None;
        }
        let ray = match (self.model, lens.extra) {
            (CameraModel::Fov, &[omega]) => (q * fov_inverse(omega, q.length())?).extend(1.0),
            (CameraModel::SimpleDivision | CameraModel::Division, &[k]) => {
                let ray = q.extend(1.0 + k * q.length_squared());
                // With k > 0 the map is one to one only inside the circle k r^2 = 1.
                (k * q.length_squared() < 1.0).then_some(ray)?
            }
            (CameraModel::Eucm, &[alpha, beta]) => {
                let r2 = q.length_squared();
                let root = (1.0 - (2.0 * alpha - 1.0) * beta * r2).sqrt();
                q.extend((1.0 - alpha * alpha * beta * r2) / (alpha * root + (1.0 - alpha)))
            }
            (CameraModel::Equirectangular, _) => {
                if q.x.abs() > PI || q.y.abs() > FRAC_PI_2 {
                    return None;
                }
                DVec3::new(q.y.cos() * q.x.sin(), q.y.sin(), q.y.cos() * q.x.cos())
            }
            _ => {
                let p = distortion::inverse(self.model, lens.extra, q)?;
                if is_fisheye(self.model) {
                    let theta = p.length();
                    if theta >= PI {
                        return None;
                    }
                    let across = if theta > 0.0 {
                        p * (theta.sin() / theta)
                    } else {
                        p
                    };
                    across.extend(theta.cos())
                } else {
                    p.extend(1.0)
                }
            }
        };
        let unit = ray.try_normalize()?;
        let ray = if unit.z > MIN_FORWARD {
            ray / ray.z
        } else {
            unit
        };
        ray.is_finite().then_some(ray)
    }

    /// The same view at another image size (in pixels).
    ///
    /// Stretches each axis by its own factor. Where the factors differ, a model with a single
    /// focal length becomes its counterpart with two, so the result is exact.
    #[must_use]
    pub fn scaled_to(&self, width: u32, height: u32) -> Camera {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        let mut camera = self.clone();
        (camera.width, camera.height) = (width, height);
        if sx != sy {
            camera.split_focal();
        }
        let factors: &[f64] = match camera.model.focal_count() {
            0 => &[sx, sy],
            1 => &[sx, sx, sy],
            _ => &[sx, sy, sx, sy],
        };
        camera
            .params
            .iter_mut()
            .zip(factors)
            .for_each(|(p, factor)| *p *= factor);
        camera
    }

    /// Turns a camera with one focal length into the equal one with two.
    fn split_focal(&mut self) {
        let (model, extra_count) = match self.model {
            CameraModel::SimplePinhole => (CameraModel::Pinhole, 0),
            CameraModel::SimpleRadial | CameraModel::Radial => (CameraModel::OpenCv, 4),
            CameraModel::SimpleRadialFisheye | CameraModel::RadialFisheye => {
                (CameraModel::OpenCvFisheye, 4)
            }
            CameraModel::SimpleDivision => (CameraModel::Division, 1),
            CameraModel::SimpleFisheye => (CameraModel::Fisheye, 0),
            _ => return,
        };
        if let Some(lens) = self.lens() {
            let mut params = vec![lens.focal.x, lens.focal.y, lens.centre.x, lens.centre.y];
            params.extend_from_slice(lens.extra);
            params.resize(4 + extra_count, 0.0);
            (self.model, self.params) = (model, params);
        }
    }
}

fn is_fisheye(model: CameraModel) -> bool {
    use CameraModel::*;
    matches!(
        model,
        OpenCvFisheye
            | SimpleRadialFisheye
            | RadialFisheye
            | ThinPrismFisheye
            | RadTanThinPrismFisheye
            | SimpleFisheye
            | Fisheye
    )
}

fn perspective(p: DVec3) -> Option<DVec2> {
    (p.z > 0.0)
        .then(|| DVec2::new(p.x / p.z, p.y / p.z))
        .filter(|flat| flat.is_finite())
}

/// FOV model (Devernay and Faugeras 2001): distorted over undistorted radius.
fn fov_forward(omega: f64, radius: f64) -> f64 {
    // Below this the model is the identity to within rounding (it differs by omega^2 / 12).
    if omega.abs() < 1e-8 {
        return 1.0;
    }
    let slope = 2.0 * (omega / 2.0).tan();
    if radius == 0.0 {
        slope / omega
    } else {
        (radius * slope).atan() / (radius * omega)
    }
}

/// FOV model: undistorted over distorted radius; `None` past a right angle.
fn fov_inverse(omega: f64, radius: f64) -> Option<f64> {
    if omega.abs() < 1e-8 {
        return Some(1.0);
    }
    let slope = 2.0 * (omega / 2.0).tan();
    if radius == 0.0 {
        return Some(omega / slope);
    }
    let angle = radius * omega;
    (angle.abs() < FRAC_PI_2).then(|| angle.tan() / (radius * slope))
}
