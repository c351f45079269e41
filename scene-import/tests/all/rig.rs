//! A few cameras whose every number is known, and what they must see: the oracle that all formats
//! are held against. Nothing here uses the crate's own conversions.

use glam::{DMat3, DVec2, DVec3};
use io_colmap::Model;
use std::path::{Path, PathBuf};

/// A camera by its directions in the world.
#[derive(Debug, Clone)]
pub(crate) struct Eye {
    pub(crate) name: String,
    pub(crate) right: DVec3,
    pub(crate) down: DVec3,
    pub(crate) forward: DVec3,
    pub(crate) centre: DVec3,
}

impl Eye {
    /// At `centre`, looking at `target`, with the world's z about up.
    pub(crate) fn looking(name: &str, centre: DVec3, target: DVec3) -> Eye {
        let forward = (target - centre).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        Eye {
            name: name.to_owned(),
            right,
            down: forward.cross(right),
            forward,
            centre,
        }
    }

    /// `world_from_camera` as columns.
    pub(crate) fn axes(&self) -> DMat3 {
        DMat3::from_cols(self.right, self.down, self.forward)
    }

    /// Where a world point lies on the plane one unit in front of the camera.
    pub(crate) fn plane(&self, point: DVec3) -> DVec2 {
        let p = point - self.centre;
        DVec2::new(p.dot(self.right), p.dot(self.down)) / p.dot(self.forward)
    }
}

/// Pixels across and down of the photos.
pub(crate) const WIDTH: u32 = 96;
pub(crate) const HEIGHT: u32 = 64;
pub(crate) const FOCAL: DVec2 = DVec2::new(110.0, 105.0);
pub(crate) const CENTRE: DVec2 = DVec2::new(47.0, 33.5);

pub(crate) fn eyes() -> Vec<Eye> {
    [
        ("0001", DVec3::new(3.0, -1.0, 1.0)),
        ("0002", DVec3::new(1.0, 3.0, 2.0)),
        ("0003", DVec3::new(-2.5, 1.0, -0.5)),
        ("0004", DVec3::new(0.5, -3.0, 0.3)),
    ]
    .into_iter()
    .map(|(name, centre)| Eye::looking(name, centre, DVec3::new(0.1, -0.2, 0.05)))
    .collect()
}

/// Points that all of them see.
pub(crate) const POINTS: [DVec3; 5] = [
    DVec3::ZERO,
    DVec3::new(0.5, 0.2, -0.3),
    DVec3::new(-0.4, 0.6, 0.2),
    DVec3::new(0.1, -0.7, 0.4),
    DVec3::new(-0.3, -0.2, -0.5),
];

/// The pixel without distortion.
pub(crate) fn pinhole(plane: DVec2) -> DVec2 {
    plane * FOCAL + CENTRE
}

/// Brown's distortion, as OpenCV's documentation writes it: `k1 k2 p1 p2 k3`.
pub(crate) fn brown(plane: DVec2, [k1, k2, p1, p2, k3]: [f64; 5]) -> DVec2 {
    let (x, y) = (plane.x, plane.y);
    let r2 = x * x + y * y;
    let radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
    DVec2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )
}

/// A photo that can be told from the others.
pub(crate) fn write_photo(path: &Path, width: u32, height: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let seed = path
        .display()
        .to_string()
        .bytes()
        .map(u32::from)
        .sum::<u32>();
    image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([(x * 7 + seed) as u8, (y * 5) as u8, (x ^ y) as u8])
    })
    .save(path)
    .unwrap();
}

/// All photos, as `folder/NAME.png`.
pub(crate) fn write_photos(folder: &Path) -> Vec<PathBuf> {
    eyes()
        .iter()
        .map(|eye| {
            let path = folder.join(format!("{}.png", eye.name));
            write_photo(&path, WIDTH, HEIGHT);
            path
        })
        .collect()
}

/// Every view of the model must see every point where `pixel` says (from the point on the plane in
/// front of the eye of that stem), to within `tolerance` pixels.
pub(crate) fn assert_sees(
    model: &Model,
    eyes: &[Eye],
    tolerance: f64,
    pixel: impl Fn(&Eye, DVec2) -> DVec2,
) {
    assert_eq!(model.views.len(), eyes.len());
    for view in &model.views {
        let stem = Path::new(&view.name).file_stem().unwrap().to_str().unwrap();
        let eye = eyes
            .iter()
            .find(|eye| eye.name == stem)
            .unwrap_or_else(|| panic!("{stem}"));
        let camera = &model.cameras[&view.camera_id];
        for point in POINTS {
            let expected = pixel(eye, eye.plane(point));
            let found = camera
                .project(view.camera_from_world.transform_point(point))
                .unwrap_or_else(|| panic!("{stem} does not see {point}"));
            assert!(
                found.distance(expected) < tolerance,
                "{stem} sees {point} at {found}, not {expected}"
            );
        }
        assert!(
            view.camera_from_world.centre().distance(eye.centre)
                < 1e-6 * (1.0 + eye.centre.length())
        );
    }
}
