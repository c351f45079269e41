//! Which photos there are, and which of them one camera took with one focal length.

use crate::error::CaptureError;
use exif::{In, Tag};
use image::metadata::Orientation;
use io_colmap::PhotoHeader;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Endings of photos, in small letters. OpenEXR is left out: COLMAP 3 does not read it.
const PHOTO_ENDINGS: [&str; 6] = ["jpg", "jpeg", "png", "webp", "tif", "tiff"];
/// Endings of videos, in small letters.
pub(crate) const VIDEO_ENDINGS: [&str; 15] = [
    "mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "ts", "mpg", "mpeg", "3gp", "wmv",
    "flv", "ogv",
];
/// What phones take and COLMAP does not read.
const HEIF_ENDINGS: [&str; 3] = ["heic", "heif", "avif"];
/// Sub-folders that hold the photos, where a folder has one of them.
const PHOTO_FOLDERS: [&str; 3] = ["images", "input", "photos"];
/// How deep sub-folders are searched.
const MAX_DEPTH: usize = 4;
/// Fewer give no scene.
const FEWEST: usize = 3;

/// The photos of a folder.
#[derive(Debug)]
pub(crate) struct PhotoSet {
    /// What names are relative to.
    pub(crate) root: PathBuf,
    /// Sorted by name.
    pub(crate) photos: Vec<Photo>,
    /// What was left out.
    pub(crate) notes: Vec<String>,
}

/// One photo.
#[derive(Debug, Clone)]
pub(crate) struct Photo {
    /// Path below the root, with `/` between folders.
    pub(crate) name: String,
    /// Of the pixels as COLMAP sees them.
    pub(crate) size: (u32, u32),
    /// How a viewer turns the pixels as they are stored (EXIF); in a scene, how they were turned.
    pub(crate) orientation: Orientation,
    exif: Exif,
}

/// What EXIF tells about a photo.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Exif {
    /// Make, lens and focal length.
    lens: String,
    has_position: bool,
}

impl PhotoSet {
    /// The photos in `images/`, `input/` or `photos/`, else those in the folder itself, else those
    /// in its sub-folders.
    pub(crate) fn find(folder: &Path) -> Result<PhotoSet, CaptureError> {
        if !folder.is_dir() {
            return Err(CaptureError::bad(
                folder,
                "there is no such folder",
                "give a folder of photos or a video file",
            ));
        }
        let mut notes = Vec::new();
        let (root, files) = photo_files(folder, &mut notes)?;
        let found: Vec<Result<Photo, (String, String)>> = files
            .into_par_iter()
            .map(|name| look(&root, name))
            .collect();
        let (mut photos, mut unreadable) = (Vec::new(), Vec::new());
        for photo in found {
            match photo {
                Ok(photo) => photos.push(photo),
                Err(damaged) => unreadable.push(damaged),
            }
        }
        photos.sort_by(|a, b| a.name.cmp(&b.name));
        if let Some((name, why)) = unreadable.first() {
            notes.push(format!(
                "{} files are no readable photos and are left out, such as {name} ({why})",
                unreadable.len()
            ));
        }
        if photos.len() < FEWEST {
            return Err(too_few(&root, photos.len()));
        }
        Ok(PhotoSet {
            root,
            photos,
            notes,
        })
    }

    /// Photos that share a camera: of one folder, one size, and one lens at one focal length.
    ///
    /// COLMAP could be told to share cameras by folder, but then drops photos of another size, and
    /// would give the wide and the long lens of one phone the same focal length.
    pub(crate) fn by_camera(&self) -> Vec<Vec<&Photo>> {
        let mut groups: BTreeMap<_, Vec<&Photo>> = BTreeMap::new();
        for photo in &self.photos {
            let folder = photo.name.rsplit_once('/').map_or("", |(folder, _)| folder);
            groups
                .entry((folder, photo.size, &photo.exif.lens))
                .or_default()
                .push(photo);
        }
        groups.into_values().collect()
    }

