//! Which tool a folder's poses come from.

use crate::error::ImportError;
use io_colmap::{PICTURE_ENDINGS, Scene, Search};
use std::fmt;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A way of writing camera poses down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// COLMAP's own, binary or text.
    Colmap,
    /// `transforms.json` of NeRF, instant-ngp and nerfstudio.
    Transforms,
    /// `poses_bounds.npy` of LLFF.
    Llff,
    /// `cameras_sphere.npz` of NeuS and IDR.
    Neus,
    /// `cams/*_cam.txt` of BlendedMVS and MVSNet.
    BlendedMvs,
    /// `frame_annotations.jgz` of CO3D.
    Co3d,
    /// `rgb.txt` and `groundtruth.txt` of the TUM RGB-D benchmark.
    Tum,
    /// Agisoft Metashape's XML of cameras.
    Metashape,
    /// RealityCapture's CSV of internal and external camera parameters.
    RealityCapture,
}

use Format as F;

/// Photos, however deep.
const PHOTOS: Search<'static> = Search {
    depth: 4,
    endings: &PICTURE_ENDINGS,
    mask_folders: false,
};

/// The files of a COLMAP model, without endings.
const COLMAP_FILES: [&str; 5] = ["cameras", "images", "points3D", "rigs", "frames"];

/// A name at most this many edits away is offered for one that is not known.
const NEAREST: usize = 3;

impl Format {
    /// Every format, in the order in which they are preferred where a folder has several.
    pub const ALL: [Format; 9] = [
        F::Colmap,
        F::Transforms,
        F::Llff,
        F::Neus,
        F::BlendedMvs,
        F::Co3d,
        F::Tum,
        F::Metashape,
        F::RealityCapture,
    ];

    /// A word for command lines.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            F::Colmap => "colmap",
            F::Transforms => "transforms",
            F::Llff => "llff",
            F::Neus => "neus",
            F::BlendedMvs => "blendedmvs",
            F::Co3d => "co3d",
            F::Tum => "tum",
            F::Metashape => "metashape",
            F::RealityCapture => "realitycapture",
        }
    }

    /// The file or folder by which this format is found in a folder.
    fn find(self, dir: &Path) -> Option<PathBuf> {
        let first = |names: &[&str]| {
            names
                .iter()
                .map(|name| dir.join(name))
                .find(|path| path.is_file())
        };
        match self {
            F::Colmap => Scene::has_model(dir).then(|| dir.to_path_buf()),
            F::Transforms => first(&["transforms.json", "transforms_train.json"]),
            F::Llff => first(&["poses_bounds.npy"]),
            F::Neus => first(&["cameras_sphere.npz", "cameras.npz"]),
            F::BlendedMvs => Some(dir.join("cams")).filter(|cams| {
                entries(cams)
                    .iter()
                    .any(|path| name_of(path).ends_with("_cam.txt"))
            }),
            F::Co3d => first(&["frame_annotations.jgz"]).or_else(|| {
                // The folder of one sequence.
                let photos = dir.join("images");
                dir.canonicalize()
                    .ok()?
                    .parent()
                    .map(|parent| parent.join("frame_annotations.jgz"))
                    .filter(|path| path.is_file() && photos.is_dir())
            }),
            F::Tum => first(&["groundtruth.txt"]).filter(|_| dir.join("rgb.txt").is_file()),
            F::Metashape => entries(dir)
                .into_iter()
                .find(|path| has_ending(path, "xml") && starts_like_metashape(path)),
            F::RealityCapture => entries(dir)
                .into_iter()
                .find(|path| has_ending(path, "csv") && starts_like_reality_capture(path)),
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            F::Colmap => "a COLMAP model",
            F::Transforms => "NeRF's transforms.json",
            F::Llff => "LLFF's poses_bounds.npy",
            F::Neus => "NeuS's cameras.npz",
            F::BlendedMvs => "BlendedMVS's cams",
            F::Co3d => "CO3D's annotations",
            F::Tum => "a TUM RGB-D sequence",
            F::Metashape => "Metashape's XML",
            F::RealityCapture => "RealityCapture's CSV",
        })
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        Format::ALL
            .into_iter()
            .find(|format| format.name() == word)
            .ok_or_else(|| {
                let names = Format::ALL.map(Format::name);
                let typed = word.to_lowercase();
                let edits = |name: &&str| strsim::damerau_levenshtein(&typed, name);
                let near = names
                    .iter()
                    // As many edits as letters would turn it into any word.
                    .filter(|name| edits(name) <= NEAREST && edits(name) < name.len())
                    .min_by_key(|name| edits(name));
                let meant = near.map(|name| format!("; did you mean {name}?"));
                format!(
                    "no format is called {word:?}{} There are {}",
                    meant.unwrap_or_else(|| ".".to_owned()),
                    names.join(", ")
                )
            })
    }
}

/// What a folder was taken for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Detected {
    /// The format.
    pub format: Format,
    /// The folder of the scene.
    pub root: PathBuf,
    /// The file with the poses, or the folder of such files.
    pub source: PathBuf,
    /// What else the folder could be read as.
    pub others: Vec<Format>,
}

