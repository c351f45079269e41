//! Finding photos: by the path a file states, by name, or all of a folder.

use crate::error::ImportError;
use io_colmap::{PICTURE_ENDINGS, Search, is_picture};
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

/// How deep sub-folders are searched.
const MAX_DEPTH: usize = 4;

/// The picture at a path that a file in `folder` states: as it is, with its ending in other letters or an ending it
/// lacks, with either kind of slash, and, for absolute paths of another machine, by its last parts.
pub(crate) fn at_path(folder: &Path, stated: &str) -> Option<Match> {
    let label = stated;
    let stated = stated.trim().replace('\\', "/");
    if stated.is_empty() || stated.contains('\0') {
        return None;
    }
    let parts: Vec<&str> = stated.split('/').filter(|part| !part.is_empty()).collect();
    let absolute = stated.starts_with('/') || stated.as_bytes().get(1) == Some(&b':');
    let mut bases = vec![(folder.join(&stated), Fit::EXACT)];
    if absolute {
        let own = own_parts(folder);
        // The scene was moved: images/a.jpg, then a.jpg.
        for count in [2, 1] {
            if let Some(tail) = parts.len().checked_sub(count) {
                let before = parts[..tail].iter().rev().zip(own.iter().rev());
                let agreeing = before.take_while(|(stated, own)| stated.to_lowercase() == **own);
                let fit = Fit {
                    parts: count + agreeing.count(),
                    whole: false,
                    ending: true,
                };
                bases.push((folder.join(parts[tail..].join("/")), fit));
            }
        }
    }
    bases.into_iter().find_map(|(base, fit)| {
        let found = |photo: PathBuf| Match {
            photo,
            stated: label.to_owned(),
            fit,
        };
        if base.is_file() {
            return Some(found(base));
        }
        // Of another machine's folders none is there, and no file in them has to be tried.
        if !base.parent()?.is_dir() {
            return None;
        }
        let name = base.file_name()?.to_str()?.to_owned();
        let stated = name.rsplit_once('.').filter(|_| is_picture(&name));
        let stated = stated.into_iter();
        let lacking = PICTURE_ENDINGS.iter().map(|ending| (&*name, *ending));
        stated
            .chain(lacking)
            .flat_map(|(stem, ending)| spellings(stem, ending))
            .map(|name| base.with_file_name(name))
            .find(|path| path.is_file())
            .map(found)
    })
}

/// A file's name with its ending in all mixtures of small and capital letters, from `jpg` to `JPG`.
///
/// They are tried one by one: to list a large folder for each of many photos that are not there takes longer.
fn spellings(stem: &str, ending: &str) -> impl Iterator<Item = String> {
    let small = ending.to_ascii_lowercase();
    let stem = stem.to_owned();
    (0..1_u32 << small.len()).map(move |capitals| {
        let letters = small.char_indices().map(|(i, letter)| {
            if (capitals >> i) & 1 == 1 {
                letter.to_ascii_uppercase()
            } else {
                letter
            }
        });
        format!("{stem}.{}", letters.collect::<String>())
    })
}

/// A photo, and what it was found by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Match {
    pub(crate) photo: PathBuf,
    /// As the file states it.
    pub(crate) stated: String,
    pub(crate) fit: Fit,
}

impl Match {
    /// A photo that is nobody else's: by its place in a folder, not by name.
    pub(crate) fn by_place(photo: PathBuf) -> Self {
        Self {
            stated: photo.display().to_string(),
            photo,
            fit: Fit::EXACT,
        }
    }

    /// Whether the same path is stated, if two are of one photo.
    pub(crate) fn is_again(&self, other: &Self) -> bool {
        let both_exact = self.fit == Fit::EXACT && other.fit == Fit::EXACT;
        both_exact || plain(&self.stated) == plain(&other.stated)
    }
}

/// How well a stated path fits a photo's; more is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Fit {
    /// How many names at their ends are the same: the photo's and those of folders.
    parts: usize,
    /// No more folders are stated.
    whole: bool,
    /// The ending is the same too.
    ending: bool,
}

