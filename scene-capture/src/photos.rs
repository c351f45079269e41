//! Which photos there are, and which of them one camera took with one focal length.

use crate::error::CaptureError;
use crate::photo_files::{PhotoFiles, counted};
use exif::{In, Tag};
use image::metadata::Orientation;
use io_colmap::{Listing, PhotoHeader, alike_without_ending};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Endings of videos, in small letters.
pub(crate) const VIDEO_ENDINGS: [&str; 15] = [
    "mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "ts", "mpg", "mpeg", "3gp", "wmv",
    "flv", "ogv",
];
/// Fewer give no scene.
pub(crate) const FEWEST: usize = 3;

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
    /// The photos in `images/`, `input/` or `photos/`, else those in the folder itself, else, or where these are too few, those
    /// in its sub-folders.
    pub(crate) fn find(folder: &Path) -> Result<PhotoSet, CaptureError> {
        if !folder.is_dir() {
            return Err(CaptureError::bad(
                folder,
                "there is no such folder",
                "give a folder of photos or a video file",
            ));
        }
        let PhotoFiles {
            root,
            mut listing,
            heif,
            converted,
            mut notes,
        } = PhotoFiles::find(folder)?;
        notes.extend(listing.notes("photos"));
        let found: Vec<Result<Photo, (String, String)>> = std::mem::take(&mut listing.names)
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
        // Where some were converted, whoever did it chose.
        if photos.len() < FEWEST || (heif.len() > photos.len() && converted == 0) {
            let others = Others {
                listing,
                heif: heif.len(),
                unreadable,
            };
            return Err(too_few(&root, photos.len(), &others));
        }
        if let Some((name, why)) = unreadable.first() {
            notes.push(format!(
                "{} files are no photos that can be used and are left out, such as {name:?} ({why})",
                unreadable.len()
            ));
        }
        if let Some(first) = heif.first() {
            notes.push(format!(
                "{} HEIC or AVIF files are left out, such as {first}; convert them to JPEG to have them taken",
                heif.len()
            ));
        }
        let names = photos.iter().map(|photo| &*photo.name);
        if let Some([first, second]) = alike_without_ending(names) {
            return Err(CaptureError::bad(
                &root,
                format!(
                    "{first} and {second} differ only in their ending, without which results and masks are named"
                ),
                "keep one of the two, and of others like them, or rename them",
            ));
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
    PhotoFiles::find(folder).is_ok_and(|files| {
        files.listing.count() > 0 || !files.listing.closed.is_empty() || !files.heif.is_empty()
    })
}

/// What is in a folder besides its photos.
struct Others {
    /// Without the photos' names.
    listing: Listing,
    /// How many phones took that cannot be read.
    heif: usize,
    /// Names, and why they are no photos that can be used.
    unreadable: Vec<(String, String)>,
}

/// That there are no more than `count` photos.
fn too_few(root: &Path, count: usize, others: &Others) -> CaptureError {
    let Others {
        listing,
        heif,
        unreadable,
    } = others;
    let what = if count == 0 {
        "it holds no photos (JPEG, PNG, WebP or TIFF)".to_owned()
    } else {
        format!("it holds only {}", counted(count))
    };
    let of_phones = || {
        (
            format!("{what}, and {heif} HEIC or AVIF files"),
            "convert those to JPEG first, which a phone also does when it is set to most compatible".to_owned(),
        )
    };
    let (what, remedy) = if *heif > count {
        of_phones()
    } else if !listing.unnamed.is_empty() {
        (
            format!(
                "{what}, and {} whose names are not Unicode",
                listing.unnamed.len()
            ),
            "rename those, or the folders they are in".to_owned(),
        )
    } else if *heif > 0 {
        of_phones()
    } else if let Some((folder, error)) = listing.closed.first() {
        (
            format!(
                "{what}, and its sub-folder {} cannot be read ({error})",
                folder.display()
            ),
            io_colmap::remedy(error).to_owned(),
        )
    } else if let Some((name, why)) = unreadable.first() {
        (
            format!(
                "{what} that can be used, and {} others, such as {name:?} ({why})",
                unreadable.len()
            ),
            "rename or replace those".to_owned(),
        )
    } else {
        (
            what,
            format!("give a folder of at least {FEWEST} photos, better 30, all around the object"),
        )
    };
    CaptureError::bad(root, what, remedy)
}

/// Reads a photo's header and its EXIF; otherwise the name and why not.
fn look(root: &Path, name: String) -> Result<Photo, (String, String)> {
    // COLMAP reads lists of names line by line, and trims the lines.
    if name.trim() != name || name.contains(['\n', '\r']) {
        let why = "its name begins or ends with a blank, or has a line break in it";
        return Err((name, why.to_owned()));
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
    // Where a phone zooms by cutting out, only the last two tell.
    let tags = [
        Tag::Make,
        Tag::Model,
        Tag::LensModel,
        Tag::FocalLength,
        Tag::FocalLengthIn35mmFilm,
        Tag::DigitalZoomRatio,
    ];
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
            photo(&root.join("ignore/left").join(name), 8);
        }
        photo(&root.join("right/1.png"), 8);
        let set = PhotoSet::find(root).unwrap();
        let expected = ["left/1.png", "left/2.PNG", "left/3.jpg", "right/1.png"];
        assert_eq!(names(&set), expected);
        assert_eq!(set.by_camera().len(), 2, "a camera per folder");

        photo(&root.join("a.png"), 8);
        let set = PhotoSet::find(root).unwrap();
        assert_eq!(names(&set), expected, "one is a cover");
        assert!(
            set.notes[0].starts_with("1 photo in ")
                && set.notes[0].contains("the 4 in its sub-folders"),
            "{:?}",
            set.notes
        );

        for name in ["b.png", "c.png", ".d.png"] {
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

    #[cfg(unix)]
    #[test]
    fn only_photos_need_names_in_unicode() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt as _;
        let dir = tempfile::tempdir().unwrap();
        let odd = |name: &[u8]| dir.path().join(OsStr::from_bytes(name));
        let Ok(()) = std::fs::write(odd(b"notes \xe9.txt"), "") else {
            eprintln!("skipped: this disk has no names that are not Unicode");
            return;
        };
        std::fs::create_dir(odd(b"raw \xe9")).unwrap();
        for name in ["a.png", "b.png", "c.png"] {
            photo(&dir.path().join(name), 8);
        }
        let set = PhotoSet::find(dir.path()).unwrap();
        assert_eq!(names(&set), ["a.png", "b.png", "c.png"]);
        assert!(set.notes.is_empty(), "{:?}", set.notes);

        std::fs::copy(odd(b"a.png"), odd(b"d \xe9.png")).unwrap();
        std::fs::copy(odd(b"a.png"), odd(b"raw \xe9/e.png")).unwrap();
        let set = PhotoSet::find(dir.path()).unwrap();
        assert_eq!(set.photos.len(), 3);
        assert!(
            set.notes[0].starts_with("1 photos whose names are not Unicode are left out, such as "),
            "{:?}",
            set.notes
        );

        for name in ["a.png", "b.png", "c.png"] {
            std::fs::remove_file(dir.path().join(name)).unwrap();
        }
        assert!(has_photos(dir.path()));
        let said = PhotoSet::find(dir.path()).unwrap_err().to_string();
        assert!(
            said.contains("it holds no photos (JPEG, PNG, WebP or TIFF), and 1 whose names are not Unicode; rename"),
            "{said}"
        );
    }

    #[cfg(unix)]
    #[test]
    fn a_closed_sub_folder_is_left_out_and_named() {
        use std::os::unix::fs::PermissionsExt as _;
        let dir = tempfile::tempdir().unwrap();
        let closed = dir.path().join("images");
        std::fs::create_dir(&closed).unwrap();
        std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o000)).unwrap();
        if std::fs::read_dir(&closed).is_ok() {
            eprintln!("skipped: this user may read every folder");
            return;
        }
        assert!(has_photos(dir.path()));
        let said = PhotoSet::find(dir.path()).unwrap_err().to_string();
        assert!(said.contains("images cannot be read ("), "{said}");
        for name in ["a.png", "b.png", "c.png"] {
            photo(&dir.path().join(name), 8);
        }
        let set = PhotoSet::find(dir.path()).unwrap();
        assert_eq!(names(&set), ["a.png", "b.png", "c.png"]);
        assert!(
            set.notes[0].contains("images cannot be read and is left out ("),
            "{:?}",
            set.notes
        );
    }

    #[test]
    fn photos_of_phones_are_named_and_refused_where_they_are_most() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.png", "b.png", "c.png"] {
            photo(&dir.path().join("images").join(name), 8);
        }
        let phone = |name: &str| std::fs::write(dir.path().join("images").join(name), "").unwrap();
        for name in ["d.HEIC", "e.HEIC", "f.HEIC"] {
            phone(name);
        }
        let set = PhotoSet::find(dir.path()).unwrap();
        assert_eq!(set.photos.len(), 3);
        assert!(
            set.notes[0].starts_with("3 HEIC or AVIF files are left out, such as d.HEIC; convert"),
            "{:?}",
            set.notes
        );
        phone("g.HEIC");
        let said = PhotoSet::find(dir.path()).unwrap_err().to_string();
        assert!(
            said.contains("it holds only 3 photos, and 4 HEIC or AVIF files; convert"),
            "{said}"
        );
    }

    #[test]
    fn too_few_photos_say_what_to_do() {
        let dir = tempfile::tempdir().unwrap();
        let said = |path: &Path| PhotoSet::find(path).unwrap_err().to_string();
        assert!(said(dir.path()).contains("it holds no photos"));
        photo(&dir.path().join("a.png"), 8);
        assert!(said(dir.path()).contains("only 1 photo; give a folder"));
        std::fs::write(dir.path().join("b.HEIC"), "").unwrap();
        assert!(said(dir.path()).contains("1 HEIC or AVIF files; convert"));
        assert!(said(&dir.path().join("x")).contains("no such folder"));

        let dir = tempfile::tempdir().unwrap();
        for name in [" a.png", "b\nc.png"] {
            photo(&dir.path().join(name), 8);
        }
        let said = said(dir.path());
        assert!(said.contains("2 others, such as \" a.png\""), "{said}");
        assert!(said.contains("begins or ends with a blank") && said.contains("rename"));
    }
}
