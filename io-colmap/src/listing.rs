//! What is in a folder and its sub-folders, and what of it cannot be named or read.

use std::io;
use std::path::{Path, PathBuf};

/// The folder of a scene with pictures of what is not to be learned from.
pub const IGNORE_FOLDER: &str = "ignore";

/// Which files of a folder are listed.
#[derive(Debug, Clone, Copy)]
pub struct Search<'a> {
    /// How deep sub-folders are searched; 0 for none.
    pub depth: usize,
    /// Endings of the files, in small letters.
    pub endings: &'a [&'a str],
    /// Whether to search sub-folders with "mask" in their names, and [`IGNORE_FOLDER`]: what is in them bears the names
    /// of photos.
    pub mask_folders: bool,
}

/// The files with some endings in a folder. Hidden files and folders are not listed.
#[derive(Debug, Default)]
pub struct Listing {
    /// Paths below the folder, with `/` between folders, sorted.
    pub names: Vec<String>,
    /// Files whose paths are not Unicode, which no list of names can hold.
    pub unnamed: Vec<PathBuf>,
    /// Sub-folders that cannot be read, and why.
    pub closed: Vec<(PathBuf, io::Error)>,
}

impl Search<'_> {
    /// Lists a folder; one sub-folder that cannot be read, such as the `lost+found` of a disk, is no reason to do
    /// without all others.
    ///
    /// # Errors
    /// Where the folder itself cannot be read.
    pub fn list(&self, folder: &Path) -> io::Result<Listing> {
        let mut listing = Listing::default();
        self.add(&mut listing, folder, Some(""), self.depth)?;
        listing.names.sort();
        listing.unnamed.sort();
        listing.closed.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(listing)
    }

    /// `prefix` is what names in the folder begin with; `None` where that is not Unicode.
    fn add(
        &self,
        listing: &mut Listing,
        folder: &Path,
        prefix: Option<&str>,
        depth: usize,
    ) -> io::Result<()> {
        for entry in std::fs::read_dir(folder)? {
            let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
            let shown = name.to_string_lossy();
            if shown.starts_with('.') {
                continue;
            }
            let full = prefix
                .zip(name.to_str())
                .map(|(prefix, name)| format!("{prefix}{name}"));
            if path.is_dir() {
                if depth > 0 && (self.mask_folders || !is_of_masks(&shown)) {
                    let inner = full.map(|full| format!("{full}/"));
                    if let Err(error) = self.add(listing, &path, inner.as_deref(), depth - 1) {
                        listing.closed.push((path, error));
                    }
                }
            } else if let Some((_, ending)) = shown.rsplit_once('.')
                && self.endings.contains(&&*ending.to_ascii_lowercase())
            {
                match full {
                    Some(full) => listing.names.push(full),
                    None => listing.unnamed.push(path),
                }
            }
        }
        Ok(())
    }
}

/// Whether a sub-folder of that name holds pictures about photos, and no photos.
fn is_of_masks(name: &str) -> bool {
    let name = name.to_lowercase();
    name.contains("mask") || name == IGNORE_FOLDER
}

impl Listing {
    /// How many files there are, by whatever name.
    #[must_use]
    pub fn count(&self) -> usize {
        self.names.len() + self.unnamed.len()
    }

    /// What is missing of the names, a sentence each. `files` is what they are, as in "photos".
    #[must_use]
    pub fn notes(&self, files: &str) -> Vec<String> {
        let unnamed = self.unnamed.first().map(|first| {
            format!(
                "{} {files} whose names are not Unicode are left out, such as {}; rename them to have them taken",
                self.unnamed.len(),
                first.display()
            )
        });
        let closed = self.closed.iter().map(|(folder, error)| {
            format!(
                "the sub-folder {} cannot be read and is left out ({error})",
                folder.display()
            )
        });
        unnamed.into_iter().chain(closed).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn files_are_listed_by_ending_and_depth() {
        let dir = tempfile::tempdir().unwrap();
        for name in [
            "b/c/d.PNG",
            "b/a.Jpg",
            "masks/a.jpg",
            "b/Ignore/a.jpg",
            "ignore/a.jpg",
            "ignored/a.jpg",
            "z.txt",
            ".a.jpg",
            "a.jpg",
        ] {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let list = |folder: &Path, depth, mask_folders| {
            let search = Search {
                depth,
                endings: &["jpg", "png"],
                mask_folders,
            };
            search.list(folder).unwrap().names
        };
        let names = |depth, mask_folders| list(dir.path(), depth, mask_folders);
        assert_eq!(names(0, true), ["a.jpg"]);
        assert_eq!(names(1, false), ["a.jpg", "b/a.Jpg", "ignored/a.jpg"]);
        assert_eq!(
            names(2, false),
            ["a.jpg", "b/a.Jpg", "b/c/d.PNG", "ignored/a.jpg"]
        );
        assert_eq!(
            names(2, true),
            [
                "a.jpg",
                "b/Ignore/a.jpg",
                "b/a.Jpg",
                "b/c/d.PNG",
                "ignore/a.jpg",
                "ignored/a.jpg",
                "masks/a.jpg"
            ]
        );
        // Whoever names the folder itself wants what is in it.
        assert_eq!(list(&dir.path().join("ignore"), 1, false), ["a.jpg"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_closed_sub_folder_is_left_out_and_named() {
        use std::os::unix::fs::PermissionsExt as _;
        let dir = tempfile::tempdir().unwrap();
        let closed = dir.path().join("lost+found");
        std::fs::create_dir(&closed).unwrap();
        std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o000)).unwrap();
        if std::fs::read_dir(&closed).is_ok() {
            eprintln!("skipped: this user may read every folder");
            return;
        }
        std::fs::write(dir.path().join("a.png"), "").unwrap();
        let search = Search {
            depth: 1,
            endings: &["png"],
            mask_folders: false,
        };
        let listing = search.list(dir.path()).unwrap();
        assert_eq!(listing.names, ["a.png"]);
        let notes = listing.notes("photos");
        assert!(
            notes[0].contains("lost+found cannot be read and is left out ("),
            "{notes:?}"
        );
        assert!(search.list(&closed).is_err());
        // So that it can be removed.
        std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o700)).unwrap();
    }
}
