//! From the matrices that tools write to poses.

use glam::{DMat3, DQuat, DVec3};
use io_colmap::Pose;

/// Largest entry by which a matrix may differ from the nearest rotation: rounding to three decimals
/// passes, a shear does not.
const TOLERANCE: f64 = 0.01;

/// The pose of a camera from its axes and centre in world space.
///
/// `axes` has the camera's right, down and forward directions as columns. A common scale of the
/// columns is taken out.
pub(crate) fn camera_from_world(axes: DMat3, centre: DVec3) -> Result<Pose, String> {
    if !centre.is_finite() {
        return Err(format!("the camera is at {centre}"));
    }
    let rotation = DQuat::from_mat3(&rotation(axes)?).normalize();
    Ok(Pose {
        rotation,
        translation: centre,
    }
    .inverse())
}

/// The same from the transform in the other direction: `p_camera = rotation * p_world + translation`.
pub(crate) fn from_camera_from_world(matrix: DMat3, translation: DVec3) -> Result<Pose, String> {
    if !translation.is_finite() {
        return Err(format!("the translation is {translation}"));
    }
    Ok(Pose {
        rotation: DQuat::from_mat3(&rotation(matrix)?).normalize(),
        translation,
    })
}

/// OpenGL's camera axes (x right, y up, z backward) to ours, as columns of `world_from_camera`.
pub(crate) fn from_opengl(axes: DMat3) -> DMat3 {
    DMat3::from_cols(axes.x_axis, -axes.y_axis, -axes.z_axis)
}

/// The rotation nearest to a matrix that is one up to a common scale and rounding.
pub(crate) fn rotation(matrix: DMat3) -> Result<DMat3, String> {
    if !matrix.is_finite() {
        return Err("the rotation is not finite".to_owned());
    }
    let largest = matrix.abs_entries().into_iter().fold(0.0_f64, f64::max);
    // Scaled first, so that nothing overflows.
    let unit = matrix * (1.0 / largest);
    let determinant = unit.determinant();
    if largest == 0.0 || determinant.abs() < 1e-6 {
        return Err("the rotation matrix is singular".to_owned());
    }
    if determinant < 0.0 {
        return Err("the rotation matrix mirrors".to_owned());
    }
    let unit = unit * determinant.cbrt().recip();
    // Higham's iteration towards the orthogonal factor of the polar decomposition.
    let mut nearest = unit;
    for _ in 0..30 {
        nearest = (nearest + nearest.inverse().transpose()) * 0.5;
    }
    let off = (nearest - unit)
        .abs_entries()
        .into_iter()
        .fold(0.0_f64, f64::max);
    if nearest.is_finite() && off <= TOLERANCE {
        Ok(nearest)
    } else {
        Err(format!(
            "the rotation matrix is none: it is {off:.2} off the nearest rotation"
        ))
    }
}

trait Entries {
    fn abs_entries(&self) -> [f64; 9];
}

impl Entries for DMat3 {
    fn abs_entries(&self) -> [f64; 9] {
        self.to_cols_array().map(f64::abs)
    }
}

/// A 3x3 matrix from rows.
pub(crate) fn rows(rows: [[f64; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&rows).transpose()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn scaled_and_rounded_rotations_pass_and_others_do_not() {
        let exact = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0));
        let rounded =
            DMat3::from_cols_array(&exact.to_cols_array().map(|v| (v * 1e3).round() / 1e3));
        for matrix in [exact, exact * 250.0, exact * 1e-9, rounded] {
            let found = rotation(matrix).unwrap();
            assert!((found - exact).abs_entries().iter().all(|d| *d < 1e-3));
            assert!((found.determinant() - 1.0).abs() < 1e-12);
        }
        for (wrong, says) in [
            (exact * -1.0, "mirrors"),
            (DMat3::ZERO, "singular"),
            (
                DMat3::from_cols(exact.x_axis, exact.x_axis, exact.z_axis),
                "singular",
            ),
            (exact * f64::NAN, "not finite"),
            (
                exact * DMat3::from_diagonal(DVec3::new(1.0, 1.2, 1.0)),
                "none",
            ),
        ] {
            let error = rotation(wrong).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn opengl_cameras_look_along_their_negative_z() {
        // At the origin, unrotated in OpenGL's sense: looks along -z of the world, y is up.
        let pose = camera_from_world(from_opengl(DMat3::IDENTITY), DVec3::ZERO).unwrap();
        assert!(
            (pose.transform_point(DVec3::new(0.0, 0.0, -3.0)) - DVec3::Z * 3.0).length() < 1e-12
        );
        assert!((pose.transform_vector(DVec3::Y) + DVec3::Y).length() < 1e-12);
    }
}
