//! `transforms.json` as nerfstudio and instant-ngp read it.
//!
//! Poses are `world_from_camera` with OpenGL's camera axes (x right, y up, z backward), in the world
//! frame of the scene. Intrinsics stand at the top where all photos share a camera, else in each frame;
//! `camera_model` and `is_fisheye` stand at the top, so lenses of both kinds cannot be mixed.
//! Perspective lenses are written with `k1 k2 p1 p2` and fisheyes with `k1 … k4`, and never both:
//! instant-ngp keeps `p1 p2` where it keeps `k3 k4`.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::pinhole::UNDISTORT;
use crate::product::MaskTool;
use glam::{DMat3, DVec3};
use io_colmap::{Camera, CameraModel, Pose};
use serde_json::{Map, Value, json};
use std::io::Write as _;
use std::path::Path;

/// instant-ngp's unit cube is this much larger than the object.
const MARGIN: f64 = 1.1;

/// One photo.
pub(crate) struct Frame<'a> {
    pub(crate) camera: Option<&'a Camera>,
    pub(crate) pose: Pose,
    /// Paths from the file's folder.
    pub(crate) photo: String,
    pub(crate) mask: Option<String>,
}

/// Writes the file; `bounds` is the box around the object, for instant-ngp.
pub(crate) fn write(
    tool: MaskTool,
    frames: &[Frame<'_>],
    bounds: Option<(DVec3, DVec3)>,
    scene: &Path,
    draft: &Draft,
) -> Result<(), ExportError> {
    let mut top = Map::new();
    let lenses: Vec<Lens> = frames
        .iter()
        .map(|frame| lens(frame, tool, scene))
        .collect::<Result<_, ExportError>>()?;
    let fisheye = lenses.first().is_some_and(|lens| lens.fisheye);
    if lenses.iter().any(|lens| lens.fisheye != fisheye) {
        return Err(ExportError::bad(
            scene,
            format!(
                "it mixes fisheye and other lenses, for which {} has no words",
                tool.name()
            ),
            UNDISTORT,
        ));
    }
    let model = if fisheye { "OPENCV_FISHEYE" } else { "OPENCV" };
    top.insert("camera_model".to_owned(), model.into());
    if fisheye {
        top.insert("is_fisheye".to_owned(), true.into());
    }
    let shared = lenses
        .windows(2)
        .all(|pair| pair[0].numbers == pair[1].numbers);
    if let (true, Some(lens)) = (shared, lenses.first()) {
        top.extend(lens.numbers.clone());
    }
    if let (MaskTool::InstantNgp, Some((low, high))) = (tool, bounds) {
        let scale = 1.0 / (MARGIN * (high - low).max_element()).max(f64::MIN_POSITIVE);
        let offset = DVec3::splat(0.5) - scale * (low + high) / 2.0;
        top.insert("aabb_scale".to_owned(), 1.into());
        top.insert("scale".to_owned(), scale.into());
        top.insert("offset".to_owned(), json!(offset.to_array()));
    }
    let list = frames.iter().zip(lenses).map(|(frame, lens)| {
        let mut one = Map::new();
        one.insert("file_path".to_owned(), frame.photo.clone().into());
        if let Some(mask) = &frame.mask {
            one.insert("mask_path".to_owned(), mask.clone().into());
        }
        if !shared {
            one.extend(lens.numbers);
        }
        one.insert("transform_matrix".to_owned(), matrix(&frame.pose));
        Value::Object(one)
    });
    let list: Vec<Value> = list.collect();
    top.insert("frames".to_owned(), list.into());
    draft.write("transforms.json", |out| {
        serde_json::to_writer_pretty(&mut *out, &top)?;
        writeln!(out)
    })
}

struct Lens {
    fisheye: bool,
    numbers: Map<String, Value>,
}

fn lens(frame: &Frame<'_>, tool: MaskTool, scene: &Path) -> Result<Lens, ExportError> {
    use CameraModel as M;
    let described = frame.camera.and_then(|camera| {
        let extra = match camera.model {
            M::SimplePinhole | M::SimpleRadial | M::Radial => camera.params.get(3..),
            M::SimpleRadialFisheye | M::RadialFisheye => camera.params.get(3..),
            _ => camera.params.get(4..),
        }?;
        let fisheye = match camera.model {
            M::SimplePinhole | M::Pinhole | M::SimpleRadial | M::Radial | M::OpenCv => false,
            M::OpenCvFisheye | M::SimpleRadialFisheye | M::RadialFisheye => true,
            _ => return None,
        };
        Some((camera, fisheye, extra))
    });
    let Some((camera, fisheye, extra)) = described else {
        let model = frame.camera.map_or("no", |camera| camera.model.name());
        return Err(ExportError::bad(
            &scene.join(&frame.photo),
            format!("its camera model {model} is none of {}'s", tool.name()),
            UNDISTORT,
        ));
    };
    let ((fx, fy), (cx, cy)) = (camera.focal(), camera.principal_point());
    let mut numbers = Map::new();
    numbers.insert("w".to_owned(), camera.width.into());
    numbers.insert("h".to_owned(), camera.height.into());
    for (name, value) in [("fl_x", fx), ("fl_y", fy), ("cx", cx), ("cy", cy)] {
        numbers.insert(name.to_owned(), value.into());
    }
    let names = if fisheye {
        ["k1", "k2", "k3", "k4"]
    } else {
        ["k1", "k2", "p1", "p2"]
    };
    for (i, name) in names.into_iter().enumerate() {
        let value = extra.get(i).copied().unwrap_or(0.0);
        numbers.insert(name.to_owned(), value.into());
    }
    Ok(Lens { fisheye, numbers })
}

/// Four rows of `world_from_camera` in OpenGL's axes.
fn matrix(camera_from_world: &Pose) -> Value {
    let world_from_camera = camera_from_world.inverse();
    let axes = DMat3::from_quat(world_from_camera.rotation);
    let (x, y, z) = (axes.x_axis, -axes.y_axis, -axes.z_axis);
    let c = world_from_camera.translation;
    json!([
        [x.x, y.x, z.x, c.x],
        [x.y, y.y, z.y, c.y],
        [x.z, y.z, z.z, c.z],
        [0.0, 0.0, 0.0, 1.0],
    ])
}
