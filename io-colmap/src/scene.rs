//! A scene folder: which model, which photos, and whether they belong together.

use crate::error::ColmapError;
use crate::model::{Format, Model, View};
use crate::photo::{PhotoHeader, read_photo};
use crate::pose::Pose;
use image::DynamicImage;
use image::metadata::Orientation;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// Photo folders by name, in the order in which they are preferred.
const IMAGE_FOLDERS: [&str; 9] = [
    "images",
    "image",
    "input",
    "rgb",
    "imgs",
    "photos",
    "colmap/images",
    "../images",
    "../../images",
];

/// What to do where a registered photo is missing.
const REMEDY_FOR_MISSING: &str =
    "put the photos into images/ under the names they were registered with";

/// Two sizes count as the same picture if their aspect ratios differ by no more than this.
const ASPECT_TOLERANCE: f64 = 0.01;

/// A model together with its photos, checked against each other.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The folder that was opened.
    pub root: PathBuf,
    /// The folder that [`View::name`] is relative to.
    pub image_dir: PathBuf,
    /// With at least one view; every camera has its photos' true size.
    pub model: Model,
    /// Decisions taken, one sentence each, for the user to see.
    pub notes: Vec<String>,
}

impl Scene {
    /// Finds the model and the photos in a scene folder.
    ///
    /// The model is looked for in `sparse/` and its sub-folders, the folder itself and its
    /// sub-folders, and `colmap/sparse/`; among sub-models the one with the most registered photos is taken.
    /// Photos are looked for in `images/`, other usual names, and the folder itself. Only their
    /// headers are read: where a photo has another size than its camera but the same shape, the
    /// camera is scaled to it.
    ///
    /// # Errors
    /// [`ColmapError`] where there is no model, it is damaged or without photos, a registered
    /// photo is missing or unreadable, or has another shape than its camera.
    pub fn open(dir: &Path) -> Result<Scene, ColmapError> {
        let (scene, missing) = Self::open_present(dir)?;
        let Some(first) = missing.first() else {
            return Ok(scene);
        };
        Err(ColmapError::scene(
            &scene.image_dir.join(first),
            match missing.len() {
                1 => "this registered photo is missing".to_owned(),
                n => format!(
                    "this registered photo is missing, as are {} more of the model's {}",
                    n - 1,
                    n + scene.model.views.len()
                ),
            },
            REMEDY_FOR_MISSING,
        ))
    }

    /// As [`Scene::open`], but views whose photo is missing are left out of the model; their names
    /// come back beside it.
    ///
    /// # Errors
    /// As [`Scene::open`], with a missing photo only where all are.
    pub fn open_present(dir: &Path) -> Result<(Scene, Vec<String>), ColmapError> {
        if !dir.is_dir() {
            return Err(ColmapError::scene(
                dir,
                "there is no such folder",
                "give the folder that holds images/ and sparse/",
            ));
        }
        let mut notes = Vec::new();
        let (model_dir, mut model) = find_model(dir, &mut notes)?;
        if model.views.is_empty() {
            return Err(ColmapError::scene(
                &model_dir,
                "the model has no registered photos",
                "the reconstruction failed; take more photos with more overlap and run it again",
            ));
        }
        let (image_dir, missing) = find_images(dir, &model, &mut notes);
        if missing.len() == model.views.len() {
            let first = missing.first().map_or("", String::as_str);
            return Err(ColmapError::scene(
                &image_dir.join(first),
                match missing.len() {
                    1 => "this registered photo is missing".to_owned(),
                    n => format!("this registered photo is missing, as are all {n} of the model"),
                },
                REMEDY_FOR_MISSING,
            ));
        }
        model.views.retain(|view| !missing.contains(&view.name));
        fit_cameras(&mut model, &image_dir, &mut notes)?;
        let scene = Scene {
            root: dir.to_path_buf(),
            image_dir,
            model,
            notes,
        };
        Ok((scene, missing))
    }

    /// Finds a folder's model as [`Scene::open`] does and reads it alone: for cameras without photos.
    ///
    /// # Errors
    /// [`ColmapError`] where there is no model or it is damaged.
    pub fn read_model(dir: &Path) -> Result<Model, ColmapError> {
        Ok(find_model(dir, &mut Vec::new())?.1)
    }