    /// Whether most photos say where on Earth they were taken.
    pub(crate) fn has_positions(&self) -> bool {
        let located = self.photos.iter().filter(|p| p.exif.has_position).count();
        2 * located > self.photos.len()
    }
}

/// Whether [`PhotoSet::find`] would find any photo, or knows what to do about those it cannot read.
pub(crate) fn has_photos(folder: &Path) -> bool {
    photo_files(folder, &mut Vec::new()).is_ok_and(|(_, files)| !files.is_empty())
        || !heif_files(folder).is_empty()
}

/// Photos of phones that have to be converted first.
fn heif_files(folder: &Path) -> Vec<String> {
    let mut files = Vec::new();
    // A folder that cannot be listed has its error elsewhere.
    let _ = list(folder, "", 0, &HEIF_ENDINGS, &mut files);
    files
}

fn too_few(root: &Path, count: usize) -> CaptureError {
    let heif = heif_files(root);
    let what = if count == 0 {
        "it holds no photos (JPEG, PNG, WebP or TIFF)".to_owned()
    } else {
        format!("it holds only {count} photos")
    };
    if heif.is_empty() {
        let remedy =
            format!("give a folder of at least {FEWEST} photos, better 30, all around the object");
        CaptureError::bad(root, what, remedy)
    } else {
        CaptureError::bad(
            root,
            format!("{what}, and {} HEIC or AVIF files", heif.len()),
            "convert those to JPEG first, which a phone also does when it is set to most compatible",
        )
    }
}

/// The folder that the photos are in, and their names below it.
fn photo_files(
    folder: &Path,
    notes: &mut Vec<String>,
) -> Result<(PathBuf, Vec<String>), CaptureError> {
    for name in PHOTO_FOLDERS {
        let inner = folder.join(name);
        if inner.is_dir() {
            let files = photos_below(&inner, MAX_DEPTH)?;
            if !files.is_empty() {
                return Ok((inner, files));
            }
        }
    }
    let all = photos_below(folder, MAX_DEPTH)?;
    let direct: Vec<String> = all.iter().filter(|n| !n.contains('/')).cloned().collect();
    if direct.is_empty() {
        return Ok((folder.to_path_buf(), all));
    }
    if direct.len() < all.len() {
        notes.push(format!(
            "{} photos in sub-folders of {} are left out; the {} in it are taken",
            all.len() - direct.len(),
            folder.display(),
            direct.len()
        ));
    }
    Ok((folder.to_path_buf(), direct))
}

fn photos_below(folder: &Path, depth: usize) -> Result<Vec<String>, CaptureError> {
    let mut files = Vec::new();
    list(folder, "", depth, &PHOTO_ENDINGS, &mut files)?;
    files.sort();
    Ok(files)
}

fn list(
    folder: &Path,
    prefix: &str,
    depth: usize,
    endings: &[&str],
    out: &mut Vec<String>,
) -> Result<(), CaptureError> {
    let failed = |e| CaptureError::io("list", folder, e);
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            return Err(CaptureError::bad(
                &path,
                "the name is not Unicode",
                "rename the file",
            ));
        };
        if name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            // Masks bear the names of photos.
            if depth > 0 && !name.to_lowercase().contains("mask") {
                list(&path, &format!("{prefix}{name}/"), depth - 1, endings, out)?;
            }
        } else if let Some((_, ending)) = name.rsplit_once('.')
            && endings.contains(&&*ending.to_ascii_lowercase())
        {
            out.push(format!("{prefix}{name}"));
        }
    }
    Ok(())
}

/// Reads a photo's header and its EXIF; otherwise the name and why not.
fn look(root: &Path, name: String) -> Result<Photo, (String, String)> {
    // COLMAP reads lists of names line by line, and trims the lines.
    if name.trim() != name || name.contains(['\n', '\r']) {
        return Err((name, "its name begins or ends with a blank".to_owned()));
    }
    let path = root.join(&name);
    match PhotoHeader::read(&path) {
        Ok(header) => Ok(Photo {
            size: header.stored,
            orientation: header.orientation,
            exif: exif_of(&path),
            name,
        }),
        Err(_) => Err((name, "damaged, or another kind of file".to_owned())),
    }
}

