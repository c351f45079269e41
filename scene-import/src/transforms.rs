//! `transforms.json`: NeRF's synthetic scenes, instant-ngp, nerfstudio.
//!
//! Poses take camera space with OpenGL's axes (x right, y up, z backward) to the world. Intrinsics
//! stand at the top, in each frame, or both; the frame's win.

use crate::error::{ImportError, load_text};
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported, other_claims};
use crate::lens::{Frame as LensFrame, check_size};
use crate::photos::{Lookup, Match, at_path, stored_size};
use crate::pose;
use glam::{DMat3, DVec2, DVec3};
use io_colmap::{Camera, CameraModel, Pose};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::path::Path;

/// Every way in which the tools state a lens.
#[derive(Debug, Clone, Default)]
struct Lens {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    /// Radians.
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    /// Degrees.
    x_fov: Option<f64>,
    y_fov: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    distortion_params: Option<Vec<f64>>,
}

/// Hands the names of a [`Lens`]'s fields to a macro.
macro_rules! with_lens_fields {
    ($then:ident) => {
        $then!(
            camera_model,
            is_fisheye,
            w,
            h,
            fl_x,
            fl_y,
            cx,
            cy,
            camera_angle_x,
            camera_angle_y,
            x_fov,
            y_fov,
            k1,
            k2,
            k3,
            k4,
            p1,
            p2,
            distortion_params
        )
    };
}

impl Lens {
    fn of(entries: &Map<String, Value>) -> Result<Lens, String> {
        macro_rules! read {
            ($($field:ident),*) => { Ok(Lens { $($field: entry(entries, stringify!($field))?),* }) };
        }
        with_lens_fields!(read)
    }

    /// This frame's values, and the file's where it has none. A focal length is one value however it is
    /// stated: a frame's angle is not overruled by the file's `fl_x`. Each axis is by itself.
    fn over(&self, file: &Lens) -> Lens {
        let mut file = file.clone();
        if self.fl_x.or(self.camera_angle_x).or(self.x_fov).is_some() {
            (file.fl_x, file.camera_angle_x, file.x_fov) = (None, None, None);
        }
        if self.fl_y.or(self.camera_angle_y).or(self.y_fov).is_some() {
            (file.fl_y, file.camera_angle_y, file.y_fov) = (None, None, None);
        }
        macro_rules! merge {
            ($($field:ident),*) => { Lens { $($field: self.$field.clone().or_else(|| file.$field.clone())),* } };
        }
        with_lens_fields!(merge)
    }

    /// The size that it is for: as stated, or the photo's. Of one side alone, the photo's shape tells the other.
    fn size(&self, photo: (u32, u32)) -> Result<(u32, u32), String> {
        let like = |side: u32, by: u32, of: u32| {
            let other = f64::from(side) * f64::from(by) / f64::from(of.max(1));
            other.round().max(1.0) as u32
        };
        let (w, h) = (
            self.w.map(whole).transpose()?,
            self.h.map(whole).transpose()?,
        );
        Ok(match (w, h) {
            (Some(w), Some(h)) => (w, h),
            (Some(w), None) => (w, like(w, photo.1, photo.0)),
            (None, Some(h)) => (like(h, photo.0, photo.1), h),
            (None, None) => photo,
        })
    }
}

#[derive(Debug)]
struct File {
    lens: Lens,
    frames: Vec<FrameEntry>,
    applied_transform: Option<Vec<Vec<f64>>>,
    applied_scale: Option<f64>,
}

#[derive(Debug)]
struct FrameEntry {
    lens: Lens,
    file_path: String,
    mask_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
}