impl Detected {
    /// A sentence to tell the user.
    #[must_use]
    pub fn sentence(&self) -> String {
        let mut text = format!(
            "poses are read from {} ({})",
            self.source.display(),
            self.format
        );
        if let Some(other) = self.others.first() {
            text.push_str(&format!(
                "; there is {other} too, which --format {} would take",
                other.name()
            ));
        }
        text
    }
}

/// Finds out what a folder holds, or takes it for what is `stated`. A path to the file with the
/// poses does as well as its folder.
///
/// # Errors
/// [`ImportError::Content`] where there is no such folder, or no poses in it.
pub fn detect(path: &Path, stated: Option<Format>) -> Result<Detected, ImportError> {
    let root = if path.is_file() {
        match path.parent() {
            Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
            Some(parent) => parent,
            None => path,
        }
    } else {
        path
    };
    if !root.is_dir() {
        return Err(ImportError::bad(
            path,
            "there is no such file or folder",
            "give a folder of photos with camera poses, or the file with the poses; sos capture finds poses \
             for photos without and for a video",
        ));
    }
    let mut found: Vec<(Format, PathBuf)> = Format::ALL
        .into_iter()
        .filter_map(|format| format.find(root).map(|source| (format, source)))
        .collect();
    if path.is_file() {
        // The file decides, also between several of a kind.
        let name = path.file_name().unwrap_or_default();
        let as_found = root.join(name);
        let named = found
            .iter()
            .find(|(_, source)| *source == as_found)
            .map(|(format, _)| *format)
            .or_else(|| format_of_file(path));
        if let Some(format) = named {
            found.retain(|(other, _)| *other != format);
            found.insert(0, (format, path.to_path_buf()));
        } else if let Some(at) = found.iter().position(|(format, _)| is_part(path, *format)) {
            let whole = found.remove(at);
            found.insert(0, whole);
        } else if stated.is_none_or(|stated| found.iter().all(|(format, _)| *format != stated)) {
            return Err(ImportError::bad(
                path,
                "this file is in none of the known formats",
                "give the file with the poses, or the folder it is in to have that looked through",
            ));
        }
    }
    if let Some(stated) = stated {
        let Some(at) = found.iter().position(|(format, _)| *format == stated) else {
            return Err(ImportError::bad(
                path,
                format!("{stated} was not found"),
                "leave --format out to take what is there",
            ));
        };
        let chosen = found.remove(at);
        found.insert(0, chosen);
    }
    let mut found = found.into_iter();
    let Some((format, source)) = found.next() else {
        let what = "no camera poses were found: no COLMAP model (sparse/), transforms.json, \
                    poses_bounds.npy, cameras_sphere.npz, cams/, frame_annotations.jgz, rgb.txt with \
                    groundtruth.txt, Metashape XML or RealityCapture CSV";
        let has_photos = PHOTOS
            .list(root)
            .map_or(true, |listing| listing.count() + listing.closed.len() > 0);
        return Err(if has_photos {
            let remedy = "run COLMAP on the photos first, or put the poses beside images/";
            ImportError::bad(path, what, remedy)
        } else {
            let remedy = "give the folder that the photos are in";
            ImportError::bad(path, format!("there are no photos, and {what}"), remedy)
        });
    };
    Ok(Detected {
        format,
        root: root.to_path_buf(),
        source,
        others: found.map(|(format, _)| format).collect(),
    })
}

/// By its name or first lines, for a file that goes by another name than usual.
fn format_of_file(path: &Path) -> Option<Format> {
    match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "json" => Some(F::Transforms),
        "npy" => Some(F::Llff),
        "npz" => Some(F::Neus),
        "jgz" => Some(F::Co3d),
        "xml" => starts_like_metashape(path).then_some(F::Metashape),
        "csv" => starts_like_reality_capture(path).then_some(F::RealityCapture),
        _ => None,
    }
}

/// Whether a file belongs to others with which it is read by this format.
fn is_part(path: &Path, format: Format) -> bool {
    let name = name_of(path);
    match format {
        F::Colmap => {
            let is_model = |(stem, ending): (&str, &str)| {
                COLMAP_FILES.contains(&stem) && ["bin", "txt"].contains(&ending)
            };
            name.rsplit_once('.').is_some_and(is_model)
        }
        F::Tum => name == "rgb.txt",
        _ => false,
    }
}

/// What is in a folder, sorted.
fn entries(dir: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(dir)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect();
    all.sort();
    all
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.is_file()
        && path
            .extension()
            .is_some_and(|found| found.eq_ignore_ascii_case(ending))
}

/// The first kilobytes of a file, as text.
fn beginning(path: &Path) -> String {
    let mut bytes = Vec::new();
    // A file that cannot be read is not what is looked for.
    if let Ok(file) = std::fs::File::open(path) {
        let _ = file.take(8192).read_to_end(&mut bytes);
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn starts_like_metashape(path: &Path) -> bool {
    let text = beginning(path);
    text.contains("<document") && text.contains("<chunk")
}

fn starts_like_reality_capture(path: &Path) -> bool {
    beginning(path)
        .lines()
        .take(5)
        .any(crate::reality_capture::is_header)
}
