//! COLMAP's text format: blank-separated values, `#` comments, two lines for every photo.

use crate::binary::checked_camera;
use crate::camera::Camera;
use crate::camera_model::CameraModel;
use crate::error::{ColmapError, Place, Spot};
use crate::model::{Model, Observation, SparsePoint, Tracks, View};
use crate::model::{check_name, check_point, check_pose};
use glam::{DVec2, DVec3};
use std::fmt::Write as _;
use std::path::Path;
use std::str::FromStr;

/// Numbered lines of a file that must be UTF-8.
fn lines<'a>(
    bytes: &'a [u8],
    path: &'a Path,
) -> Result<impl Iterator<Item = (Spot<'a>, &'a str)>, ColmapError> {
    let spot = move |line| Spot {
        path,
        place: Place::Line(line),
    };
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let line = 1 + bytes[..e.valid_up_to()]
            .iter()
            .filter(|&&b| b == b'\n')
            .count();
        spot(line).bad(
            "this is not UTF-8 text",
            "rename the photo, or export the model again",
        )
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    Ok(text
        .lines()
        .enumerate()
        .map(move |(i, line)| (spot(i + 1), line.trim())))
}

fn is_data(line: &str) -> bool {
    !line.is_empty() && !line.starts_with('#')
}

/// Takes the next blank-separated value off a line.
fn next<'a>(line: &mut &'a str) -> Option<&'a str> {
    let trimmed = line.trim_start();
    if trimmed.is_empty() {
        return None;
    }
    let end = trimmed.find(char::is_whitespace).unwrap_or(trimmed.len());
    let (value, rest) = trimmed.split_at(end);
    *line = rest;
    Some(value)
}

/// Takes the next value as a number.
fn number<T: FromStr>(line: &mut &str, what: &str, spot: Spot<'_>) -> Result<T, ColmapError> {
    let Some(value) = next(line) else {
        return Err(spot.bad(
            format!("the line ends before the {what}"),
            "the file was cut off or edited; export the model again",
        ));
    };
    value.parse().map_err(|_| {
        spot.bad(
            format!("{value:?} is no valid {what}"),
            "correct the line or export the model again",
        )
    })
}

pub(crate) fn read_cameras(bytes: &[u8], path: &Path) -> Result<Vec<Camera>, ColmapError> {
    let mut cameras = Vec::new();
    for (spot, mut line) in lines(bytes, path)?.filter(|(_, line)| is_data(line)) {
        let line = &mut line;
        let id = number(line, "camera id", spot)?;
        let name = next(line).unwrap_or_default();
        let Some(model) = CameraModel::from_name(name) else {
            return Err(spot.bad(
                format!("camera {id} has the unknown model {name:?}"),
                "undistort the photos with COLMAP's image_undistorter first",
            ));
        };
        let size = (
            number(line, "image width", spot)?,
            number(line, "image height", spot)?,
        );
        let mut params = Vec::with_capacity(model.param_count());
        while !line.trim().is_empty() {
            params.push(number(line, "camera parameter", spot)?);
        }
        cameras.push(checked_camera(id, model, size, params, spot)?);
    }
    Ok(cameras)
}

pub(crate) fn read_images(
    bytes: &[u8],
    path: &Path,
    sink: &mut dyn FnMut(Observation),
) -> Result<Vec<View>, ColmapError> {
    let mut views = Vec::new();
    let mut lines = lines(bytes, path)?;
    while let Some((spot, mut line)) = lines.next() {
        if !is_data(line) {
            continue;
        }
        let line = &mut line;
        let id = number(line, "photo id", spot)?;
        let mut v = [0.0; 7];
        for value in &mut v {
            *value = number(line, "pose value", spot)?;
        }
        let camera_id = number(line, "camera id", spot)?;
        // The name is the rest of the line, so that it may contain blanks.
        let name = line.trim();
        check_name(name, spot)?;
        let camera_from_world = check_pose(v, name, spot)?;
        // The second line may be empty, and missing at the end of the file.
        if let Some((spot, mut positions)) = lines.next() {
            read_positions(&mut positions, id, spot, sink)?;
        }
        views.push(View {
            id,
            name: name.to_owned(),
            camera_id,
            camera_from_world,
        });
    }
    Ok(views)
}

