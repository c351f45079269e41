//! For tests: a photo of a disc on a ground with a pattern.

#![allow(clippy::unwrap_used)]

use glam::{DQuat, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};
use io_colmap::{Camera, CameraModel, Pose};

use super::pixels::PixelStore;
use super::view::{Lens, TrainView};

/// Columns and rows from the middle of a picture.
fn from_middle(width: u32, height: u32, x: u32, y: u32) -> (f32, f32) {
    (
        x as f32 - 0.5 * width as f32,
        y as f32 - 0.5 * height as f32,
    )
}

/// The photo, without a mask, of a bright disc in the middle.
pub(crate) fn view(width: u32, height: u32, radius: f32) -> TrainView {
    let store = PixelStore::new(&std::env::temp_dir());
    let photo = RgbImage::from_fn(width, height, |x, y| {
        let (u, v) = from_middle(width, height, x, y);
        let pattern = (8.0 * ((x as f32 * 0.7).sin() + (y as f32 * 0.9).cos())) as i32;
        let base = if u.hypot(v) < radius { 170 } else { 90 };
        Rgb([(base + pattern) as u8; 3])
    });
    TrainView {
        name: "disc".to_owned(),
        lens: Lens(Camera {
            id: 1,
            model: CameraModel::Pinhole,
            width,
            height,
            params: vec![
                200.0,
                200.0,
                0.5 * f64::from(width),
                0.5 * f64::from(height),
            ],
        }),
        camera_from_world: Pose {
            rotation: DQuat::IDENTITY,
            translation: DVec3::ZERO,
        },
        photo: store.keep_photo(photo).unwrap(),
        mask: None,
        ignored: None,
        store,
    }
}

/// White where `inside` says so of columns and rows from the middle.
pub(crate) fn picture(width: u32, height: u32, inside: impl Fn(f32, f32) -> bool) -> GrayImage {
    GrayImage::from_fn(width, height, |x, y| {
        let (u, v) = from_middle(width, height, x, y);
        Luma([if inside(u, v) { 255 } else { 0 }])
    })
}
