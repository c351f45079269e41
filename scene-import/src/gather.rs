//! Collects the views that a reader finds, and makes a model of those that have a photo.

use crate::error::ImportError;
use crate::format::Format;
use crate::photos::{Match, NO_PHOTO};
use glam::DVec3;
use io_colmap::{Camera, Model, PhotoHeader, Pose, View, same_shape};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};
use std::path::{Component, Path, PathBuf};

/// Cameras this many times farther from the origin than from each other are moved to it: single
/// precision, which most tools compute in, has seven digits.
const FAR_AWAY: f64 = 1e4;

/// Poses of another tool, with the photos and masks that go with them.
#[derive(Debug, Clone)]
pub struct Imported {
    /// What it was read as.
    pub format: Format,
    /// Cameras at their photos' size, views sorted by name, no points (a COLMAP model keeps its).
    pub model: Model,
    /// The photo of each view.
    pub photos: Vec<PathBuf>,
    /// The mask that the poses' own file or folder layout gives each view.
    pub masks: Vec<Option<PathBuf>>,
    /// The folder to look for other masks in.
    pub root: PathBuf,
    /// Decisions taken, one sentence each, for the user to see.
    pub notes: Vec<String>,
    /// Views that were left out.
    pub dropped: Vec<Dropped>,
}

/// A view that was listed but is not imported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dropped {
    /// How its file calls it.
    pub name: String,
    /// Why it was left out, as the end of a sentence: "has no photo".
    pub why: String,
    /// How its file calls another view that the same photo may be of, where that is the reason.
    pub rival: Option<String>,
}

impl Dropped {
    /// Whether its photo is not there, rather than of no use.
    #[must_use]
    pub fn is_missing(&self) -> bool {
        self.why == NO_PHOTO
    }

    /// Why it was left out, with the view that is the reason, as the end of a sentence.
    #[must_use]
    pub fn reason(&self) -> String {
        match &self.rival {
            Some(rival) => format!("{}: {rival}", self.why),
            None => self.why.clone(),
        }
    }
}

/// A view as a reader finds it.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub(crate) photo: Match,
    pub(crate) mask: Option<PathBuf>,
    /// At the size it is stated for; the id does not matter.
    pub(crate) camera: Camera,
    pub(crate) camera_from_world: Pose,
}

/// What a reader has found so far.
#[derive(Debug, Default)]
pub(crate) struct Gather {
    pub(crate) views: Vec<Found>,
    pub(crate) notes: Vec<String>,
    pub(crate) dropped: Vec<Dropped>,
    /// Photos of views that are left out: what is stated of these may be as near to them as what a view states.
    pub(crate) rivals: Vec<Match>,
    /// What could not be looked at for photos, a sentence each.
    left_out: Vec<String>,
}

impl Gather {
    /// Whoever uses photos that were looked for says so of those that could not be.
    pub(crate) fn leave_out(&mut self, notes: &[String]) {
        self.left_out.extend_from_slice(notes);
    }

    pub(crate) fn drop_view(&mut self, name: impl Into<String>, why: impl Into<String>) {
        self.dropped.push(Dropped {
            name: name.into(),
            why: why.into(),
            rival: None,
        });
    }

    /// Makes the model. `source` is the file the poses came from.
    pub(crate) fn finish(
        mut self,
        format: Format,
        root: &Path,
        source: &Path,
    ) -> Result<Imported, ImportError> {
        self.once_each();
        if self.views.is_empty() {
            let besides = match self.left_out.first() {
                Some(note) => format!(", and {note}"),
                None => String::new(),
            };
            return Err(ImportError::bad(
                source,
                match self.dropped.first() {
                    Some(first) => format!(
                        "none of its {} views can be used; the first, {:?}, {}{besides}",
                        self.dropped.len(),
                        first.name,
                        first.reason()
                    ),
                    None => "it lists no views".to_owned(),
                },
                "put the photos where the file says, or name their folder with sos import --images",
            ));
        }
        self.notes.append(&mut self.left_out);
        let mut all: Vec<(String, Found)> = {
            let views = self.views.iter();
            let photos: Vec<&Path> = views.map(|view| &*view.photo.photo).collect();
            names(&photos, source)?
                .into_iter()
                .zip(self.views.drain(..))
                .collect()
        };
        all.sort_by(|a, b| a.0.cmp(&b.0));
        self.fit_to_photos(&mut all)?;
        self.bring_near(&mut all);
        let mut model = Model::default();
        let (mut photos, mut masks) = (Vec::new(), Vec::new());
        for ((name, found), id) in all.into_iter().zip(1..) {
            let camera_id = shared_camera(&mut model, found.camera);
            model.views.push(View {
                id,
                name,
                camera_id,
                camera_from_world: found.camera_from_world,
            });
            photos.push(found.photo.photo);
            masks.push(found.mask);
        }
        Ok(Imported {
            format,
            model,
            photos,
            masks,
            root: root.to_path_buf(),
            notes: self.notes,
            dropped: self.dropped,
        })
    }