fn read_positions(
    line: &mut &str,
    view_id: u32,
    spot: Spot<'_>,
    sink: &mut dyn FnMut(Observation),
) -> Result<(), ColmapError> {
    let explain = |_| {
        spot.bad(
            "this line should list measured positions as X Y POINT3D_ID",
            "every photo takes two lines, of which the second may be empty but not left out",
        )
    };
    while !line.trim().is_empty() {
        let x = number(line, "position", spot).map_err(explain)?;
        let y = number(line, "position", spot).map_err(explain)?;
        // -1 marks a position that belongs to no point.
        let point: i128 = number(line, "point id", spot).map_err(explain)?;
        if let Ok(point_id) = u64::try_from(point)
            && point_id != u64::MAX
        {
            sink(Observation {
                view_id,
                point_id,
                pixel: DVec2::new(x, y),
            });
        }
    }
    Ok(())
}

pub(crate) fn read_points(bytes: &[u8], path: &Path) -> Result<Vec<SparsePoint>, ColmapError> {
    let mut points = Vec::new();
    for (spot, mut line) in lines(bytes, path)?.filter(|(_, line)| is_data(line)) {
        let line = &mut line;
        let id = number(line, "point id", spot)?;
        let mut position = DVec3::ZERO;
        for i in 0..3 {
            position[i] = number(line, "coordinate", spot)?;
        }
        let mut colour = [0; 3];
        for channel in &mut colour {
            *channel = number(line, "colour (0 to 255)", spot)?;
        }
        let error = number(line, "reprojection error", spot)?;
        let mut views = Vec::new();
        while !line.trim().is_empty() {
            views.push(number(line, "photo id", spot)?);
            let _index: u32 = number(line, "position index", spot)?;
        }
        points.push(check_point(
            SparsePoint {
                id,
                position,
                colour,
                error,
                views,
            },
            spot,
        )?);
    }
    Ok(points)
}

// Rust prints the shortest decimal that reads back as the same f64, so text is as exact as binary.
// Writing to a String cannot fail.

pub(crate) fn cameras(model: &Model) -> String {
    let mut out = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    for camera in model.cameras.values() {
        let _ = write!(
            out,
            "{} {} {} {}",
            camera.id, camera.model, camera.width, camera.height
        );
        for p in &camera.params {
            let _ = write!(out, " {p}");
        }
        out.push('\n');
    }
    out
}

pub(crate) fn images(model: &Model, tracks: &Tracks) -> String {
    let mut out = String::from(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    for (view, observed) in model.views.iter().zip(&tracks.observed) {
        let (q, t) = (
            view.camera_from_world.rotation,
            view.camera_from_world.translation,
        );
        let _ = writeln!(
            out,
            "{} {} {} {} {} {} {} {} {} {}",
            view.id, q.w, q.x, q.y, q.z, t.x, t.y, t.z, view.camera_id, view.name
        );
        let positions: Vec<String> = observed
            .iter()
            .map(|(p, id)| format!("{} {} {id}", p.x, p.y))
            .collect();
        out.push_str(&positions.join(" "));
        out.push('\n');
    }
    out
}

pub(crate) fn points(model: &Model, tracks: &Tracks) -> String {
    let mut out =
        String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
    for (point, track) in model.points.iter().zip(&tracks.of_point) {
        let (p, [r, g, b]) = (point.position, point.colour);
        let _ = write!(
            out,
            "{} {} {} {} {r} {g} {b} {}",
            point.id, p.x, p.y, p.z, point.error
        );
        for (view, index) in track {
            let _ = write!(out, " {view} {index}");
        }
        out.push('\n');
    }
    out
}
