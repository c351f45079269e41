//! For tests: cameras, and masks of balls.

#![allow(clippy::unwrap_used)]

use glam::{DQuat, DVec2, DVec3};
use io_colmap::{Camera, CameraModel, Pose};

use super::pixels::PixelStore;
use super::view::{Lens, TrainView};

/// A camera of 64x48 pixels without a mask.
pub(crate) fn view(centre: DVec3, forward: DVec3) -> TrainView {
    let world_from_camera = Pose {
        rotation: DQuat::from_rotation_arc(DVec3::Z, forward.normalize()),
        translation: centre,
    };
    let store = PixelStore::new(&std::env::temp_dir());
    TrainView {
        name: "a.png".into(),
        lens: Lens(Camera {
            id: 1,
            model: CameraModel::Pinhole,
            width: 64,
            height: 48,
            params: vec![60.0, 60.0, 32.0, 24.0],
        }),
        camera_from_world: world_from_camera.inverse(),
        photo: store.keep_photo(image::RgbImage::new(64, 48)).unwrap(),
        mask: None,
        ignored: None,
        store,
    }
}

/// The view with the mask of balls, given by centres and radii.
pub(crate) fn with_balls(view: TrainView, balls: &[(DVec3, f64)]) -> TrainView {
    let world_from_camera = view.camera_from_world.inverse();
    let shows_ball = |x: u32, y: u32| {
        let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let ray = view.lens.0.unproject(pixel).unwrap();
        let ray = world_from_camera.transform_vector(ray).normalize();
        balls.iter().any(|(centre, radius)| {
            let to_ball = *centre - world_from_camera.translation;
            to_ball.dot(ray) > 0.0 && to_ball.reject_from(ray).length() < *radius
        })
    };
    let mask = |x, y| image::Luma([255 * u8::from(shows_ball(x, y))]);
    let mask = image::GrayImage::from_fn(64, 48, mask);
    view.with_mask(&mask).unwrap()
}
