//! The smallest of COLMAP's camera models that says what another tool's parameters say.

use glam::DVec2;
use io_colmap::{Camera, CameraModel};
use nalgebra::{SMatrix, SVector};

/// Error in pixels up to which a lens term that COLMAP lacks may be left out or replaced.
const NEGLIGIBLE: f64 = 0.05;
/// Pixels by which leaving skew out may be wrong.
const MOST_SKEW: f64 = 0.5;

/// Principal points are this many times farther from the corner than the photo's middle where cameras are for larger
/// pictures; no lens is so far off.
const OTHER_SIZE: f64 = 1.25;
/// The middle of a picture of another size is that much farther along both axes, to within this share.
const SAME_SHAPE: f64 = 0.1;

/// Refuses a camera whose size is not stated but taken from the photo, and that is for pictures of another: its axis meets
/// them outside, or in the middle of larger or smaller ones of that shape.
pub(crate) fn check_size(camera: &Camera, is_stated: bool) -> Result<(), String> {
    if camera.model == CameraModel::Equirectangular {
        return Ok(());
    }
    let centre = DVec2::from(camera.principal_point());
    let (width, height) = (camera.width, camera.height);
    let size = DVec2::new(f64::from(width), f64::from(height));
    let off = 2.0 * centre / size;
    let is_middle = off.max_element() - off.min_element() <= SAME_SHAPE * off.max_element();
    let is_far = off.min_element() > OTHER_SIZE || off.max_element() < 1.0 / OTHER_SIZE;
    // Parts of a picture may lie beside its middle.
    let place = if is_stated {
        return Ok(());
    } else if off.min_element() < 0.0 || off.max_element() > 2.0 {
        format!("outside the picture's {width}x{height} pixels")
    } else if is_middle && is_far {
        let whole = 2.0 * centre;
        format!(
            "which is the middle of {:.0}x{:.0} pixels, but the photo has {width}x{height}",
            whole.x, whole.y
        )
    } else {
        return Ok(());
    };
    Err(format!(
        "its optical axis meets the picture at ({}, {}), {place}, so it is for pictures of another size",
        centre.x, centre.y
    ))
}

/// Focal lengths and principal point in pixels, for a picture of that size. The top left pixel's
/// centre is at `(0.5, 0.5)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) focal: DVec2,
    pub(crate) centre: DVec2,
}

impl Frame {
    /// With the principal point in the middle.
    pub(crate) fn centred(width: u32, height: u32, focal: f64) -> Self {
        Self {
            width,
            height,
            focal: DVec2::splat(focal),
            centre: DVec2::new(f64::from(width), f64::from(height)) * 0.5,
        }
    }

    fn camera(&self, model: CameraModel, extra: &[f64]) -> Result<Camera, String> {
        let Self {
            width,
            height,
            focal,
            centre,
        } = *self;
        if width == 0 || height == 0 {
            return Err(format!("its pictures are {width}x{height}"));
        }
        let mut params = vec![focal.x, focal.y, centre.x, centre.y];
        params.extend_from_slice(extra);
        if let Some(bad) = params.iter().find(|p| !p.is_finite()) {
            return Err(format!("it has the parameter {bad}"));
        }
        if focal.min_element() <= 0.0 {
            return Err(format!(
                "its focal length is {} by {} pixels",
                focal.x, focal.y
            ));
        }
        Ok(Camera {
            id: 0,
            model,
            width,
            height,
            params,
        })
    }

    /// A perspective lens with Brown's distortion: radial factors of `r^2, r^4, r^6, r^8`, and
    /// OpenCV's tangential `p1, p2`.
    pub(crate) fn perspective(&self, k: [f64; 4], p: [f64; 2]) -> Result<Camera, String> {
        let [k1, k2, k3, k4] = k;
        let [p1, p2] = p;
        if k.iter().chain(&p).all(|v| *v == 0.0) {
            self.camera(CameraModel::Pinhole, &[])
        } else if k3 == 0.0 && k4 == 0.0 {
            self.camera(CameraModel::OpenCv, &[k1, k2, p1, p2])
        } else if k4 == 0.0 {
            self.camera(
                CameraModel::FullOpenCv,
                &[k1, k2, p1, p2, k3, 0.0, 0.0, 0.0],
            )
        } else {
            // COLMAP has no r^8 but a quotient of polynomials.
            let [a1, a2, a3, b1, b2, b3] = self.as_quotient(k)?;
            self.camera(CameraModel::FullOpenCv, &[a1, a2, p1, p2, a3, b1, b2, b3])
        }
    }

