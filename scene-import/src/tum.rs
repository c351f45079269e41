//! The TUM RGB-D benchmark's sequences: `rgb.txt` (time, photo) and `groundtruth.txt` (time,
//! position, quaternion), measured by different clocks at different rates.
//!
//! Poses take camera space (x right, y down, z forward) to the world. Intrinsics are not in the
//! folder: they are the benchmark's, by the camera's number in the folder's name.

use crate::error::{ImportError, load_text};
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::Frame;
use crate::photos::{Lookup, stored_size};
use crate::pose;
use glam::{DMat3, DQuat, DVec2, DVec3};
use io_colmap::{Camera, Pose, same_shape};
use std::path::Path;

/// A photo is between poses no farther apart than this, in seconds: the motion capture loses sight
/// of the camera now and then.
const LONGEST_GAP: f64 = 0.1;
/// At the ends of the recording, a photo takes the nearest pose within this many seconds, as the
/// benchmark's own tool does.
const NEAREST: f64 = 0.02;

/// Published calibrations of the colour cameras for 640x480: `fx, fy, cx, cy`, `k1, k2, p1, p2, k3`.
/// The first pixel's centre is at (0, 0), as OpenCV has it.
const CALIBRATED: [(&str, &str, [f64; 4], [f64; 5]); 3] = [
    (
        "freiburg1",
        "fr1",
        [517.306408, 516.469215, 318.643040, 255.313989],
        [0.262383, -0.953104, -0.005358, 0.002628, 1.163314],
    ),
    (
        "freiburg2",
        "fr2",
        [520.908620, 521.007327, 325.141442, 249.701764],
        [0.231222, -0.784899, -0.003257, -0.000105, 0.917205],
    ),
    // Its photos are undistorted already.
    ("freiburg3", "fr3", [535.4, 539.2, 320.1, 247.6], [0.0; 5]),
];
/// What ROS takes for such a camera unless told.
const USUAL: [f64; 4] = [525.0, 525.0, 319.5, 239.5];

/// A pose at a time, `world_from_camera`.
struct Sample {
    time: f64,
    centre: DVec3,
    rotation: DQuat,
}

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let root = &detected.root;
    let path = &detected.source;
    let samples = trajectory(path)?;
    let mut gather = Gather::default();
    let (camera, is_guess) = camera(root, &mut gather.notes)?;
    let photos = Lookup::new(root, images)?;
    gather.leave_out(photos.left_out());
    let list = root.join("rgb.txt");
    for (line, time, rest) in timed_lines(&list)? {
        let [name] = rest.as_slice() else {
            return Err(ImportError::line(
                &list,
                line,
                "a line must be a time and a photo",
                "correct or remove the line",
            ));
        };
        let photo = match photos.find(name) {
            Ok(photo) => photo,
            Err(why) => {
                gather.drop_view(name, why);
                continue;
            }
        };
        let Some(camera_from_world) = pose_at(&samples, time) else {
            gather.drop_view(name, "has no pose near its time");
            gather.rivals.push(photo);
            continue;
        };
        let camera_from_world = camera_from_world
            .map_err(|what| ImportError::line(&list, line, what, "remove the line"))?;
        let (width, height) = stored_size(&photo.photo)?;
        if is_guess && !same_shape((width, height), (camera.width, camera.height)) {
            return Err(ImportError::bad(
                &photo.photo,
                format!(
                    "the photo is {width}x{height}, and intrinsics are not known: they are in none of the folder's files, \
                     and what is guessed is for {}x{}",
                    camera.width, camera.height
                ),
                "write photos and poses as transforms.json, which states fl_x, fl_y, cx, cy, w and h, or as a COLMAP model",
            ));
        }
        gather.views.push(Found {
            photo,
            mask: None,
            camera: camera.clone(),
            camera_from_world,
        });
    }
    gather.finish(detected.format, root, path)
}

/// Lines that are no comments: number, time, the other words.
fn timed_lines(path: &Path) -> Result<Vec<(usize, f64, Vec<String>)>, ImportError> {
    let text = load_text(path)?;
    let mut lines = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = line.split_whitespace();
        let time: f64 = words
            .next()
            .and_then(|word| word.parse().ok())
            .filter(|time: &f64| time.is_finite())
            .ok_or_else(|| {
                ImportError::line(
                    path,
                    i + 1,
                    "the line does not begin with a time",
                    "correct or remove the line",
                )
            })?;
        lines.push((i + 1, time, words.map(str::to_owned).collect()));
    }
    Ok(lines)
}