impl File {
    /// What the file says, or which of its entries says nothing: in a file of one line, no number of a line would.
    fn of(file: &Value) -> Result<File, String> {
        let entries = file.as_object().ok_or("it is no object with frames")?;
        let frames = entries.get("frames").and_then(Value::as_array);
        let frames = frames.ok_or("frames: there is no such list")?;
        let frames = frames.iter().enumerate().map(|(i, frame)| {
            FrameEntry::of(frame).map_err(|what| {
                let name = frame["file_path"].as_str();
                let name = name.map_or_else(String::new, |name| format!(" ({name})"));
                format!("frame {}{name}: {what}", i + 1)
            })
        });
        Ok(File {
            lens: Lens::of(entries)?,
            frames: frames.collect::<Result<_, _>>()?,
            applied_transform: entry(entries, "applied_transform")?,
            applied_scale: entry(entries, "applied_scale")?,
        })
    }
}

impl FrameEntry {
    fn of(frame: &Value) -> Result<FrameEntry, String> {
        let entries = frame.as_object().ok_or("it is no object")?;
        let missing = |key: &str| format!("{key} is missing");
        Ok(FrameEntry {
            lens: Lens::of(entries)?,
            file_path: entry(entries, "file_path")?.ok_or_else(|| missing("file_path"))?,
            mask_path: entry(entries, "mask_path")?,
            transform_matrix: entry(entries, "transform_matrix")?
                .ok_or_else(|| missing("transform_matrix"))?,
        })
    }
}

/// The value of a key, if it has one; an error names the key.
fn entry<T: DeserializeOwned>(
    entries: &Map<String, Value>,
    key: &str,
) -> Result<Option<T>, String> {
    let value = entries.get(key).filter(|value| !value.is_null());
    let read = value.map(|value| T::deserialize(value).map_err(|e| format!("{key}: {e}")));
    read.transpose()
}

/// `p_file = scale * (rotation * p_original + shift)`, as nerfstudio's converters wrote it down.
struct Applied {
    rotation: DMat3,
    shift: DVec3,
    scale: f64,
}

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let path = &detected.source;
    let json: Value =
        serde_json::from_str(&load_text(path)?).map_err(|e| ImportError::json(path, &e))?;
    let file = File::of(&json)
        .map_err(|what| ImportError::bad(path, what, "correct the file or export it again"))?;
    drop(json);
    let mut gather = Gather::default();
    let applied = applied(&file, path)?;
    if applied.is_some() {
        gather.notes.push(
            "applied_transform is undone: the scene comes in the frame it had before nerfstudio turned it"
                .to_owned(),
        );
    }
    let photos = Lookup::new(&detected.root, images)?;
    gather.leave_out(photos.left_out());
    let mut masks = Masks::default();
    for (i, frame) in file.frames.iter().enumerate() {
        let stated_mask = frame.mask_path.as_deref();
        let mask = stated_mask.and_then(|stated| at_path(&detected.root, stated));
        let photo = match photos.find(&frame.file_path) {
            Ok(photo) => photo,
            Err(why) => {
                gather.drop_view(&frame.file_path, why);
                masks.others.extend(mask);
                continue;
            }
        };
        let at_frame = |what: String| format!("frame {} ({}): {what}", i + 1, frame.file_path);
        let bad =
            |what: String| ImportError::bad(path, at_frame(what), "correct or remove the frame");
        let camera_from_world = pose_of(&frame.transform_matrix, applied.as_ref()).map_err(bad)?;
        let lens = frame.lens.over(&file.lens);
        let is_stated = lens.w.or(lens.h).is_some();
        let size = match (lens.w, lens.h) {
            // The photo need not be asked.
            (Some(_), Some(_)) => (0, 0),
            _ => stored_size(&photo.photo)?,
        };
        let camera = lens.size(size).and_then(|size| camera(&lens, size));
        let camera = camera.map_err(bad)?;
        check_size(&camera, is_stated).map_err(|what| {
            let remedy = "state w and h as of the pictures that the cameras were made from, and cx and cy in these";
            ImportError::bad(path, at_frame(what), remedy)
        })?;
        if let (Some(stated), None) = (stated_mask, &mask) {
            gather.notes.push(format!("the mask {stated} is missing"));
        }
        masks.of_views.push(mask);
        gather.views.push(Found {
            photo,
            mask: None,
            camera,
            camera_from_world,
        });
    }
    masks.give(&mut gather);
    if path
        .file_name()
        .is_some_and(|name| name == "transforms_train.json")
    {
        gather.notes.push(
            "only the training views are read; name another file of the scene to take that"
                .to_owned(),
        );
    }
    gather.finish(detected.format, &detected.root, path)
}