    /// An equidistant fisheye lens with a polynomial of the angle, and tangential terms.
    pub(crate) fn fisheye(&self, k: [f64; 4], p: [f64; 2]) -> Result<Camera, String> {
        let [k1, k2, k3, k4] = k;
        let [p1, p2] = p;
        if p == [0.0; 2] {
            self.camera(CameraModel::OpenCvFisheye, &k)
        } else {
            self.camera(
                CameraModel::ThinPrismFisheye,
                &[k1, k2, p1, p2, k3, k4, 0.0, 0.0],
            )
        }
    }

    /// Project Aria's fisheye: `k0..k5, p0, p1, s0..s3`.
    pub(crate) fn fisheye624(&self, params: &[f64; 12]) -> Result<Camera, String> {
        self.camera(CameraModel::RadTanThinPrismFisheye, params)
    }

    /// A full panorama.
    pub(crate) fn panorama(width: u32, height: u32) -> Camera {
        Camera {
            id: 0,
            model: CameraModel::Equirectangular,
            width,
            height,
            params: vec![f64::from(width), f64::from(height)],
        }
    }

    /// By how many pixels leaving skew out would be wrong, where that is too much. No COLMAP camera has
    /// skew.
    pub(crate) fn lost_with_skew(&self, skew: f64) -> Option<f64> {
        Some(self.skew_error(skew)).filter(|lost| *lost > MOST_SKEW)
    }

    /// How far skew moves a pixel at most: `skew` pixels along x per unit of y on the image plane.
    fn skew_error(&self, skew: f64) -> f64 {
        let (top, bottom) = (self.centre.y, f64::from(self.height) - self.centre.y);
        (skew * top.abs().max(bottom.abs()) / self.focal.y).abs()
    }

