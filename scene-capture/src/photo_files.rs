//! Which files of a folder are its photos.

use crate::error::CaptureError;
use crate::photos::FEWEST;
use io_colmap::{Listing, PhotoHeader, Search, same_shape, without_ending};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Endings of photos, in small letters. OpenEXR is left out: COLMAP 3 does not read it.
const PHOTO_ENDINGS: [&str; 6] = ["jpg", "jpeg", "png", "webp", "tif", "tiff"];
/// What phones take and COLMAP does not read.
const HEIF_ENDINGS: [&str; 3] = ["heic", "heif", "avif"];
/// Sub-folders that hold the photos, where a folder has one of them.
const PHOTO_FOLDERS: [&str; 3] = ["images", "input", "photos"];
/// Where photos are looked for in a folder.
const PHOTOS: Search<'static> = Search {
    depth: 4,
    endings: &PHOTO_ENDINGS,
    mask_folders: false,
};
/// What phones take, in the same places.
const HEIF: Search<'static> = Search {
    endings: &HEIF_ENDINGS,
    ..PHOTOS
};

/// The files of photos, by name.
#[derive(Debug, Default)]
pub(crate) struct PhotoFiles {
    /// The folder that the photos are in.
    pub(crate) root: PathBuf,
    /// What is in it.
    pub(crate) listing: Listing,
    /// What phones have taken in the same places, without those that were converted: a photo bears their name.
    pub(crate) heif: Vec<String>,
    /// How many of those have been converted.
    pub(crate) converted: usize,
    /// What was left out.
    pub(crate) notes: Vec<String>,
}

impl PhotoFiles {
    /// Those in `images/`, `input/` or `photos/`, else those in the folder itself, else, or where these are too few, those
    /// in its sub-folders.
    pub(crate) fn find(folder: &Path) -> Result<Self, CaptureError> {
        let mut of_phones = None;
        for name in PHOTO_FOLDERS {
            let inner = folder.join(name);
            if inner.is_dir() {
                // One that cannot be read is named with the other sub-folders.
                let mut files = Self {
                    listing: PHOTOS.list(&inner).unwrap_or_default(),
                    heif: HEIF.list(&inner).unwrap_or_default().names,
                    root: inner,
                    ..Self::default()
                };
                if files.listing.count() > 0 {
                    files.leave_out_copies();
                    return Ok(files.without_converted());
                }
                if !files.heif.is_empty() {
                    of_phones.get_or_insert(files);
                }
            }
        }
        let listed = PHOTOS
            .list(folder)
            .and_then(|all| Ok((all, HEIF.list(folder)?)));
        let (listing, heif) = listed.map_err(|e| CaptureError::io("list", folder, e))?;
        let files = Self {
            root: folder.to_path_buf(),
            listing,
            heif: heif.names,
            ..Self::default()
        };
        let files = files.of_one_depth().without_converted();
        // What was converted may lie beside what it was made of, and else there is nothing but that.
        Ok(match of_phones {
            Some(of_phones) if files.listing.count() == 0 => of_phones,
            _ => files,
        })
    }

    /// Those in the folder itself, or those in its sub-folders.
    fn of_one_depth(mut self) -> Self {
        let (folder, all) = (&self.root, &mut self.listing);
        let is_unnamed_direct = |path: &PathBuf| path.parent() == Some(folder);
        let direct = all.names.iter().filter(|name| is_direct(name)).count();
        let nested = all.names.len() - direct;
        let place = folder.display();
        if direct > 0 && direct < FEWEST && nested >= FEWEST {
            // A cover, or a photo of the place.
            all.names.retain(|name| !is_direct(name));
            self.heif.retain(|name| !is_direct(name));
            self.notes.push(format!(
                "{} in {place} itself {} left out; the {nested} in its sub-folders are taken",
                counted(direct),
                if direct == 1 { "is" } else { "are" },
            ));
        } else if direct > 0 || all.unnamed.iter().any(is_unnamed_direct) {
            all.names.retain(|name| is_direct(name));
            all.unnamed.retain(is_unnamed_direct);
            self.heif.retain(|name| is_direct(name));
            if nested > 0 {
                self.notes.push(format!(
                    "{} in sub-folders of {place} {} left out; the {direct} in it are taken",
                    counted(nested),
                    if nested == 1 { "is" } else { "are" },
                ));
            }
        }
        self
    }

