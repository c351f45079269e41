//! RealityCapture's (RealityScan's) "Internal/External camera parameters" CSV.
//!
//! `x, y, alt` is the camera's centre. `heading, pitch, roll` are degrees: a camera without any
//! looks straight down with north at the top of its picture; it is turned about y by the roll, then
//! about x by the pitch, then about z, clockwise, by the heading. `f` is in millimetres of a 36 mm
//! wide picture, `px, py` are the principal point from the middle in units of the longer side.

use crate::error::{ImportError, load_text};
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::Frame;
use crate::photos::{ByName, stored_size};
use crate::pose;
use glam::{DMat3, DVec2, DVec3};
use io_colmap::{Camera, Pose};
use std::collections::HashMap;
use std::path::Path;

/// Columns without which a row is no camera.
const REQUIRED: [&str; 8] = ["name", "x", "y", "alt", "heading", "pitch", "roll", "f"];

/// Column names in small letters, without the `#` that the first one has.
fn columns<'a>(header: impl Iterator<Item = &'a str>) -> HashMap<String, usize> {
    header
        .enumerate()
        .map(|(i, name)| (name.trim().trim_start_matches('#').to_lowercase(), i))
        .collect()
}

fn is_complete(columns: &HashMap<String, usize>) -> bool {
    REQUIRED.iter().all(|name| columns.contains_key(*name))
}

/// Whether a line is this format's list of columns.
pub(crate) fn is_header(line: &str) -> bool {
    is_complete(&columns(line.trim_start_matches('\u{feff}').split(',')))
}

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let path = &detected.source;
    let text = load_text(path)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let photos = ByName::below(&detected.root, images)?;
    let mut gather = Gather::default();
    gather.leave_out(photos.left_out());
    let mut header: Option<HashMap<String, usize>> = None;
    for record in reader.records() {
        let record = record.map_err(|e| {
            let line = e.position().map_or(0, csv::Position::line) as usize;
            ImportError::line(
                path,
                line,
                format!("the line cannot be read ({e})"),
                "export it again",
            )
        })?;
        let line = record.position().map_or(0, csv::Position::line) as usize;
        let Some(header) = &header else {
            // A count of cameras may come before the columns.
            let found = columns(record.iter());
            header = is_complete(&found).then_some(found);
            continue;
        };
        let bad = |what: String| ImportError::line(path, line, what, "correct or remove the line");
        let text = |name: &str| header.get(name).and_then(|&i| record.get(i));
        let name = text("name").unwrap_or_default();
        let photo = match photos.find(name) {
            Ok(photo) => photo,
            Err(why) => {
                gather.drop_view(name, why);
                continue;
            }
        };
        let value = |name: &str| match text(name) {
            // Distortion and principal point may be left out of the export.
            None | Some("") if !REQUIRED.contains(&name) => Ok(0.0),
            word => word
                .and_then(|word| word.parse().ok())
                .filter(|v: &f64| v.is_finite())
                .ok_or_else(|| bad(format!("{name} is no finite number"))),
        };
        let centre = DVec3::new(value("x")?, value("y")?, value("alt")?);
        let angles = [value("heading")?, value("pitch")?, value("roll")?];
        let k = [value("k1")?, value("k2")?, value("k3")?, value("k4")?];
        // OpenCV's p1 and p2 are these the other way round: the program's own export for OpenCV writes t2 before t1.
        let p = [value("t2")?, value("t1")?];
        let inner = [value("f")?, value("px")?, value("py")?];
        gather.views.push(Found {
            mask: None,
            camera: camera(stored_size(&photo.photo)?, inner, k, p).map_err(bad)?,
            photo,
            camera_from_world: pose_of(centre, angles).map_err(bad)?,
        });
    }
    gather.finish(detected.format, &detected.root, path)
}

fn camera(
    (width, height): (u32, u32),
    [f, px, py]: [f64; 3],
    k: [f64; 4],
    p: [f64; 2],
) -> Result<Camera, String> {
    let longer = f64::from(width.max(height));
    let mut frame = Frame::centred(width, height, f * longer / 36.0);
    frame.centre += DVec2::new(px, py) * longer;
    frame.perspective(k, p)
}

fn pose_of(centre: DVec3, [heading, pitch, roll]: [f64; 3]) -> Result<Pose, String> {
    let axes = DMat3::from_rotation_z(-heading.to_radians())
        * DMat3::from_rotation_x(pitch.to_radians())
        * DMat3::from_rotation_y(roll.to_radians());
    pose::camera_from_world(pose::from_opengl(axes), centre)
}