fn trajectory(path: &Path) -> Result<Vec<Sample>, ImportError> {
    let mut samples = Vec::new();
    for (line, time, words) in timed_lines(path)? {
        let bad = |what: &str| ImportError::line(path, line, what, "correct or remove the line");
        let values: Vec<f64> = words
            .iter()
            .map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()))
            .collect::<Option<_>>()
            .ok_or_else(|| bad("a value is no finite number"))?;
        let &[x, y, z, qx, qy, qz, qw] = values.as_slice() else {
            return Err(bad("a pose must be a time, tx ty tz and qx qy qz qw"));
        };
        let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
        if (rotation.length() - 1.0).abs() > 0.01 {
            return Err(bad("the quaternion is not of unit length"));
        }
        samples.push(Sample {
            time,
            centre: DVec3::new(x, y, z),
            rotation: rotation.normalize(),
        });
    }
    samples.sort_by(|a, b| a.time.total_cmp(&b.time));
    Ok(samples)
}

/// Between the poses before and after, in proportion to time. The poses are an order of magnitude
/// denser than the photos.
fn pose_at(samples: &[Sample], time: f64) -> Option<Result<Pose, String>> {
    let after = samples.partition_point(|sample| sample.time < time);
    let (a, b) = (
        after.checked_sub(1).map(|i| &samples[i]),
        samples.get(after),
    );
    let (centre, rotation) = match (a, b) {
        (Some(a), Some(b)) if b.time - a.time <= LONGEST_GAP => {
            let t = (time - a.time) / (b.time - a.time);
            (a.centre.lerp(b.centre, t), a.rotation.slerp(b.rotation, t))
        }
        _ => {
            let nearest = [a, b]
                .into_iter()
                .flatten()
                .min_by(|p, q| (p.time - time).abs().total_cmp(&(q.time - time).abs()))
                .filter(|sample| (sample.time - time).abs() <= NEAREST)?;
            (nearest.centre, nearest.rotation)
        }
    };
    Some(pose::camera_from_world(DMat3::from_quat(rotation), centre))
}

/// The camera, and whether it is a guess.
fn camera(root: &Path, notes: &mut Vec<String>) -> Result<(Camera, bool), ImportError> {
    let full = root.canonicalize().unwrap_or_else(|_| root.to_path_buf());
    let name = full
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let known = CALIBRATED
        .iter()
        .find(|(long, short, ..)| name.contains(long) || name.contains(short));
    let (values, distortion) = match known {
        Some((long, _, values, distortion)) => {
            notes.push(format!(
                "intrinsics are the benchmark's for {long}, from the folder's name"
            ));
            (*values, *distortion)
        }
        None => {
            notes.push(format!(
                "the folder's name ({name}) tells no freiburg1, 2 or 3, so intrinsics are guessed (focal length {})",
                USUAL[0]
            ));
            (USUAL, [0.0; 5])
        }
    };
    let [fx, fy, cx, cy] = values;
    let [k1, k2, p1, p2, k3] = distortion;
    let frame = Frame {
        width: 640,
        height: 480,
        focal: DVec2::new(fx, fy),
        centre: DVec2::new(cx + 0.5, cy + 0.5),
    };
    frame
        .perspective([k1, k2, k3, 0.0], [p1, p2])
        .map(|camera| (camera, known.is_none()))
        .map_err(|what| ImportError::bad(root, what, "this is a fault of the program"))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn poses_are_interpolated_but_not_across_gaps() {
        let sample = |time: f64, angle: f64| Sample {
            time,
            centre: DVec3::X * time,
            rotation: DQuat::from_rotation_y(angle),
        };
        let samples = [sample(1.0, 0.0), sample(1.05, 0.5), sample(3.0, 0.5)];
        let at = |time: f64| pose_at(&samples, time).map(|pose| pose.unwrap().inverse());
        let between = at(1.01).unwrap();
        assert!((between.translation.x - 1.01).abs() < 1e-9);
        assert!((between.rotation.angle_between(DQuat::from_rotation_y(0.1))) < 1e-6);
        assert!((at(1.06).unwrap().translation.x - 1.05).abs() < 1e-9);
        assert!((at(2.985).unwrap().translation.x - 3.0).abs() < 1e-9);
        assert!(at(2.0).is_none() && at(0.9).is_none() && at(3.1).is_none());
        assert!((at(1.0).unwrap().translation.x - 1.0).abs() < 1e-9);
    }
}