    /// Leaves out sub-folders in which every photo bears the name of one beside them, and the first is a smaller picture of
    /// the same shape, as in `images/small/`. Further cameras and walks may have the same numbers.
    fn leave_out_copies(&mut self) {
        let bare = |name: &str| {
            let name = name.rsplit('/').next().unwrap_or_default();
            without_ending(name).to_lowercase()
        };
        let names = &mut self.listing.names;
        let direct = names.iter().filter(|name| is_direct(name));
        let direct: HashMap<String, &String> = direct.map(|name| (bare(name), name)).collect();
        let mut folders: BTreeMap<String, (usize, bool)> = BTreeMap::new();
        for name in names.iter() {
            if let Some((folder, _)) = name.rsplit_once('/') {
                let original = direct.get(&bare(name));
                let is_smaller = || {
                    let [copy, original] = [name, original?].map(|name| self.root.join(name));
                    Some(is_reduced(&copy, &original))
                };
                let (count, are_copies) = folders
                    .entry(folder.to_owned())
                    .or_insert_with(|| (0, is_smaller() == Some(true)));
                *count += 1;
                *are_copies &= original.is_some();
            }
        }
        folders.retain(|_, (_, are_copies)| *are_copies);
        names.retain(|name| {
            let folder = name.rsplit_once('/').map(|(folder, _)| folder);
            folder.is_none_or(|folder| !folders.contains_key(folder))
        });
        for (folder, (count, _)) in folders {
            self.notes.push(format!(
                "{} in {} {} left out, as {} named like those in {}; put these into a sub-folder too to have all taken",
                counted(count),
                self.root.join(folder).display(),
                if count == 1 { "is" } else { "are" },
                if count == 1 { "it is" } else { "they are" },
                self.root.display()
            ));
        }
    }

    fn without_converted(mut self) -> Self {
        // Converters keep the ending, as in `a.HEIC.jpg`, and put what they make elsewhere.
        let bare = |name: &String| {
            let file = name.rsplit('/').next().unwrap_or_default();
            let file = without_ending(file).to_lowercase();
            let ending = HEIF_ENDINGS
                .iter()
                .find_map(|ending| file.strip_suffix(ending));
            let stem = ending
                .and_then(|stem| stem.strip_suffix('.'))
                .map(str::to_owned);
            stem.unwrap_or(file)
        };
        let photos: HashSet<String> = self.listing.names.iter().map(bare).collect();
        let all = self.heif.len();
        self.heif.retain(|name| !photos.contains(&bare(name)));
        self.converted = all - self.heif.len();
        self
    }
}

/// Whether a picture is smaller than another, and of its shape.
fn is_reduced(copy: &Path, original: &Path) -> bool {
    let [copy, original] =
        [copy, original].map(|path| PhotoHeader::read(path).ok().map(|header| header.stored));
    copy.zip(original).is_some_and(|(copy, original)| {
        copy.0 < original.0 && copy.1 < original.1 && same_shape(copy, original)
    })
}

/// Whether a file is in the folder itself.
fn is_direct(name: &str) -> bool {
    !name.contains('/')
}

pub(crate) fn counted(photos: usize) -> String {
    format!("{photos} photo{}", if photos == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn files(names: &[&str]) -> (tempfile::TempDir, PhotoFiles) {
        let dir = tempfile::tempdir().unwrap();
        for name in names {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let found = PhotoFiles::find(dir.path()).unwrap();
        (dir, found)
    }

    #[test]
    fn copies_of_photos_are_no_photos_but_a_rig_has_some_in_each_folder() {
        let dir = tempfile::tempdir().unwrap();
        for (name, side) in [
            ("a.png", 16),
            ("b.png", 16),
            ("small/A.png", 8),
            ("small/b.png", 8),
            ("second/a.png", 16),
            ("second/b.png", 16),
            ("more/a.png", 8),
            ("more/c.png", 8),
        ] {
            let path = dir.path().join("images").join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            image::GrayImage::new(2 * side, side).save(path).unwrap();
        }
        let found = PhotoFiles::find(dir.path()).unwrap();
        let expected = [
            "a.png",
            "b.png",
            "more/a.png",
            "more/c.png",
            "second/a.png",
            "second/b.png",
        ];
        assert_eq!(found.listing.names, expected);
        let [note] = &*found.notes else {
            panic!("{:?}", found.notes);
        };
        assert!(note.starts_with("2 photos in ") && note.contains("small are left out, as they"));

        let rig = ["images/cam0/1.jpg", "images/cam1/1.jpg"];
        let (_dir, found) = files(&rig);
        assert_eq!(found.listing.names, ["cam0/1.jpg", "cam1/1.jpg"]);
        assert!(found.notes.is_empty());
    }

    #[test]
    fn what_phones_take_is_found_where_photos_are_unless_it_was_converted() {
        let heif = |names: &[&str]| files(names).1.heif;
        let beside = ["a.jpg", "IMG_1.HEIC", "IMG_2.heic", "img_2.JPG"];
        assert_eq!(heif(&beside), ["IMG_1.HEIC"]);
        let nested = [
            "images/l/a.jpg",
            "images/l/b.avif",
            "images/l/r/c.heif",
            "d.heic",
        ];
        assert_eq!(heif(&nested), ["l/b.avif", "l/r/c.heif"]);
        assert_eq!(heif(&["a.jpg", "b.jpg", "c.jpg", "old/d.heic"]), [""; 0]);
        // What was converted is taken, wherever it was put.
        assert_eq!(heif(&["a.jpg", "b.jpg", "images/c.heic"]), [""; 0]);
        assert_eq!(heif(&["images/c.heic"]), ["c.heic"]);
        assert_eq!(heif(&["images/A.heic.jpg", "images/heic/a.HEIC"]), [""; 0]);
    }
}