/// Masks by their paths: of the views, and of frames that are none.
#[derive(Default)]
struct Masks {
    of_views: Vec<Option<Match>>,
    others: Vec<Match>,
}

impl Masks {
    /// To each view its own. Where a scene was moved, a path without its folders may lead to the mask of another frame;
    /// of several paths that fit a mask alike, as those of two folders do where it is in neither, none does.
    fn give(self, gather: &mut Gather) {
        let found: Vec<&Match> = self.of_views.iter().flatten().collect();
        let mut claims = other_claims(&found, &self.others).into_iter();
        let mut given = 0;
        for (view, mask) in gather.views.iter_mut().zip(self.of_views) {
            let Some(mask) = mask else { continue };
            let Some((_, rival)) = claims.next().flatten() else {
                view.mask = Some(mask.photo);
                given += 1;
                continue;
            };
            gather.notes.push(format!(
                "the mask {} is missing: {} may as well be {rival}",
                mask.stated,
                mask.photo.display()
            ));
        }
        if given > 0 {
            gather.notes.push(format!("mask_path gives {given} masks"));
        }
    }
}

/// A picture size, which some tools write as 800.0.
fn whole(size: f64) -> Result<u32, String> {
    if (1.0..=1_048_576.0).contains(&size) && size.fract() == 0.0 {
        Ok(size as u32)
    } else {
        Err(format!("a picture size of {size} is none"))
    }
}

/// Rotation and translation from three or four rows.
fn split(matrix: &[Vec<f64>]) -> Result<(DMat3, DVec3), String> {
    let row = |i: usize| match matrix.get(i).map(Vec::as_slice) {
        Some(&[a, b, c, d]) => Ok(([a, b, c], d)),
        _ => Err("a matrix must have 3 or 4 rows of 4 numbers".to_owned()),
    };
    if !(3..=4).contains(&matrix.len()) {
        row(3)?;
    }
    let ((r0, x), (r1, y), (r2, z)) = (row(0)?, row(1)?, row(2)?);
    Ok((pose::rows([r0, r1, r2]), DVec3::new(x, y, z)))
}

fn applied(file: &File, path: &Path) -> Result<Option<Applied>, ImportError> {
    let scale = file.applied_scale.unwrap_or(1.0);
    let matrix = match &file.applied_transform {
        None if scale == 1.0 => return Ok(None),
        None => Ok((DMat3::IDENTITY, DVec3::ZERO)),
        Some(matrix) => split(matrix),
    };
    let checked = matrix.and_then(|(matrix, shift)| {
        if scale.is_nan() || scale <= 0.0 || scale.is_infinite() || !shift.is_finite() {
            return Err("it is not finite".to_owned());
        }
        Ok(Applied {
            rotation: pose::rotation(matrix)?,
            shift,
            scale,
        })
    });
    checked.map(Some).map_err(|what| {
        ImportError::bad(
            path,
            format!("applied_transform or applied_scale: {what}"),
            "correct or remove it",
        )
    })
}

fn pose_of(matrix: &[Vec<f64>], applied: Option<&Applied>) -> Result<Pose, String> {
    let (axes, centre) = split(matrix)?;
    let mut axes = pose::from_opengl(axes);
    let mut centre = centre;
    if let Some(Applied {
        rotation,
        shift,
        scale,
    }) = applied
    {
        let back = rotation.transpose();
        axes = back * axes;
        centre = back * (centre / *scale - *shift);
    }
    pose::camera_from_world(axes, centre)
}