    /// A photo is of the view that states its path best. If it is listed again it keeps its first pose, and where
    /// several paths fit it alike, as those of two folders do where it is in neither, nobody knows whose it is.
    fn once_each(&mut self) {
        let found: Vec<&Match> = self.views.iter().map(|view| &view.photo).collect();
        let claims = other_claims(&found, &self.rivals);
        let mut seen = HashSet::new();
        for (view, claim) in std::mem::take(&mut self.views).into_iter().zip(claims) {
            if let Some((fit, rival)) = claim {
                let why = match fit {
                    Ordering::Equal => "has only a photo that another view fits as well",
                    _ => "has no photo but one that another view fits better",
                };
                self.dropped.push(Dropped {
                    name: view.photo.stated,
                    why: why.to_owned(),
                    rival: Some(rival),
                });
            } else if seen.insert(plain(&view.photo.photo)) {
                self.views.push(view);
            } else {
                let name = view.photo.photo.display().to_string();
                self.drop_view(name, "is listed twice");
            }
        }
    }

    /// Scales every camera to its photo, or says which photo cannot be its.
    fn fit_to_photos(&mut self, views: &mut [(String, Found)]) -> Result<(), ImportError> {
        let headers: Vec<PhotoHeader> = views
            .par_iter()
            .map(|(_, view)| PhotoHeader::read(&view.photo.photo))
            .collect::<Result<_, _>>()?;
        let (mut scaled, mut example, mut turned, mut kept) = (0, None, 0, 0);
        for ((_, view), header) in views.iter_mut().zip(headers) {
            let stated = (view.camera.width, view.camera.height);
            let size = if header.is_turned_for(stated) {
                turned += 1;
                header.upright()
            } else {
                kept += usize::from(header.upright() != header.stored);
                header.stored
            };
            if size == stated {
                continue;
            }
            if !same_shape(size, stated) {
                return Err(ImportError::bad(
                    &view.photo.photo,
                    format!(
                        "the photo is {}x{} but its camera is for {}x{}, another shape",
                        size.0, size.1, stated.0, stated.1
                    ),
                    "use the photos the poses were made from, or scale them without cropping or turning",
                ));
            }
            view.camera = view.camera.scaled_to(size.0, size.1);
            scaled += 1;
            example.get_or_insert((stated, size));
        }
        if let Some((stated, size)) = example {
            self.notes.push(format!(
                "the cameras of {scaled} photos are scaled to them, such as from {}x{} to {}x{}",
                stated.0, stated.1, size.0, size.1
            ));
        }
        if turned > 0 {
            self.notes.push(format!(
                "{turned} photos are turned upright as their EXIF orientation says, which is how their cameras see them"
            ));
        }
        if kept > 0 {
            self.notes.push(format!(
                "{kept} photos have an EXIF orientation that their cameras do not follow; they are used as stored"
            ));
        }
        Ok(())
    }

