//! The list of COLMAP's camera models: numbers, names and parameter layouts.

use serde::{Deserialize, Serialize};

/// COLMAP's camera models, up to version 4. Parameters are listed in file order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum CameraModel {
    /// `f, cx, cy`
    SimplePinhole,
    /// `fx, fy, cx, cy`
    Pinhole,
    /// `f, cx, cy, k`
    SimpleRadial,
    /// `f, cx, cy, k1, k2`
    Radial,
    /// `fx, fy, cx, cy, k1, k2, p1, p2`
    OpenCv,
    /// `fx, fy, cx, cy, k1, k2, k3, k4`
    OpenCvFisheye,
    /// `fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6`
    FullOpenCv,
    /// `fx, fy, cx, cy, omega`
    Fov,
    /// `f, cx, cy, k`
    SimpleRadialFisheye,
    /// `f, cx, cy, k1, k2`
    RadialFisheye,
    /// `fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1`
    ThinPrismFisheye,
    /// `fx, fy, cx, cy, k0..k5, p0, p1, s0..s3`
    RadTanThinPrismFisheye,
    /// `f, cx, cy, k`
    SimpleDivision,
    /// `fx, fy, cx, cy, k`
    Division,
    /// `f, cx, cy`
    SimpleFisheye,
    /// `fx, fy, cx, cy`
    Fisheye,
    /// `fx, fy, cx, cy, alpha, beta`
    Eucm,
    /// `width, height`: a full panorama
    Equirectangular,
}

use CameraModel as M;

/// In the order of COLMAP's numbers, which start at 0: name, count of focal lengths, count of
/// parameters after the principal point.
const TABLE: [(CameraModel, &str, usize, usize); 18] = [
    (M::SimplePinhole, "SIMPLE_PINHOLE", 1, 0),
    (M::Pinhole, "PINHOLE", 2, 0),
    (M::SimpleRadial, "SIMPLE_RADIAL", 1, 1),
    (M::Radial, "RADIAL", 1, 2),
    (M::OpenCv, "OPENCV", 2, 4),
    (M::OpenCvFisheye, "OPENCV_FISHEYE", 2, 4),
    (M::FullOpenCv, "FULL_OPENCV", 2, 8),
    (M::Fov, "FOV", 2, 1),
    (M::SimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 1, 1),
    (M::RadialFisheye, "RADIAL_FISHEYE", 1, 2),
    (M::ThinPrismFisheye, "THIN_PRISM_FISHEYE", 2, 8),
    (
        M::RadTanThinPrismFisheye,
        "RAD_TAN_THIN_PRISM_FISHEYE",
        2,
        12,
    ),
    (M::SimpleDivision, "SIMPLE_DIVISION", 1, 1),
    (M::Division, "DIVISION", 2, 1),
    (M::SimpleFisheye, "SIMPLE_FISHEYE", 1, 0),
    (M::Fisheye, "FISHEYE", 2, 0),
    (M::Eucm, "EUCM", 2, 2),
    // A panorama has neither focal length nor principal point: `width, height` fill the place.
    (M::Equirectangular, "EQUIRECTANGULAR", 0, 0),
];

impl CameraModel {
    /// Every model, in the order of COLMAP's numbers.
    pub fn all() -> impl Iterator<Item = CameraModel> {
        TABLE.iter().map(|row| row.0)
    }

    /// The model with this number in `cameras.bin`.
    #[must_use]
    pub fn from_id(id: i32) -> Option<CameraModel> {
        TABLE.get(usize::try_from(id).ok()?).map(|row| row.0)
    }

    /// The model with this name in `cameras.txt`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<CameraModel> {
        TABLE.iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// COLMAP's number.
    #[must_use]
    pub fn id(self) -> i32 {
        self as i32
    }

    /// COLMAP's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        TABLE[self as usize].1
    }

    /// How many parameters a camera of this model has.
    #[must_use]
    pub fn param_count(self) -> usize {
        let row = TABLE[self as usize];
        row.2 + 2 + row.3
    }

    /// 1 where both axes share a focal length, 2 where they do not, 0 for panoramas.
    pub(crate) fn focal_count(self) -> usize {
        TABLE[self as usize].2
    }
}

impl std::fmt::Display for CameraModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_names_lead_back_to_the_model() {
        for (number, model) in CameraModel::all().enumerate() {
            assert_eq!(model.id(), number as i32);
            assert_eq!(CameraModel::from_id(model.id()), Some(model));
            assert_eq!(CameraModel::from_name(model.name()), Some(model));
        }
        assert_eq!(CameraModel::from_id(-1), None);
        assert_eq!(CameraModel::from_id(18), None);
        assert_eq!(CameraModel::RadTanThinPrismFisheye.param_count(), 16);
        assert_eq!(CameraModel::Equirectangular.param_count(), 2);
    }
}