/// The camera of a frame for pictures of that size in pixels.
fn camera(lens: &Lens, (width, height): (u32, u32)) -> Result<Camera, String> {
    let model = lens
        .camera_model
        .as_deref()
        .unwrap_or(match lens.is_fisheye {
            Some(true) => "OPENCV_FISHEYE",
            _ => "OPENCV",
        });
    if model == "EQUIRECTANGULAR" {
        return Ok(LensFrame::panorama(width, height));
    }
    let size = DVec2::new(f64::from(width), f64::from(height));
    let from_angle = |pixels: f64, radians: f64| 0.5 * pixels / (0.5 * radians).tan();
    let axis = |stated: Option<f64>, radians: Option<f64>, degrees: Option<f64>, pixels: f64| {
        stated
            .or_else(|| radians.map(|angle| from_angle(pixels, angle)))
            .or_else(|| degrees.map(|angle| from_angle(pixels, angle.to_radians())))
    };
    let fx = axis(lens.fl_x, lens.camera_angle_x, lens.x_fov, size.x);
    // An angle across and no focal length down means square pixels.
    let fy = axis(lens.fl_y, lens.camera_angle_y, lens.y_fov, size.y);
    let (Some(fx), Some(fy)) = (fx.or(fy), fy.or(fx)) else {
        return Err("neither fl_x nor camera_angle_x is given".to_owned());
    };
    let frame = LensFrame {
        width,
        height,
        focal: DVec2::new(fx, fy),
        centre: DVec2::new(
            lens.cx.unwrap_or(0.5 * size.x),
            lens.cy.unwrap_or(0.5 * size.y),
        ),
    };
    let k = [lens.k1, lens.k2, lens.k3, lens.k4].map(Option::unwrap_or_default);
    let p = [lens.p1, lens.p2].map(Option::unwrap_or_default);
    match model {
        "PERSPECTIVE" | "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" => {
            frame.perspective(k, p)
        }
        "FISHEYE" | "OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => {
            frame.fisheye(k, p)
        }
        "FISHEYE624" => match lens
            .distortion_params
            .as_deref()
            .map(<&[f64; 12]>::try_from)
        {
            Some(Ok(params)) => frame.fisheye624(params),
            _ => Err("FISHEYE624 needs 12 distortion_params".to_owned()),
        },
        "OMNIDIRECTIONALSTEREO_L"
        | "OMNIDIRECTIONALSTEREO_R"
        | "VR180_L"
        | "VR180_R"
        | "ORTHOPHOTO" => Err(format!(
            "{model} cameras have no single centre of projection, so no COLMAP model says what they see"
        )),
        other => Err(format!(
            "the camera model {other:?} is unknown; known are {}, OPENCV, PINHOLE, SIMPLE_PINHOLE, OPENCV_FISHEYE, EQUIRECTANGULAR and FISHEYE624",
            CameraModel::Radial
        )),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_frames_focal_length_is_its_own_however_it_is_stated() {
        let focal = |frame: &str, file: &str| {
            let lens = |text| Lens::of(&serde_json::from_str(text).unwrap()).unwrap();
            let [frame, file] = [frame, file].map(lens);
            let camera = camera(&frame.over(&file), (200, 100)).unwrap();
            [camera.params[0].round(), camera.params[1].round()]
        };
        let file = r#"{"fl_x": 500, "fl_y": 400, "camera_angle_x": 0.4}"#;
        assert_eq!(focal("{}", file), [500.0, 400.0]);
        // 90 degrees over 200 pixels, over 100 pixels.
        assert_eq!(focal(r#"{"x_fov": 90}"#, file), [100.0, 400.0]);
        assert_eq!(focal(r#"{"y_fov": 90}"#, file), [500.0, 50.0]);
        let angle = r#"{"camera_angle_x": 1.5707963267948966}"#;
        assert_eq!(focal(angle, file), [100.0, 400.0]);
        assert_eq!(focal(r#"{"x_fov": 90}"#, angle), [100.0, 100.0]);
        assert_eq!(focal(r#"{"fl_x": 300}"#, angle), [300.0, 300.0]);
    }
}
