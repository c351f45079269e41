//! Cameras where no photo was taken: once around the object, along the photographer's way, and those of
//! another model of the scene.

use crate::prepare::Prepared;
use crate::prepare::error::PrepareError;
use crate::prepare::view::{Lens, camera_of};
use crate::run_folder::view_file;
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};
use io_colmap::{Camera, CameraModel, Model};
use neus_render::rays::{Projection as _, Ray};
use std::path::Path;

/// How much of a turntable's picture the object's box takes, along its shorter side.
const FILL: f32 = 0.95;
/// How far along the way a camera counts, in views: hand-held ways are shaky.
const SMOOTH: f32 = 1.0;

/// A camera in the normalised frame.
#[derive(Clone, Debug)]
pub struct NovelCamera {
    /// What its picture is called: a view's name without its ending, or a number.
    pub name: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// From pixels to directions.
    pub lens: Lens,
    /// OpenCV axes.
    pub world_from_camera: Affine3A,
}

impl NovelCamera {
    /// How wide a pixel is at the middle of the object's box.
    #[must_use]
    pub fn pixel_at_object(&self) -> f32 {
        let (fx, fy) = self.lens.0.focal();
        self.world_from_camera.translation.length() / (fx * fy).sqrt() as f32
    }

    /// The ray through a pixel position.
    #[must_use]
    pub fn ray(&self, pixel: Vec2) -> Option<Ray> {
        Ray::new(
            self.world_from_camera.translation.into(),
            self.world_from_camera
                .transform_vector3(self.lens.unproject(pixel)?),
        )
    }

    /// Looks from a place along `forward`, with `up` towards the top of the picture; a pinhole whose axis
    /// goes through the middle of the picture, `focal` in pixels.
    fn looking(
        number: u32,
        size: (u32, u32),
        focal: f32,
        from: Vec3,
        forward: Vec3,
        up: Vec3,
    ) -> Self {
        let forward = forward.normalize_or(Vec3::Z);
        let right = forward.cross(up).try_normalize();
        let right = right.unwrap_or_else(|| forward.any_orthonormal_vector());
        let down = forward.cross(right);
        Self {
            name: format!("{number:04}"),
            width: size.0,
            height: size.1,
            lens: Lens(Camera {
                id: 1,
                model: CameraModel::SimplePinhole,
                width: size.0,
                height: size.1,
                params: vec![
                    f64::from(focal),
                    0.5 * f64::from(size.0),
                    0.5 * f64::from(size.1),
                ],
            }),
            world_from_camera: Affine3A {
                matrix3: Mat3A::from_cols(right.into(), down.into(), forward.into()),
                translation: Vec3A::from(from),
            },
        }
    }
}

/// What is known of the photos' cameras, in the normalised frame.
struct Posed {
    centre: Vec3,
    forward: Vec3,
    up: Vec3,
}

fn posed(data: &Prepared) -> Vec<Posed> {
    data.views
        .iter()
        .map(|view| {
            let pose = view.world_from_camera(&data.frame);
            Posed {
                centre: pose.translation.into(),
                forward: pose.matrix3.z_axis.into(),
                up: (-pose.matrix3.y_axis).into(),
            }
        })
        .collect()
}

/// Even width and height with the first photo's shape, `longest` pixels along the longer side.
#[must_use]
pub fn size_like_photos(data: &Prepared, longest: u32) -> (u32, u32) {
    let (w, h) = data
        .views
        .first()
        .map_or((4, 3), |view| (view.width(), view.height()));
    let scale = f64::from(longest) / f64::from(w.max(h));
    let even = |side: u32| ((f64::from(side) * scale / 2.0).round() as u32 * 2).max(2);
    (even(w), even(h))
}

/// `count` cameras around the object at equal angles, from where the first photo was taken, as far and
/// as high as the photos on average; the object fills the picture.
#[must_use]
pub fn turntable(data: &Prepared, count: u32, size: (u32, u32)) -> Vec<NovelCamera> {
    let posed = posed(data);
    let n = posed.len().max(1) as f32;
    let up = posed.iter().map(|at| at.up).sum::<Vec3>();
    let up = up.normalize_or(Vec3::Y);
    let height = posed.iter().map(|at| at.centre.dot(up)).sum::<f32>() / n;
    let flat = |at: &Posed| at.centre.reject_from_normalized(up);
    let away = posed.iter().map(|at| flat(at).length()).sum::<f32>() / n;
    let first = posed.first().map_or(Vec3::X, flat);
    let first = first.normalize_or(up.any_orthonormal_vector());
    let beside = up.cross(first);
    // Not inside the box, where cameras of a room look outwards.
    let away = away.max(2.0);
    let distance = away.hypot(height);
    let focal = FILL * 0.5 * size.0.min(size.1) as f32 * distance;
    (0..count)
        .map(|i| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / count as f32).sin_cos();
            let from = away * (cos * first + sin * beside) + height * up;
            NovelCamera::looking(i, size, focal, from, -from, up)
        })
        .collect()
}

/// `count` cameras along the way from the first photo to the last, in the order of their names, with
/// the photos' field of view; the way is smooth where the photographer's hand was not.
#[must_use]
pub fn along_the_photos(data: &Prepared, count: u32, size: (u32, u32)) -> Vec<NovelCamera> {
    let posed = posed(data);
    let Some(view) = data.views.first() else {
        return Vec::new();
    };
    let (fx, _) = view.lens.0.focal();
    let focal = (fx * f64::from(size.0) / f64::from(view.width())) as f32;
    let last = posed.len() as f32 - 1.0;
    (0..count)
        .map(|i| {
            let at = last * i as f32 / (count as f32 - 1.0).max(1.0);
            let (mut centre, mut forward, mut up) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
            let mut weights = 0.0;
            for (k, camera) in posed.iter().enumerate() {
                let far = (k as f32 - at) / SMOOTH;
                let weight = (-0.5 * far * far).exp();
                centre += weight * camera.centre;
                forward += weight * camera.forward;
                up += weight * camera.up;
                weights += weight;
            }
            NovelCamera::looking(i, size, focal, centre / weights, forward, up)
        })
        .collect()
}

/// The cameras of another model in the scene's own frame, such as of photos that were held back, at their
/// own sizes.
///
/// # Errors
/// [`PrepareError::Scene`] for a view whose camera the model lacks: none is left out in silence.
pub fn of_model(data: &Prepared, model: &Model) -> Result<Vec<NovelCamera>, PrepareError> {
    let cameras = model.views.iter().map(|view| {
        let camera = camera_of(model, view)?;
        // A name from a file never leads out of the folder.
        let name = view_file(Path::new(""), &view.name, "png").with_extension("");
        Ok(NovelCamera {
            name: name.to_string_lossy().into_owned(),
            width: camera.width,
            height: camera.height,
            lens: Lens(camera.clone()),
            world_from_camera: data.frame.world_from_camera(&view.camera_from_world),
        })
    });
    cameras.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_picture_is_looked_at_and_up_is_up() {
        let camera = NovelCamera::looking(0, (40, 30), 50.0, 5.0 * Vec3::Z, -Vec3::Z, Vec3::Y);
        let at = |x: f32, y: f32| camera.ray(Vec2::new(x, y)).map(|ray| ray.direction);
        let middle = at(20.0, 15.0).unwrap_or_default();
        assert!(middle.distance(-Vec3::Z) < 1e-6, "{middle}");
        assert!(at(20.0, 0.0).unwrap_or_default().y > 0.0);
        assert!(at(40.0, 15.0).unwrap_or_default().x > 0.0);
    }
}