    /// Takes the poses of the model that lies in `dir`, where there is one, for photos of the same names; whether
    /// there is one.
    ///
    /// # Errors
    /// [`ColmapError`] where the model is damaged.
    pub fn take_poses(&mut self, dir: &Path) -> Result<bool, ColmapError> {
        if Format::of(dir).is_none() {
            return Ok(false);
        }
        let model = Model::read(dir)?;
        let poses: HashMap<&str, Pose> = (model.views.iter())
            .map(|view| (view.name.as_str(), view.camera_from_world))
            .collect();
        for view in &mut self.model.views {
            if let Some(pose) = poses.get(view.name.as_str()) {
                view.camera_from_world = *pose;
            }
        }
        Ok(true)
    }

    /// Where a view's photo lies.
    #[must_use]
    pub fn image_path(&self, view: &View) -> PathBuf {
        self.image_dir.join(&view.name)
    }

    /// A view's photo, the way up that its camera has.
    ///
    /// # Errors
    /// [`ColmapError::Scene`] if it is missing or no picture.
    pub fn read_photo(&self, view: &View) -> Result<DynamicImage, ColmapError> {
        let camera = self.model.cameras.get(&view.camera_id);
        // A scene without the view's camera is never opened; such a photo would be as stored.
        let size = camera.map_or((0, 0), |camera| (camera.width, camera.height));
        read_photo(&self.image_path(view), size)
    }

    /// Whether [`Scene::open`] would find a COLMAP model in the folder.
    #[must_use]
    pub fn has_model(dir: &Path) -> bool {
        !model_folders(dir).is_empty()
    }
}

/// Whether two sizes in pixels, width and height, show the same picture up to its resolution. One of nothing does not.
#[must_use]
pub fn same_shape(a: (u32, u32), b: (u32, u32)) -> bool {
    if a.0.min(a.1).min(b.0).min(b.1) == 0 {
        return false;
    }
    let cross = |p: (u32, u32), q: (u32, u32)| f64::from(p.0) * f64::from(q.1);
    let (x, y) = (cross(a, b), cross(b, a));
    (x - y).abs() <= ASPECT_TOLERANCE * y
}

/// Sub-folders in order of their number, then of their name.
fn sub_folders(dir: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(dir)
        .map(|entries| {
            entries
                .flatten()
                .map(|e| e.path())
                .filter(|p| p.is_dir())
                .collect()
        })
        .unwrap_or_default();
    all.sort_by_key(|path| {
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        (name.parse::<u64>().unwrap_or(u64::MAX), name)
    });
    all
}

/// The folders with models at the first place that has any.
fn model_folders(dir: &Path) -> Vec<PathBuf> {
    let pool = |sparse: PathBuf| {
        let mut candidates = sub_folders(&sparse);
        candidates.push(sparse);
        candidates.retain(|path| Format::of(path).is_some());
        candidates
    };
    [
        dir.join("sparse"),
        dir.to_path_buf(),
        dir.join("colmap/sparse"),
    ]
    .into_iter()
    .map(pool)
    .find(|candidates| !candidates.is_empty())
    .unwrap_or_default()
}

fn find_model(dir: &Path, notes: &mut Vec<String>) -> Result<(PathBuf, Model), ColmapError> {
    let candidates = model_folders(dir);
    if candidates.is_empty() {
        return Err(ColmapError::scene(
            dir,
            "no COLMAP model was found in sparse/, its sub-folders, the folder itself or colmap/sparse/",
            "put cameras, images and points3D (.bin or .txt) into sparse/0",
        ));
    }
    let mut counts = Vec::new();
    let mut best: Option<(PathBuf, Model)> = None;
    for path in candidates {
        let model = Model::read(&path)?;
        counts.push(format!("{} has {}", shown(&path, dir), model.views.len()));
        if best
            .as_ref()
            .is_none_or(|(_, so_far)| model.views.len() > so_far.views.len())
        {
            best = Some((path, model));
        }
    }
    let Some((path, model)) = best else {
        // Unreachable: the list of candidates is not empty.
        return Err(ColmapError::scene(
            dir,
            "no COLMAP model was found",
            "check the folder",
        ));
    };
    if counts.len() > 1 {
        notes.push(format!(
            "there are {} models; {} was taken because it has the most registered photos ({})",
            counts.len(),
            shown(&path, dir),
            counts.join(", ")
        ));
    } else if !path.starts_with(dir.join("sparse")) {
        notes.push(format!("the model is taken from {}", path.display()));
    }
    Ok((path, model))
}

/// A path as the user thinks of it, from the scene folder down.
fn shown(path: &Path, root: &Path) -> String {
    match path.strip_prefix(root) {
        Ok(rest) if rest.as_os_str().is_empty() => ".".to_owned(),
        Ok(rest) => rest.display().to_string(),
        Err(_) => path.display().to_string(),
    }
}