    /// The radial polynomial as `(1 + a1 t + a2 t^2 + a3 t^3) / (1 + b1 t + b2 t^2 + b3 t^3)` with
    /// `t = r^2`, fitted over the picture.
    fn as_quotient(&self, k: [f64; 4]) -> Result<[f64; 6], String> {
        if k.iter().any(|v| !v.is_finite()) {
            return Err("its distortion is not finite".to_owned());
        }
        let factor = |t: f64| 1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])));
        let reach = self.reach(&factor);
        // With t in units of the largest, the columns of the system are alike.
        let largest = reach * reach;
        let mut normal = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        const SAMPLES: usize = 200;
        for i in 1..=SAMPLES {
            let s = (i as f64 / SAMPLES as f64).powi(2);
            let f = factor(s * largest);
            let (s2, s3) = (s * s, s * s * s);
            let row = SVector::from([s, s2, s3, -f * s, -f * s2, -f * s3]);
            normal += s * row * row.transpose();
            right += s * (f - 1.0) * row;
        }
        // Close to a polynomial the quotient is not unique; this picks a small one.
        normal += SMatrix::identity() * (1e-12 * SAMPLES as f64);
        let scaled = normal.lu().solve(&right);
        let finite = |scaled: &SVector<f64, 6>| scaled.iter().all(|v| v.is_finite());
        let scaled = scaled.filter(finite);
        let scaled = scaled.ok_or("its distortion cannot be fitted")?;
        let scaled = <[f64; 6]>::from(scaled);
        let quotient = |s: f64| {
            let cubic = |c: &[f64]| 1.0 + s * (c[0] + s * (c[1] + s * c[2]));
            cubic(&scaled[..3]) / cubic(&scaled[3..])
        };
        let worst = (0..=SAMPLES)
            .map(|i| {
                let r = reach * i as f64 / SAMPLES as f64;
                let s = (r / reach).powi(2);
                (r * (quotient(s) - factor(r * r))).abs() * self.focal.max_element()
            })
            .fold(0.0_f64, |worst, e| {
                if e.is_nan() {
                    f64::INFINITY
                } else {
                    worst.max(e)
                }
            });
        if worst > NEGLIGIBLE {
            return Err(format!(
                "its radial term k4 ({}) cannot be said with COLMAP's lenses: {worst:.2} pixels are missing",
                k[3]
            ));
        }
        let mut power = 1.0;
        let mut params = scaled;
        for i in 0..3 {
            power *= largest;
            params[i] /= power;
            params[i + 3] /= power;
        }
        Ok(params)
    }

    /// The undistorted radius, in units of the image plane, of the picture's farthest corner.
    fn reach(&self, factor: &impl Fn(f64) -> f64) -> f64 {
        let size = DVec2::new(f64::from(self.width), f64::from(self.height));
        let farthest = self.centre.abs().max((size - self.centre).abs()) / self.focal;
        let corner = farthest.length();
        // Walks outward until the distorted radius reaches the corner, or the polynomial turns back.
        let (mut reach, mut before) = (0.0, 0.0);
        for i in 1..=300 {
            let r = corner * f64::from(i) / 100.0;
            let distorted = r * factor(r * r);
            if distorted <= before {
                break;
            }
            (reach, before) = (r, distorted);
            if distorted >= corner {
                break;
            }
        }
        if reach > 0.0 { reach } else { corner }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use glam::DVec3;

    #[test]
    fn skew_is_left_out_up_to_half_a_pixel() {
        let frame = Frame::centred(640, 480, 500.0);
        // 240 pixels from the middle to the upper edge.
        let lost = |pixels: f64| frame.lost_with_skew(pixels * 500.0 / 240.0);
        assert_eq!((lost(0.4), lost(-0.4)), (None, None));
        assert!((lost(0.6).unwrap() - 0.6).abs() < 1e-9 && lost(-0.6).is_some());
    }

    #[test]
    fn cameras_for_pictures_of_another_size_are_told_by_their_axis() {
        let refused = |x: f64, y: f64, is_stated| {
            let centre = DVec2::new(x, y);
            let frame = Frame {
                centre,
                ..Frame::centred(640, 480, 500.0)
            };
            let camera = frame.perspective([0.0; 4], [0.0; 2]).unwrap();
            check_size(&camera, is_stated).err()
        };
        for (x, y) in [
            (320.0, 240.0),
            (340.0, 210.0),
            (390.0, 290.0),
            (600.0, 100.0),
        ] {
            assert_eq!((refused(x, y, false), refused(x, y, true)), (None, None));
        }
        for (x, y) in [(641.0, 240.0), (320.0, -1.0)] {
            let said = refused(x, y, false).unwrap();
            assert!(said.contains("outside the picture's 640x480"), "{said}");
            // A part of a larger picture.
            assert_eq!(refused(x, y, true), None);
        }
        // Of twice, one and a half times and half the size.
        for (x, y) in [(638.0, 479.0), (481.0, 358.0), (160.0, 121.0)] {
            let said = refused(x, y, false).unwrap();
            assert!(
                said.contains("the photo has 640x480, so it is for"),
                "{said}"
            );
            assert_eq!(refused(x, y, true), None);
        }
        assert!(check_size(&Frame::panorama(640, 320), false).is_ok());
    }

    #[test]
    fn the_smallest_model_is_chosen() {
        let frame = Frame::centred(640, 480, 500.0);
        let perspective = |k, p| frame.perspective(k, p).unwrap().model;
        assert_eq!(perspective([0.0; 4], [0.0; 2]), CameraModel::Pinhole);
        assert_eq!(
            perspective([0.1, 0.0, 0.0, 0.0], [0.0; 2]),
            CameraModel::OpenCv
        );
        assert_eq!(
            perspective([0.1, 0.0, 0.1, 0.0], [0.0; 2]),
            CameraModel::FullOpenCv
        );
        let fisheye = |p| frame.fisheye([0.1, 0.0, 0.0, 0.0], p).unwrap().model;
        assert_eq!(fisheye([0.0; 2]), CameraModel::OpenCvFisheye);
        assert_eq!(fisheye([0.0, 1e-3]), CameraModel::ThinPrismFisheye);
        assert!(
            Frame::centred(640, 480, -5.0)
                .perspective([0.0; 4], [0.0; 2])
                .is_err()
        );
        assert!(
            Frame::centred(640, 480, f64::NAN)
                .fisheye([0.0; 4], [0.0; 2])
                .is_err()
        );
        assert!(
            Frame::centred(0, 480, 5.0)
                .perspective([0.0; 4], [0.0; 2])
                .is_err()
        );
    }

    #[test]
    fn a_fourth_radial_term_is_kept_by_a_quotient() {
        let frame = Frame::centred(640, 480, 500.0);
        let k = [-0.28, 0.11, -0.03, 0.008];
        let camera = frame.perspective(k, [1e-3, -5e-4]).unwrap();
        for (x, y) in [(0.0, 0.0), (0.3, 0.1), (-0.5, 0.4), (0.62, -0.46)] {
            let (u, v): (f64, f64) = (x, y);
            let t = u * u + v * v;
            let radial = 1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])));
            let expected = DVec2::new(
                u * radial + 2.0 * 1e-3 * u * v - 5e-4 * (t + 2.0 * u * u),
                v * radial + 1e-3 * (t + 2.0 * v * v) - 2.0 * 5e-4 * u * v,
            ) * 500.0
                + DVec2::new(320.0, 240.0);
            let found = camera.project(DVec3::new(u, v, 1.0)).unwrap();
            assert!(found.distance(expected) < NEGLIGIBLE, "{found} {expected}");
        }
        // What no lens does is refused instead of bent.
        let error = frame.perspective([0.0, 0.0, 0.0, f64::INFINITY], [0.0; 2]);
        assert!(error.unwrap_err().contains("not finite"));
    }
}