    /// Moves scenes in geographic coordinates to the origin.
    fn bring_near(&mut self, views: &mut [(String, Found)]) {
        let centres: Vec<DVec3> = views
            .iter()
            .map(|(_, view)| view.camera_from_world.centre())
            .collect();
        let mean = centres.iter().sum::<DVec3>() / centres.len() as f64;
        let spread = centres
            .iter()
            .map(|c| c.distance(mean))
            .fold(0.0_f64, f64::max);
        // Whole units, so that the offset can be typed.
        let offset = mean.round();
        // Cameras that only turn, about wherever, have no spread.
        let is_spread = spread > 1e-12 * mean.length();
        if !is_spread || mean.length() <= FAR_AWAY * spread || offset == DVec3::ZERO {
            return;
        }
        for (_, view) in views {
            let pose = &mut view.camera_from_world;
            pose.translation += pose.rotation * offset;
        }
        self.notes.push(format!(
            "the scene is far from the origin and is moved by ({}, {}, {}); add that to come back",
            offset.x, offset.y, offset.z
        ));
    }
}

/// The number of an equal camera in the model, or of a new one.
fn shared_camera(model: &mut Model, camera: Camera) -> u32 {
    let equal = |known: &&Camera| {
        known.model == camera.model
            && (known.width, known.height) == (camera.width, camera.height)
            && known.params == camera.params
    };
    if let Some(known) = model.cameras.values().find(equal) {
        return known.id;
    }
    let id = model.cameras.len() as u32 + 1;
    model.cameras.insert(id, Camera { id, ..camera });
    id
}

/// For each file that was found by a name: whether another name fits it as well or better, and which. What else was
/// found is among the `others`.
pub(crate) fn other_claims(found: &[&Match], others: &[Match]) -> Vec<Option<(Ordering, String)>> {
    let mut sharing: HashMap<PathBuf, Vec<&Match>> = HashMap::new();
    for one in found.iter().copied().chain(others) {
        sharing.entry(plain(&one.photo)).or_default().push(one);
    }
    let claim = |own: &Match| {
        let others = sharing[&plain(&own.photo)].iter();
        let others = others.filter(|other| !other.is_again(own));
        // The first of the best.
        let rival = others.rev().max_by_key(|other| other.fit)?;
        let fit = rival.fit.cmp(&own.fit);
        fit.is_ge().then(|| (fit, rival.stated.clone()))
    };
    found.iter().map(|own| claim(own)).collect()
}

/// Names for photos: their paths below the folder that all of them have in common.
fn names(photos: &[&Path], source: &Path) -> Result<Vec<String>, ImportError> {
    let common = common_folder(photos.iter().copied());
    photos
        .iter()
        .map(|photo| {
            let path = plain(photo);
            let parts = path.strip_prefix(&common).unwrap_or(&path).components();
            let parts: Option<Vec<&str>> = parts.map(|part| part.as_os_str().to_str()).collect();
            parts.map(|parts| parts.join("/")).ok_or_else(|| {
                ImportError::bad(
                    source,
                    format!("the photo's name {} is not Unicode", photo.display()),
                    "rename the photo",
                )
            })
        })
        .collect()
}

/// The folder that all these files have in common.
pub(crate) fn common_folder<'a>(files: impl Iterator<Item = &'a Path>) -> PathBuf {
    let mut folders = files.map(|file| {
        let mut folder = plain(file);
        folder.pop();
        folder
    });
    let first = folders.next().unwrap_or_default();
    let shared = |one: PathBuf, other: PathBuf| {
        let pairs = one.components().zip(other.components());
        pairs.take_while(|(a, b)| a == b).map(|(a, _)| a).collect()
    };
    folders.fold(first, shared)
}

/// The path without `.`, and with `..` resolved as text.
pub(crate) fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir
                if matches!(plain.components().next_back(), Some(Component::Normal(_))) =>
            {
                plain.pop();
            }
            other => plain.push(other),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn named(photos: &[&str]) -> Vec<String> {
        let photos: Vec<&Path> = photos.iter().map(Path::new).collect();
        names(&photos, Path::new("x.json")).unwrap()
    }

    #[test]
    fn names_begin_where_photos_part() {
        assert_eq!(
            named(&["s/images/a.jpg", "s/./images/b.jpg"]),
            ["a.jpg", "b.jpg"]
        );
        assert_eq!(named(&["s/a/1.jpg", "s/b/1.jpg"]), ["a/1.jpg", "b/1.jpg"]);
        assert_eq!(named(&["s/x/../images/a.jpg"]), ["a.jpg"]);
        assert_eq!(
            named(&["/p/../q/a.jpg", "/q/c/b.jpg"]),
            ["a.jpg", "c/b.jpg"]
        );
    }
}