/// Without EXIF, or with damaged EXIF, nothing is known.
fn exif_of(path: &Path) -> Exif {
    let Ok(file) = File::open(path) else {
        return Exif::default();
    };
    let Ok(exif) = exif::Reader::new().read_from_container(&mut BufReader::new(file)) else {
        return Exif::default();
    };
    let text = |tag| {
        exif.get_field(tag, In::PRIMARY)
            .map(|field| field.display_value().to_string())
            .unwrap_or_default()
    };
    let tags = [Tag::Make, Tag::Model, Tag::LensModel, Tag::FocalLength];
    Exif {
        lens: tags.map(text).join("|"),
        has_position: exif.get_field(Tag::GPSLatitude, In::PRIMARY).is_some(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn photo(path: &Path, width: u32) {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::RgbImage::new(width, 8).save(path).unwrap();
    }

    fn names(set: &PhotoSet) -> Vec<&str> {
        set.photos.iter().map(|photo| &*photo.name).collect()
    }

    #[test]
    fn photos_are_found_where_people_put_them() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        for name in ["1.png", "2.PNG", "3.jpg"] {
            photo(&root.join("left").join(name), 8);
            photo(&root.join("masks").join(name), 8);
        }
        photo(&root.join("right/1.png"), 8);
        let set = PhotoSet::find(root).unwrap();
        let expected = ["left/1.png", "left/2.PNG", "left/3.jpg", "right/1.png"];
        assert_eq!(names(&set), expected);
        assert_eq!(set.by_camera().len(), 2, "a camera per folder");

        for name in ["a.png", "b.png", "c.png", ".d.png"] {
            photo(&root.join(name), 8);
        }
        let set = PhotoSet::find(root).unwrap();
        assert_eq!(names(&set), ["a.png", "b.png", "c.png"]);
        assert!(
            set.notes[0].contains("4 photos in sub-folders"),
            "{:?}",
            set.notes
        );

        for name in ["x.png", "y.png", "z.png"] {
            photo(&root.join("images").join(name), 8);
        }
        let set = PhotoSet::find(root).unwrap();
        assert_eq!(set.root, root.join("images"));
        assert!(set.notes.is_empty());
        assert!(!set.has_positions());
    }

    #[test]
    fn sizes_have_cameras_of_their_own() {
        let dir = tempfile::tempdir().unwrap();
        for (name, width) in [("a.png", 8), ("b.png", 16), ("c.png", 8), ("d.png", 16)] {
            photo(&dir.path().join(name), width);
        }
        let set = PhotoSet::find(dir.path()).unwrap();
        let groups: Vec<Vec<&str>> = set
            .by_camera()
            .iter()
            .map(|group| group.iter().map(|photo| &*photo.name).collect())
            .collect();
        assert_eq!(groups, [["a.png", "c.png"], ["b.png", "d.png"]]);
    }

    #[test]
    fn what_is_no_photo_is_left_out_and_named() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.png", "b.png", "c.png"] {
            photo(&dir.path().join(name), 8);
        }
        std::fs::write(dir.path().join("d.jpg"), "no photo").unwrap();
        let set = PhotoSet::find(dir.path()).unwrap();
        assert_eq!(set.photos.len(), 3);
        assert!(set.notes[0].contains("d.jpg"), "{:?}", set.notes);
    }

    #[test]
    fn too_few_photos_say_what_to_do() {
        let dir = tempfile::tempdir().unwrap();
        let said = |path: &Path| PhotoSet::find(path).unwrap_err().to_string();
        assert!(said(dir.path()).contains("it holds no photos"));
        photo(&dir.path().join("a.png"), 8);
        assert!(said(dir.path()).contains("only 1 photos; give a folder"));
        std::fs::write(dir.path().join("b.HEIC"), "").unwrap();
        assert!(said(dir.path()).contains("1 HEIC or AVIF files; convert"));
        assert!(said(&dir.path().join("x")).contains("no such folder"));
    }
}
