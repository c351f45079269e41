//! COLMAP's binary format: little endian, counts before lists, no padding.

use crate::camera::{Camera, LARGEST_SIDE};
use crate::camera_model::CameraModel;
use crate::error::{ColmapError, Place, Spot};
use crate::model::{Model, Observation, SparsePoint, Tracks, View};
use crate::model::{check_name, check_point, check_pose};
use glam::{DVec2, DVec3};
use std::path::Path;

/// COLMAP's mark for a measured position that belongs to no point.
const NO_POINT: u64 = u64::MAX;

/// Reads numbers off a byte slice and knows where it is.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    path: &'a Path,
}

impl<'a> Cursor<'a> {
    fn new(bytes: &'a [u8], path: &'a Path) -> Self {
        Cursor { bytes, at: 0, path }
    }

    fn spot(&self) -> Spot<'a> {
        Spot {
            path: self.path,
            place: Place::Byte(self.at as u64),
        }
    }

    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ColmapError> {
        match self.bytes[self.at..].first_chunk::<N>() {
            Some(chunk) => {
                self.at += N;
                Ok(*chunk)
            }
            None => Err(self.spot().bad(
                format!("the file ends within {what}"),
                "it was cut off; copy or export it again",
            )),
        }
    }

    fn u32(&mut self, what: &str) -> Result<u32, ColmapError> {
        Ok(u32::from_le_bytes(self.take(what)?))
    }

    fn u64(&mut self, what: &str) -> Result<u64, ColmapError> {
        Ok(u64::from_le_bytes(self.take(what)?))
    }

    fn f64(&mut self, what: &str) -> Result<f64, ColmapError> {
        Ok(f64::from_le_bytes(self.take(what)?))
    }

    /// A list length that the rest of the file can hold, each entry taking `entry` bytes or more.
    fn count(&mut self, what: &str, entry: usize) -> Result<usize, ColmapError> {
        let spot = self.spot();
        let count = self.u64(what)?;
        match usize::try_from(count) {
            Ok(n) if n.checked_mul(entry).is_some_and(|size| size <= self.left()) => Ok(n),
            _ => Err(spot.bad(
                format!(
                    "{what} says {count}, more than the {} bytes that follow can hold",
                    self.left()
                ),
                "the file is damaged or cut off; copy or export it again",
            )),
        }
    }

    fn name(&mut self) -> Result<&'a str, ColmapError> {
        let spot = self.spot();
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.iter().position(|&b| b == 0) else {
            return Err(spot.bad(
                "a photo name has no end",
                "the file is damaged or cut off; copy or export it again",
            ));
        };
        self.at += length + 1;
        std::str::from_utf8(&rest[..length]).map_err(|_| {
            spot.bad(
                format!(
                    "the photo name {:?} is not UTF-8",
                    String::from_utf8_lossy(&rest[..length])
                ),
                "rename the photo and register it again",
            )
        })
    }

    fn end(&self, of: &str) -> Result<(), ColmapError> {
        if self.left() == 0 {
            return Ok(());
        }
        Err(self.spot().bad(
            format!("{} bytes follow the last {of}", self.left()),
            "the file is damaged or not of COLMAP's format; export it again",
        ))
    }
}

pub(crate) fn read_cameras(bytes: &[u8], path: &Path) -> Result<Vec<Camera>, ColmapError> {
    let mut c = Cursor::new(bytes, path);
    let n = c.count("the number of cameras", 24 + 16)?;
    let mut cameras = Vec::with_capacity(n);
    for _ in 0..n {
        let spot = c.spot();
        let id = c.u32("a camera")?;
        let number = c.u32("a camera")?.cast_signed();
        let Some(model) = CameraModel::from_id(number) else {
            return Err(spot.bad(
                format!("camera {id} has the unknown model number {number}"),
                "known are 0 to 17; undistort the photos with COLMAP's image_undistorter first",
            ));
        };
        let (width, height) = (c.u64("a camera")?, c.u64("a camera")?);
        let params = (0..model.param_count())
            .map(|_| c.f64("a camera"))
            .collect::<Result<Vec<_>, _>>()?;
        cameras.push(checked_camera(id, model, (width, height), params, spot)?);
    }
    c.end("camera")?;
    Ok(cameras)
}