/// The folder that has the most of the model's photos, and the names of those it lacks.
fn find_images(dir: &Path, model: &Model, notes: &mut Vec<String>) -> (PathBuf, Vec<String>) {
    let mut best: Option<(PathBuf, &str, Vec<String>)> = None;
    for name in IMAGE_FOLDERS.iter().copied().chain([""]) {
        let folder = if name.is_empty() {
            dir.to_path_buf()
        } else {
            dir.join(name)
        };
        if !folder.is_dir() {
            continue;
        }
        let missing: Vec<String> = model
            .views
            .iter()
            .map(|view| view.name.clone())
            .filter(|name| !folder.join(name).is_file())
            .collect();
        if best
            .as_ref()
            .is_none_or(|(_, _, fewest)| missing.len() < fewest.len())
        {
            best = Some((folder, name, missing));
        }
    }
    let Some((folder, name, missing)) = best else {
        let all = model.views.iter().map(|view| view.name.clone()).collect();
        return (dir.to_path_buf(), all);
    };
    if name != "images" && missing.len() < model.views.len() {
        notes.push(format!("photos are taken from {}", folder.display()));
    }
    (folder, missing)
}

/// Brings every camera to the size of its photos, or says which photo cannot be its.
fn fit_cameras(
    model: &mut Model,
    image_dir: &Path,
    notes: &mut Vec<String>,
) -> Result<(), ColmapError> {
    let cameras = &model.cameras;
    let found: Vec<(PhotoHeader, bool)> = model
        .views
        .par_iter()
        .map(|view| {
            let header = PhotoHeader::read(&image_dir.join(&view.name))?;
            let turned = cameras
                .get(&view.camera_id)
                .is_some_and(|camera| header.is_turned_for((camera.width, camera.height)));
            Ok((header, turned))
        })
        .collect::<Result<_, ColmapError>>()?;
    let turned = found.iter().filter(|(_, turned)| *turned).count();
    if turned > 0 {
        notes.push(format!(
            "{turned} photos are turned upright as their EXIF orientation says, which is how their cameras see them"
        ));
    }
    let is_marked = |header: &PhotoHeader| header.orientation != Orientation::NoTransforms;
    let stored = found
        .iter()
        .filter(|(header, turned)| is_marked(header) && !turned);
    match stored.count() {
        0 => {}
        marked => notes.push(format!(
            "{marked} photos have an EXIF orientation that their cameras do not follow: they are used as they are stored, and \
             so are masks and results; viewers show such photos turned"
        )),
    }
    let sizes: Vec<(u32, u32)> = found
        .into_iter()
        .map(|(header, turned)| match turned {
            true => header.upright(),
            false => header.stored,
        })
        .collect();

    // Views by camera and true size; photos of one camera may have been resized differently.
    let mut groups: BTreeMap<(u32, (u32, u32)), Vec<usize>> = BTreeMap::new();
    for (i, (view, &size)) in model.views.iter().zip(&sizes).enumerate() {
        groups.entry((view.camera_id, size)).or_default().push(i);
    }
    let originals = model.cameras.clone();
    for (&id, camera) in &originals {
        let stated = (camera.width, camera.height);
        // Whoever keeps the camera's number: the photos of its own size, else the first others.
        let mut number_is_free = !groups.contains_key(&(id, stated));
        for ((_, size), members) in groups.range((id, (0, 0))..=(id, (u32::MAX, u32::MAX))) {
            if *size == stated {
                continue;
            }
            let photo = &model.views[members[0]].name;
            if !same_shape(*size, stated) {
                let turned = same_shape((size.1, size.0), stated);
                return Err(ColmapError::scene(
                    &image_dir.join(photo),
                    format!(
                        "the photo is {}x{} but its camera {id} is {}x{}, another shape",
                        size.0, size.1, stated.0, stated.1
                    ),
                    if turned {
                        "it seems to have been turned; use the photos the model was made from"
                    } else {
                        "use the photos the model was made from, or scale them without cropping"
                    },
                ));
            }
            notes.push(format!(
                "camera {id} is stated for {}x{} but {} of its photos are {}x{} ({photo}): scaled to them",
                stated.0, stated.1, members.len(), size.0, size.1
            ));
            let mut scaled = camera.scaled_to(size.0, size.1);
            if number_is_free {
                number_is_free = false;
            } else {
                let unused = (1..=u32::MAX).find(|n| !model.cameras.contains_key(n));
                scaled.id = unused.unwrap_or_default();
                for &i in members {
                    model.views[i].camera_id = scaled.id;
                }
            }
            model.cameras.insert(scaled.id, scaled);
        }
    }
    Ok(())
}