impl Fit {
    /// The path leads to the photo and to no other.
    const EXACT: Self = Self {
        parts: usize::MAX,
        whole: true,
        ending: true,
    };
}

/// Why a view has no photo, as the end of a sentence.
type Missing = &'static str;

pub(crate) const NO_PHOTO: Missing = "has no photo";
const SEVERAL: Missing = "has several photos of that name";

/// How to find the photos that a file names by their paths.
#[derive(Debug)]
pub(crate) enum Lookup<'a> {
    /// From this folder.
    From(&'a Path),
    /// By name, in the folder that the user stated.
    Named(ByName),
}

impl<'a> Lookup<'a> {
    pub(crate) fn new(root: &'a Path, stated: Option<&Path>) -> Result<Self, ImportError> {
        Ok(match stated {
            Some(folder) => Lookup::Named(ByName::below(root, Some(folder))?),
            None => Lookup::From(root),
        })
    }

    /// What of the folder could not be looked at, a sentence each.
    pub(crate) fn left_out(&self) -> &[String] {
        match self {
            Lookup::From(_) => &[],
            Lookup::Named(photos) => photos.left_out(),
        }
    }

    pub(crate) fn find(&self, path: &str) -> Result<Match, Missing> {
        match self {
            Lookup::From(root) => at_path(root, path).ok_or(NO_PHOTO),
            Lookup::Named(photos) => photos.find(path),
        }
    }
}

/// The pictures directly in a folder, sorted by name as Python's `sorted` and most loaders do.
pub(crate) fn in_folder(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            is_picture(&name) && !name.starts_with('.') && path.is_file()
        })
        .collect();
    all.sort();
    all
}

/// The first of these folders that there is; the one the user named before all others.
pub(crate) fn first_folder(root: &Path, stated: Option<&Path>, usual: &[&str]) -> Option<PathBuf> {
    match stated {
        Some(folder) => Some(folder.to_path_buf()),
        None => usual
            .iter()
            .map(|name| root.join(name))
            .find(|folder| !in_folder(folder).is_empty()),
    }
}

/// Photos by name, for files that do not say where they are.
#[derive(Debug)]
pub(crate) struct ByName {
    /// By the ends of their paths, with and without ending, in small letters: `left/a.jpg`, `left/a`, `a.jpg`, `a`.
    /// `None` where two photos share it.
    paths: HashMap<String, Option<PathBuf>>,
    /// What was left out, a sentence each.
    left_out: Vec<String>,
}

impl ByName {
    /// Everything below the folder the user named, else below `images/` or the scene itself.
    pub(crate) fn below(root: &Path, stated: Option<&Path>) -> Result<ByName, ImportError> {
        let usual = root.join("images");
        let folder = match stated {
            Some(folder) => folder,
            None if usual.is_dir() => &usual,
            None => root,
        };
        let search = Search {
            depth: MAX_DEPTH,
            endings: &PICTURE_ENDINGS,
            mask_folders: false,
        };
        let listing = search
            .list(folder)
            .map_err(|e| ImportError::io("list", folder, e))?;
        let mut paths: HashMap<String, Option<PathBuf>> = HashMap::new();
        // Its own name may be stated too: `left/a.jpg`, and the user named `left`.
        let own = own_parts(folder).join("/");
        for name in &listing.names {
            for end in ends(&format!("{own}/{name}")) {
                for key in with_and_without_ending(&end) {
                    paths
                        .entry(key.to_owned())
                        .and_modify(|known| *known = None)
                        .or_insert_with(|| Some(folder.join(name)));
                }
            }
        }
        Ok(ByName {
            paths,
            left_out: listing.notes("photos"),
        })
    }

