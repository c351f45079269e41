//! Small models, photos and random numbers for the other tests.

use glam::{DQuat, DVec3};
use io_colmap::{Camera, CameraModel, Model, Pose, SparsePoint, View};
use std::path::Path;

/// SplitMix64: enough randomness for tests, the same on every machine.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// In `[-1, 1)`.
    pub(crate) fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// A camera of every model, 640 x 480, with distortion as real lenses have it.
pub(crate) fn cameras() -> Vec<Camera> {
    CameraModel::all()
        .zip(1..)
        .map(|(model, id)| Camera {
            id,
            model,
            width: 640,
            height: 480,
            params: params(model),
        })
        .collect()
}

fn params(model: CameraModel) -> Vec<f64> {
    use CameraModel::*;
    let one = |extra: &[f64]| [&[500.0, 318.0, 243.0], extra].concat();
    let two = |extra: &[f64]| [&[500.0, 505.0, 318.0, 243.0], extra].concat();
    match model {
        SimplePinhole | SimpleFisheye => one(&[]),
        Pinhole | Fisheye => two(&[]),
        SimpleRadial => one(&[-0.12]),
        Radial => one(&[-0.2, 0.06]),
        OpenCv => two(&[-0.21, 0.07, 0.001, -0.002]),
        OpenCvFisheye => two(&[0.02, -0.01, 0.003, -0.0005]),
        FullOpenCv => two(&[0.3, 0.1, 0.0005, -0.001, 0.02, 0.4, 0.12, 0.01]),
        Fov => two(&[0.6]),
        SimpleRadialFisheye => one(&[0.03]),
        RadialFisheye => one(&[0.03, -0.01]),
        ThinPrismFisheye => two(&[0.02, -0.01, 0.001, -0.002, 0.003, -0.001, 0.002, 0.001]),
        RadTanThinPrismFisheye => two(&[
            0.02, -0.01, 0.003, -0.001, 0.0004, -0.0001, 0.001, -0.002, 0.002, -0.0003, 0.001,
            0.0002,
        ]),
        SimpleDivision => one(&[-0.15]),
        Division => two(&[-0.15]),
        Eucm => two(&[0.6, 1.1]),
        Equirectangular => vec![640.0, 480.0],
        other => panic!("add parameters for {other}"),
    }
}

/// Six views on an arc, looking at twenty points near the origin, taken with every camera model.
pub(crate) fn model() -> Model {
    let mut random = Random(7);
    let mut model = Model::default();
    for camera in cameras() {
        model.cameras.insert(camera.id, camera);
    }
    for i in 0..18_u32 {
        let rotation = DQuat::from_euler(
            glam::EulerRot::YXZ,
            0.3 * f64::from(i),
            0.1 * random.signed(),
            0.05 * random.signed(),
        );
        model.views.push(View {
            id: 100 + i,
            name: format!("photo {i:03}.png"),
            camera_id: 1 + i,
            camera_from_world: Pose {
                rotation: rotation.normalize(),
                translation: DVec3::new(random.signed(), random.signed(), 6.0),
            },
        });
    }
    for id in 0..20 {
        model.points.push(SparsePoint {
            id: 1000 + id,
            position: DVec3::new(random.signed(), random.signed(), random.signed()),
            colour: [id as u8, 128, 255 - id as u8],
            error: 0.25 * (1.0 + random.signed()),
            views: (100..118).filter(|_| random.below(3) > 0).collect(),
        });
    }
    model
}

/// Writes a scene: the model in `sparse/0` and a grey photo for every view.
pub(crate) fn write_scene(dir: &Path, model: &Model) {
    model.write_binary(&dir.join("sparse/0")).unwrap();
    for view in &model.views {
        let camera = &model.cameras[&view.camera_id];
        write_photo(
            &dir.join("images").join(&view.name),
            camera.width,
            camera.height,
        );
    }
}

pub(crate) fn write_photo(path: &Path, width: u32, height: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::GrayImage::from_pixel(width, height, image::Luma([90]))
        .save(path)
        .unwrap();
}

/// A model of a few small photos, all by one camera of 64 x 48.
pub(crate) fn small(names: &[&str]) -> Model {
    let mut model = Model::default();
    model.cameras.insert(
        1,
        Camera {
            id: 1,
            model: CameraModel::SimpleRadial,
            width: 64,
            height: 48,
            params: vec![60.0, 32.0, 24.0, 0.01],
        },
    );
    for (name, id) in names.iter().zip(1..) {
        model.views.push(View {
            id,
            name: (*name).to_owned(),
            camera_id: 1,
            camera_from_world: Pose {
                translation: DVec3::new(0.0, 0.0, 4.0),
                ..Pose::IDENTITY
            },
        });
    }
    model
}
