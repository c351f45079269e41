//! The sparse model: cameras, posed views and points, whatever format it came in.

use crate::camera::Camera;
use crate::error::{ColmapError, Place, Spot};
use crate::pose::Pose;
use crate::{binary, text};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

/// One registered photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// COLMAP's image number; the tracks of [`SparsePoint`] refer to it.
    pub id: u32,
    /// The photo's path below the image folder, with `/` between folders.
    pub name: String,
    /// Key into [`Model::cameras`].
    pub camera_id: u32,
    /// Takes world points into this view's camera space.
    pub camera_from_world: Pose,
}

/// One point of the sparse cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SparsePoint {
    /// COLMAP's point number.
    pub id: u64,
    /// In world space.
    pub position: DVec3,
    /// Red, green, blue, as in the photos (sRGB).
    pub colour: [u8; 3],
    /// Mean reprojection error in pixels; -1 where it was never computed.
    pub error: f64,
    /// Ids of the views that see it, ascending, each once.
    pub views: Vec<u32>,
}

/// A sparse reconstruction. Its world scale is arbitrary.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Model {
    /// By camera id.
    pub cameras: BTreeMap<u32, Camera>,
    /// Sorted by name.
    pub views: Vec<View>,
    /// In file order. May be empty.
    pub points: Vec<SparsePoint>,
}

/// One measured position of a sparse point in a photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// [`View::id`].
    pub view_id: u32,
    /// [`SparsePoint::id`].
    pub point_id: u64,
    /// In pixels of the camera's stated size.
    pub pixel: DVec2,
}

/// What to do about what is listed twice.
const AGAIN: &str = "a model must list each once; export it again";

/// The two ways COLMAP stores a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    Binary,
    Text,
}

impl Format {
    /// What `dir` holds; binary wins, being exact and what COLMAP writes itself.
    pub(crate) fn of(dir: &Path) -> Option<Format> {
        let both = |a: &str, b: &str| dir.join(a).is_file() && dir.join(b).is_file();
        if both("cameras.bin", "images.bin") {
            Some(Format::Binary)
        } else if both("cameras.txt", "images.txt") {
            Some(Format::Text)
        } else {
            None
        }
    }
}