/// Shared with the text format.
pub(crate) fn checked_camera(
    id: u32,
    model: CameraModel,
    (width, height): (u64, u64),
    params: Vec<f64>,
    spot: Spot<'_>,
) -> Result<Camera, ColmapError> {
    let remedy = "correct the camera or export the model again";
    if width.max(height) > u64::from(LARGEST_SIDE) {
        return Err(spot.bad(format!("camera {id} has the size {width}x{height}"), remedy));
    }
    let camera = Camera {
        id,
        model,
        width: width as u32,
        height: height as u32,
        params,
    };
    match camera.complaint() {
        Some(what) => Err(spot.bad(what, remedy)),
        None => Ok(camera),
    }
}

pub(crate) fn read_images(
    bytes: &[u8],
    path: &Path,
    sink: &mut dyn FnMut(Observation),
) -> Result<Vec<View>, ColmapError> {
    let mut c = Cursor::new(bytes, path);
    let n = c.count("the number of photos", 4 + 56 + 4 + 1 + 8)?;
    let mut views = Vec::with_capacity(n);
    for _ in 0..n {
        let spot = c.spot();
        let id = c.u32("a photo's entry")?;
        let mut v = [0.0; 7];
        for value in &mut v {
            *value = c.f64("a photo's pose")?;
        }
        let camera_id = c.u32("a photo's entry")?;
        let name = c.name()?;
        check_name(name, spot)?;
        let camera_from_world = check_pose(v, name, spot)?;
        for _ in 0..c.count("a photo's number of measured positions", 24)? {
            let (x, y) = (c.f64("a position")?, c.f64("a position")?);
            let point_id = c.u64("a position")?;
            if point_id != NO_POINT {
                sink(Observation {
                    view_id: id,
                    point_id,
                    pixel: DVec2::new(x, y),
                });
            }
        }
        views.push(View {
            id,
            name: name.to_owned(),
            camera_id,
            camera_from_world,
        });
    }
    c.end("photo")?;
    Ok(views)
}

pub(crate) fn read_points(bytes: &[u8], path: &Path) -> Result<Vec<SparsePoint>, ColmapError> {
    let mut c = Cursor::new(bytes, path);
    let n = c.count("the number of points", 8 + 24 + 3 + 8 + 8)?;
    let mut points = Vec::with_capacity(n);
    for _ in 0..n {
        let spot = c.spot();
        let id = c.u64("a point")?;
        let position = DVec3::new(c.f64("a point")?, c.f64("a point")?, c.f64("a point")?);
        let colour = c.take("a point")?;
        let error = c.f64("a point")?;
        let length = c.count("a point's number of views", 8)?;
        let mut views = Vec::with_capacity(length);
        for _ in 0..length {
            views.push(c.u32("a point's track")?);
            c.u32("a point's track")?;
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
    c.end("point")?;
    Ok(points)
}

pub(crate) fn cameras(model: &Model) -> Vec<u8> {
    let mut out = (model.cameras.len() as u64).to_le_bytes().to_vec();
    for camera in model.cameras.values() {
        out.extend(camera.id.to_le_bytes());
        out.extend(camera.model.id().to_le_bytes());
        out.extend(u64::from(camera.width).to_le_bytes());
        out.extend(u64::from(camera.height).to_le_bytes());
        out.extend(camera.params.iter().flat_map(|p| p.to_le_bytes()));
    }
    out
}

pub(crate) fn images(model: &Model, tracks: &Tracks) -> Vec<u8> {
    let mut out = (model.views.len() as u64).to_le_bytes().to_vec();
    for (view, observed) in model.views.iter().zip(&tracks.observed) {
        let (q, t) = (
            view.camera_from_world.rotation,
            view.camera_from_world.translation,
        );
        out.extend(view.id.to_le_bytes());
        out.extend(
            [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        );
        out.extend(view.camera_id.to_le_bytes());
        out.extend(view.name.as_bytes());
        out.push(0);
        out.extend((observed.len() as u64).to_le_bytes());
        for (pixel, point_id) in observed {
            out.extend(pixel.x.to_le_bytes());
            out.extend(pixel.y.to_le_bytes());
            out.extend(point_id.to_le_bytes());
        }
    }
    out
}

pub(crate) fn points(model: &Model, tracks: &Tracks) -> Vec<u8> {
    let mut out = (model.points.len() as u64).to_le_bytes().to_vec();
    for (point, track) in model.points.iter().zip(&tracks.of_point) {
        out.extend(point.id.to_le_bytes());
        out.extend(
            point
                .position
                .to_array()
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        );
        out.extend(point.colour);
        out.extend(point.error.to_le_bytes());
        out.extend((track.len() as u64).to_le_bytes());
        for (view, index) in track {
            out.extend(view.to_le_bytes());
            out.extend(index.to_le_bytes());
        }
    }
    out
}