    /// What of the folder could not be looked at, a sentence each.
    pub(crate) fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// The photo with this name, with or without ending, whatever the case. Folders before it decide between photos of
    /// one name, the more of them the better; where none fits, as in a scene that was moved, the name does alone.
    pub(crate) fn find(&self, label: &str) -> Result<Match, Missing> {
        for end in ends(label) {
            // A label may have lost its ending or got another one by conversion.
            let known = with_and_without_ending(&end).find_map(|key| self.paths.get(key));
            if let Some(photo) = known {
                // With fewer folders there would be even more of them.
                let photo = photo.clone().ok_or(SEVERAL)?;
                let name = photo.file_name().unwrap_or_default().to_string_lossy();
                let fit = Fit {
                    parts: end.split('/').count(),
                    whole: end == plain(label),
                    ending: plain(&name) == end.rsplit('/').next().unwrap_or_default(),
                };
                return Ok(Match {
                    photo,
                    stated: label.to_owned(),
                    fit,
                });
            }
        }
        Err(NO_PHOTO)
    }
}

/// The names of a folder and of those that it is in, in small letters; none where it cannot be asked.
fn own_parts(folder: &Path) -> Vec<String> {
    let whole = folder.canonicalize().unwrap_or_default();
    let names = whole.components().filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_string_lossy().to_lowercase()),
        _ => None,
    });
    names.collect()
}

/// A stated path in small letters, with one kind of slash.
fn plain(path: &str) -> String {
    let path = path.replace('\\', "/").to_lowercase();
    let parts = path
        .split('/')
        .filter(|part| !part.is_empty() && *part != ".");
    parts.collect::<Vec<_>>().join("/")
}

/// The ends of a path in small letters, from all of it to its name alone.
fn ends(path: &str) -> Vec<String> {
    let path = plain(path);
    let parts: Vec<&str> = path.split('/').filter(|part| !part.is_empty()).collect();
    (parts.len().saturating_sub(MAX_DEPTH + 1)..parts.len())
        .map(|from| parts[from..].join("/"))
        .collect()
}

fn with_and_without_ending(end: &str) -> impl Iterator<Item = &str> {
    let parted = end.rsplit_once('.');
    let stem = parted.filter(|(_, ending)| !ending.contains('/'));
    std::iter::once(end).chain(stem.map(|(stem, _)| stem))
}

/// The size of a photo as it is stored.
pub(crate) fn stored_size(path: &Path) -> Result<(u32, u32), ImportError> {
    Ok(io_colmap::PhotoHeader::read(path)?.stored)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn photos_are_found_however_their_paths_are_written() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("images/mask")).unwrap();
        let photo = dir.path().join("images/r_0.PNG");
        std::fs::write(&photo, "").unwrap();
        std::fs::write(dir.path().join("images/mask/r_0.PNG"), "").unwrap();
        for stated in [
            "images/r_0.PNG",
            "./images/r_0.PNG",
            "./images/r_0",
            "images\\r_0.PNG",
            "C:\\work\\images\\r_0.PNG",
            "/home/x/images/r_0",
        ] {
            let found = at_path(dir.path(), stated).unwrap_or_else(|| panic!("{stated}"));
            let found = found.photo.canonicalize().unwrap();
            assert_eq!(found, photo.canonicalize().unwrap());
        }
        for stated in ["", "images", "images/r_1", "\0", "/"] {
            assert_eq!(at_path(dir.path(), stated), None, "{stated:?}");
        }
        for (file, stated) in [
            ("a.Jpg", "images/a"),
            ("b.Jpeg", "images/b"),
            ("c.jPG", "images/c.jpg"),
            ("d.jpg", "/home/x/images/d.JPG"),
        ] {
            let photo = dir.path().join("images").join(file);
            std::fs::write(&photo, "").unwrap();
            // Where case does not count, the path is found as it is stated.
            let found = at_path(dir.path(), stated).unwrap_or_else(|| panic!("{stated}"));
            let found = found.photo.canonicalize().unwrap();
            assert_eq!(found, photo.canonicalize().unwrap());
        }
        let names = ByName::below(dir.path(), None).unwrap();
        for label in ["r_0", "R_0.png", "r_0.jpg", "x/r_0.tif"] {
            let found = names.find(label).map(|found| found.photo);
            assert_eq!(found.as_ref(), Ok(&photo), "{label}");
        }
        assert_eq!(names.find("r_1"), Err(NO_PHOTO));
    }
}