impl Model {
    /// Reads the model in a folder, binary if there, else text.
    ///
    /// A missing points file gives a model without points; `rigs` and `frames` files (COLMAP 4)
    /// hold nothing that the image poses do not, and are not read.
    ///
    /// # Errors
    /// [`ColmapError::Format`] names file, place and remedy for anything malformed,
    /// [`ColmapError::Io`] for what cannot be opened.
    pub fn read(dir: &Path) -> Result<Model, ColmapError> {
        read(dir, &mut |_| {})
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt`, creating the folder.
    ///
    /// A model does not keep where in the photo a point was measured: the position written is its
    /// projection. A view that cannot see the point at all is left out of its track. COLMAP's own
    /// text reader ends a photo's name at the first blank; for such names use
    /// [`Model::write_binary`].
    ///
    /// # Errors
    /// [`ColmapError::Io`], and [`ColmapError::Format`] for a model that could not be read back, also because a binary one lies
    /// in the folder.
    pub fn write_text(&self, dir: &Path) -> Result<(), ColmapError> {
        if Format::of(dir) == Some(Format::Binary) {
            let path = dir.join("cameras.bin");
            let spot = Spot {
                path: &path,
                place: Place::File,
            };
            return Err(spot.bad(
                "a binary model is there, which would be read instead of one in text",
                "write to another folder, or remove it",
            ));
        }
        let tracks = self.tracks_for_writing(dir)?;
        write(
            dir,
            &[
                ("cameras.txt", text::cameras(self).into_bytes()),
                ("images.txt", text::images(self, &tracks).into_bytes()),
                ("points3D.txt", text::points(self, &tracks).into_bytes()),
            ],
        )
    }

    /// Writes `cameras.bin`, `images.bin` and `points3D.bin`; otherwise as [`Model::write_text`].
    ///
    /// # Errors
    /// As [`Model::write_text`].
    pub fn write_binary(&self, dir: &Path) -> Result<(), ColmapError> {
        let tracks = self.tracks_for_writing(dir)?;
        write(
            dir,
            &[
                ("cameras.bin", binary::cameras(self)),
                ("images.bin", binary::images(self, &tracks)),
                ("points3D.bin", binary::points(self, &tracks)),
            ],
        )
    }

    fn tracks_for_writing(&self, dir: &Path) -> Result<Tracks, ColmapError> {
        self.check(&dir.join("images"))?;
        self.check_numbers(dir)?;
        let index: BTreeMap<u32, usize> = self
            .views
            .iter()
            .enumerate()
            .map(|(i, view)| (view.id, i))
            .collect();
        let mut tracks = Tracks {
            observed: vec![Vec::new(); self.views.len()],
            of_point: Vec::with_capacity(self.points.len()),
        };
        for point in &self.points {
            let mut track = Vec::with_capacity(point.views.len());
            for id in &point.views {
                let Some(&i) = index.get(id) else { continue };
                let view = &self.views[i];
                let pixel = self.cameras.get(&view.camera_id).and_then(|c| {
                    c.project(view.camera_from_world.transform_point(point.position))
                });
                if let (Some(pixel), Ok(n)) = (pixel, u32::try_from(tracks.observed[i].len())) {
                    track.push((*id, n));
                    tracks.observed[i].push((pixel, point.id));
                }
            }
            tracks.of_point.push(track);
        }
        Ok(tracks)
    }

    /// What else holds of a model that was read: numbers that are some, points of one id each, cameras by their own.
    fn check_numbers(&self, dir: &Path) -> Result<(), ColmapError> {
        let path = dir.join("points3D");
        let spot = Spot {
            path: &path,
            place: Place::File,
        };
        let mut ids = HashSet::with_capacity(self.points.len());
        for point in &self.points {
            check_point(point.clone(), spot)?;
            if !ids.insert(point.id) {
                return Err(spot.bad(format!("two points have the id {}", point.id), AGAIN));
            }
        }
        let path = dir.join("images");
        let spot = Spot {
            path: &path,
            place: Place::File,
        };
        for view in &self.views {
            let Pose {
                rotation: q,
                translation: t,
            } = view.camera_from_world;
            check_pose([q.w, q.x, q.y, q.z, t.x, t.y, t.z], &view.name, spot)?;
        }
        let path = dir.join("cameras");
        let spot = Spot {
            path: &path,
            place: Place::File,
        };
        match self.cameras.iter().find(|(id, camera)| **id != camera.id) {
            Some((id, camera)) => Err(spot.bad(
                format!("camera {} is listed as {id}", camera.id),
                "list each camera by its own id",
            )),
            None => Ok(()),
        }
    }

    /// What must hold between the parts of a model: unique ids and names, known cameras.
    fn check(&self, path: &Path) -> Result<(), ColmapError> {
        let spot = Spot {
            path,
            place: Place::File,
        };
        if let Some(what) = self.cameras.values().find_map(Camera::complaint) {
            return Err(spot.bad(what, "correct the camera"));
        }
        let (mut ids, mut names) = (HashSet::new(), HashSet::new());
        for view in &self.views {
            check_name(&view.name, spot)?;
            if !ids.insert(view.id) {
                return Err(spot.bad(format!("two photos have the id {}", view.id), AGAIN));
            }
            if !names.insert(view.name.as_str()) {
                return Err(spot.bad(format!("two photos are named {:?}", view.name), AGAIN));
            }
            if !self.cameras.contains_key(&view.camera_id) {
                return Err(spot.bad(
                    format!(
                        "photo {:?} uses camera {}, which is not listed",
                        view.name, view.camera_id
                    ),
                    "cameras and images come from different exports; export both together",
                ));
            }
        }
        Ok(())
    }
}

/// Reads the 2D positions at which the model in `dir` observed its points, in file order.
///
/// # Errors
/// As [`Model::read`].
pub fn read_observations(dir: &Path) -> Result<Vec<Observation>, ColmapError> {
    let mut all = Vec::new();
    read(dir, &mut |observation| all.push(observation))?;
    Ok(all)
}

/// Where each view saw points, and for each point its `(view id, index into that list)`.
pub(crate) struct Tracks {
    pub(crate) observed: Vec<Vec<(DVec2, u64)>>,
    pub(crate) of_point: Vec<Vec<(u32, u32)>>,
}

fn read(dir: &Path, sink: &mut dyn FnMut(Observation)) -> Result<Model, ColmapError> {
    let Some(format) = Format::of(dir) else {
        return Err(ColmapError::scene(
            dir,
            "the folder holds no COLMAP model",
            "it needs cameras.bin and images.bin, or cameras.txt and images.txt",
        ));
    };
    let ending = if format == Format::Binary {
        "bin"
    } else {
        "txt"
    };
    let file = |stem: &str| dir.join(format!("{stem}.{ending}"));
    let (cameras_path, images_path, points_path) =
        (file("cameras"), file("images"), file("points3D"));
    let cameras_bytes = load(&cameras_path)?;
    let images_bytes = load(&images_path)?;
    let points_bytes = if points_path.exists() {
        Some(load(&points_path)?)
    } else {
        None
    };

    let (cameras, mut views, mut points);
    match format {
        Format::Binary => {
            cameras = binary::read_cameras(&cameras_bytes, &cameras_path)?;
            views = binary::read_images(&images_bytes, &images_path, sink)?;
            points = match &points_bytes {
                Some(bytes) => binary::read_points(bytes, &points_path)?,
                None => Vec::new(),
            };
        }
        Format::Text => {
            cameras = text::read_cameras(&cameras_bytes, &cameras_path)?;
            views = text::read_images(&images_bytes, &images_path, sink)?;
            points = match &points_bytes {
                Some(bytes) => text::read_points(bytes, &points_path)?,
                None => Vec::new(),
            };
        }
    }
    let spot = Spot {
        path: &cameras_path,
        place: Place::File,
    };
    let mut by_id = BTreeMap::new();
    for camera in cameras {
        if let Some(twin) = by_id.insert(camera.id, camera) {
            return Err(spot.bad(format!("two cameras have the id {}", twin.id), AGAIN));
        }
    }
    views.sort_by(|a, b| a.name.cmp(&b.name));
    let known: HashSet<u32> = views.iter().map(|view| view.id).collect();
    let mut seen = HashSet::with_capacity(points.len());
    for point in &mut points {
        // Cutting a model down to some photos leaves dangling entries behind in some tools.
        point.views.retain(|id| known.contains(id));
        point.views.sort_unstable();
        point.views.dedup();
        if !seen.insert(point.id) {
            return Err(Spot {
                path: &points_path,
                place: Place::File,
            }
            .bad(format!("two points have the id {}", point.id), AGAIN));
        }
    }
    let model = Model {
        cameras: by_id,
        views,
        points,
    };
    model.check(&images_path)?;
    Ok(model)
}

fn load(path: &Path) -> Result<Vec<u8>, ColmapError> {
    std::fs::read(path).map_err(|e| ColmapError::io("read", path, e))
}

fn write(dir: &Path, files: &[(&str, Vec<u8>)]) -> Result<(), ColmapError> {
    std::fs::create_dir_all(dir).map_err(|e| ColmapError::io("create", dir, e))?;
    for (name, bytes) in files {
        let path: PathBuf = dir.join(name);
        std::fs::write(&path, bytes).map_err(|e| ColmapError::io("write", &path, e))?;
    }
    Ok(())
}

/// Refuses names that would lead out of the image folder or break a text file.
pub(crate) fn check_name(name: &str, spot: Spot<'_>) -> Result<(), ColmapError> {
    let remedy = "give the photo a plain path below the image folder and register it again";
    if name.is_empty() {
        return Err(spot.bad("a photo has an empty name", remedy));
    }
    if name.chars().any(char::is_control) || name.trim() != name {
        return Err(spot.bad(
            format!("the photo name {name:?} has control characters or blanks at its ends"),
            remedy,
        ));
    }
    let drive = name.as_bytes().get(1) == Some(&b':');
    let outside = name.split(['/', '\\']).any(|part| part == "..");
    if drive || outside || name.starts_with(['/', '\\']) {
        return Err(spot.bad(
            format!("the photo name {name:?} leads out of the image folder"),
            remedy,
        ));
    }
    Ok(())
}

/// A checked pose from the file's `qw qx qy qz tx ty tz`.
pub(crate) fn check_pose(v: [f64; 7], name: &str, spot: Spot<'_>) -> Result<Pose, ColmapError> {
    let remedy = "the reconstruction failed for this photo; remove it from the model or redo it";
    if v.iter().any(|x| !x.is_finite()) {
        return Err(spot.bad(format!("the pose of {name:?} is not finite"), remedy));
    }
    let [w, x, y, z, tx, ty, tz] = v;
    // Scaled first: the length of a finite quaternion can overflow.
    let largest = [w, x, y, z].iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    if largest < 1e-12 {
        return Err(spot.bad(
            format!("the rotation of {name:?} is a zero quaternion"),
            remedy,
        ));
    }
    let rotation = DQuat::from_xyzw(x, y, z, w);
    // One that is a unit already is kept to the last bit, so that a model survives a round trip.
    let rotation = if (rotation.length_squared() - 1.0).abs() < 1e-14 {
        rotation
    } else {
        (rotation / largest).normalize()
    };
    Ok(Pose {
        rotation,
        translation: DVec3::new(tx, ty, tz),
    })
}

/// A checked point; NaN errors are COLMAP's "unknown", kept as -1.
pub(crate) fn check_point(point: SparsePoint, spot: Spot<'_>) -> Result<SparsePoint, ColmapError> {
    if !point.position.is_finite() {
        return Err(spot.bad(
            format!("point {} is at {}", point.id, point.position),
            "remove it from the model, or run COLMAP's model_converter or bundle adjuster again",
        ));
    }
    let error = if point.error.is_finite() {
        point.error
    } else {
        -1.0
    };
    Ok(SparsePoint { error, ..point })
}
