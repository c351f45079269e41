//! Folders that appear in one piece, and files ([`write_file`]).
//!
//! A [`Draft`] lies beside its place, on the same disk, and is renamed when it is complete. One that is dropped
//! before that is gone, and so are those of a program that calls [`abandon_all`] when it is told to end; of one whose program
//! was killed, a folder whose name starts with [`PREFIX`] remains. Where that is in the way, an [`Occupant`] names it.
//!
//! An empty folder gives way to it, unless it is one that has to stay, such as the one a shell is in or one that a disk
//! is mounted on: there the draft lies in its place, and what is in it moves up.

mod file;
mod moving;
mod occupant;
mod open;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

pub use file::{Durability, write_file};
use moving::{entries, is_elsewhere, move_all};
pub use occupant::Occupant;
use open::Open;
pub use open::abandon_all;
use tempfile::TempDir;

/// Start of the names of folders and files that are being written.
pub const PREFIX: &str = ".sos-partial-";

/// What to do with what an earlier run of a program has left in a place.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Existing {
    /// Refuse.
    #[default]
    Keep,
    /// Put the new in its place. Folders of other origin are never replaced.
    Replace,
}

/// A folder in the making. It is gone if it is dropped before it is finished.
#[derive(Debug)]
pub struct Draft {
    folder: TempDir,
    /// Lists it for [`abandon_all`] as long as it lasts.
    _open: Open,
    /// As it was stated, which is how messages call it.
    place: PathBuf,
    /// The place behind all links.
    target: PathBuf,
    /// Whether the folder lies in its place, as that cannot be removed and made again.
    is_inside: bool,
}

/// What went wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}: {source}; {}", path.display(), self.remedy())]
pub struct DraftError {
    /// What was to be done, as in "create" or "remove".
    pub action: &'static str,
    /// With which file or folder.
    pub path: PathBuf,
    /// Why it could not be done.
    pub source: io::Error,
}

impl DraftError {
    /// What to do.
    #[must_use]
    pub fn remedy(&self) -> &'static str {
        match self.source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space",
            io::ErrorKind::IsADirectory => "choose another file",
            _ => "choose a folder that can be written to",
        }
    }
}

impl Draft {
    /// An empty folder beside `place`, whose parents are made if need be.
    ///
    /// Where the folder that is there has to stay, the empty one lies in it: where this program works in it, another
    /// disk begins at it, or nothing can be written beside it.
    ///
    /// # Errors
    /// When nothing can be written there, or something other than a folder is there.
    pub fn beside(place: &Path) -> Result<Self, DraftError> {
        // A working folder that is gone is none to keep.
        let working = std::env::current_dir().and_then(fs::canonicalize).ok();
        Self::begin(place, working.as_deref())
    }

    fn begin(stated: &Path, working: Option<&Path>) -> Result<Self, DraftError> {
        // Without a slash at the end, which would hide a link.
        let place = stated.components().as_path();
        let there = place.canonicalize().ok();
        let in_the_way = match &there {
            Some(there) if there.is_dir() => None,
            Some(_) => Some("a file is there"),
            None => place
                .is_symlink()
                .then_some("a link that leads nowhere is there"),
        };
        if let Some(what) = in_the_way {
            let error = io::Error::new(io::ErrorKind::AlreadyExists, what);
            return Err(failed("create", stated)(error));
        }
        let draft = |folder: TempDir, target: &Path, is_inside| Self {
            _open: Open::new(folder.path()),
            folder,
            place: stated.to_owned(),
            target: target.to_owned(),
            is_inside,
        };
        let Some(there) = there else {
            let folder = empty_folder_in(parent(place))?;
            return Ok(draft(folder, place, false));
        };
        if let Some(working) = working.filter(|working| working.starts_with(&there)) {
            // From further down, a path with `..` would lead elsewhere once the working folder is moved aside.
            let target = if working == there { place } else { &*there };
            return Ok(draft(empty_folder_in(target)?, target, true));
        }
        let is_alias = place.is_symlink() || place.file_name().is_none();
        let target = if is_alias { &*there } else { place };
        match empty_folder_in(parent(target)) {
            Ok(folder) if !is_elsewhere(target, folder.path()) => Ok(draft(folder, target, false)),
            _ => Ok(draft(empty_folder_in(target)?, target, true)),
        }
    }

    /// The folder to write into.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Where it will be.
    #[must_use]
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Puts the folder in its place, where there must be nothing or an empty folder.
    ///
    /// # Errors
    /// When something is there; it stays as it is.
    pub fn finish(self) -> Result<(), DraftError> {
        let _placing = open::placing();
        self.put()
    }

    fn put(self) -> Result<(), DraftError> {
        if !self.is_inside {
            // An empty folder gives way as it is, also where a system would not rename onto it.
            let _ = fs::remove_dir(&self.target);
            match fs::rename(self.folder.path(), &self.target) {
                Ok(()) => {
                    self.leave();
                    return Ok(());
                }
                // One that somebody else holds on to stays, and is filled.
                Err(_) if self.others().is_ok_and(|others| others.is_empty()) => {}
                Err(error) => return Err(failed("create", &self.place)(error)),
            }
        }
        self.move_up().map_err(failed("create", &self.place))
    }

    /// Puts the folder in its place and removes what was there.
    ///
    /// # Errors
    /// When that cannot be moved aside, or the folder cannot take its place: then what was there is back. When what was
    /// there cannot be removed afterwards, the folder is in its place already.
    pub fn replace(self) -> Result<(), DraftError> {
        let _placing = open::placing();
        if self.is_inside {
            return self.replace_content();
        }
        let _ = fs::remove_dir(&self.target);
        if !self.target.exists() || self.others().is_ok_and(|others| others.is_empty()) {
            return self.put();
        }
        let old = self.aside();
        fs::rename(&self.target, &old).map_err(failed("replace", &self.place))?;
        if let Err(error) = fs::rename(self.folder.path(), &self.target) {
            // The error that is on its way says more than one from going back.
            let _ = fs::rename(&old, &self.target);
            return Err(failed("create", &self.place)(error));
        }
        self.leave();
        fs::remove_dir_all(&old).map_err(failed("remove", &old))
    }

    /// The same with what is in the folders.
    fn replace_content(self) -> Result<(), DraftError> {
        let failed_to = |action| failed(action, &self.place);
        let others = self.others().map_err(failed_to("replace"))?;
        if others.is_empty() {
            return self.put();
        }
        let old = self.aside();
        fs::create_dir(&old).map_err(failed_to("replace"))?;
        let moved = move_all(&others, &old)
            .map_err(failed_to("replace"))
            .and_then(|()| {
                self.move_up().map_err(|error| {
                    let back = entries(&old, &[]).unwrap_or_default();
                    let _ = move_all(&back, &self.target);
                    failed_to("create")(error)
                })
            });
        if moved.is_err() {
            // Refused unless what was there is back.
            let _ = fs::remove_dir(&old);
            return moved;
        }
        fs::remove_dir_all(&old).map_err(failed("remove", &old))
    }

    /// Moves what is in the folder into its place, where nothing else may be.
    fn move_up(&self) -> io::Result<()> {
        if !self.others()?.is_empty() {
            return Err(io::ErrorKind::DirectoryNotEmpty.into());
        }
        move_all(&entries(self.folder.path(), &[])?, &self.target)
    }

    /// What is in the place, apart from what is put there on the way.
    fn others(&self) -> io::Result<Vec<PathBuf>> {
        entries(&self.target, &[self.folder.path(), &self.aside()])
    }

    /// Where what was in the place is until it is removed.
    fn aside(&self) -> PathBuf {
        self.folder.path().with_extension("old")
    }

    /// There is nothing left to remove at the temporary name.
    fn leave(self) {
        let _ = self.folder.keep();
    }
}

/// The folder that a path is in.
fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn empty_folder_in(parent: &Path) -> Result<TempDir, DraftError> {
    fs::create_dir_all(parent).map_err(failed("create", parent))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    {
        // As for any new folder: what the user's umask leaves of it, not the private 0700.
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    builder
        .tempdir_in(parent)
        .map_err(failed("write to", parent))
}

fn failed(action: &'static str, path: &Path) -> impl Fn(io::Error) -> DraftError {
    let path = path.to_owned();
    move |source| DraftError {
        action,
        path: path.clone(),
        source,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn draft(place: &Path, file: &str) -> Draft {
        let draft = Draft::beside(place).unwrap();
        fs::write(draft.path().join(file), "").unwrap();
        draft
    }

    #[test]
    fn a_draft_is_seen_when_it_is_finished_and_gone_when_it_is_not() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().join("a/b");
        let unfinished = draft(&place, "file");
        assert!(!place.exists());
        let name = names(&root.path().join("a"));
        assert!(name.len() == 1 && name[0].starts_with(PREFIX), "{name:?}");
        drop(unfinished);
        assert!(names(&root.path().join("a")).is_empty());
        draft(&place, "file").finish().unwrap();
        assert_eq!(names(&place), ["file"]);
    }

    #[test]
    fn only_an_empty_folder_gives_way_unasked() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().join("out");
        fs::create_dir(&place).unwrap();
        draft(&place, "first").finish().unwrap();
        let error = draft(&place, "second").finish().unwrap_err();
        assert!(error.to_string().starts_with("cannot create "), "{error}");
        assert_eq!(names(&place), ["first"]);
        assert_eq!(names(root.path()), ["out"]);
        draft(&place, "second").replace().unwrap();
        assert_eq!(names(&place), ["second"]);
        assert_eq!(names(root.path()), ["out"]);
    }

    #[test]
    fn a_folder_that_is_worked_in_stays() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().canonicalize().unwrap().join("out");
        fs::create_dir_all(place.join("deep")).unwrap();
        let draft = |file: &str| {
            let draft = Draft::begin(&place, Some(&place.join("deep"))).unwrap();
            fs::write(draft.path().join(file), "").unwrap();
            fs::create_dir(draft.path().join("folder")).unwrap();
            draft
        };
        let error = draft("first").finish().unwrap_err();
        assert!(error.to_string().contains("not empty"), "{error}");
        assert_eq!(names(&place), ["deep"]);
        fs::remove_dir(place.join("deep")).unwrap();
        let unfinished = draft("first");
        assert!(names(&place)[0].starts_with(PREFIX));
        drop(unfinished);
        #[cfg(unix)]
        let is_kept = {
            use std::os::unix::fs::MetadataExt as _;
            let inode = |place: &Path| fs::metadata(place).unwrap().ino();
            let before = inode(&place);
            move |place: &Path| inode(place) == before
        };
        draft("first").finish().unwrap();
        assert_eq!(names(&place), ["first", "folder"]);
        draft("second").finish().unwrap_err();
        assert_eq!(names(&place), ["first", "folder"]);
        draft("second").replace().unwrap();
        assert_eq!(names(&place), ["folder", "second"]);
        assert_eq!(names(root.path()), ["out"]);
        #[cfg(unix)]
        assert!(is_kept(&place), "it is the same folder");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_its_folder_is_filled() {
        let root = tempfile::tempdir().unwrap();
        let (real, link) = (root.path().join("real"), root.path().join("link"));
        fs::create_dir(&real).unwrap();
        std::os::unix::fs::symlink("real", &link).unwrap();
        draft(&link, "first").finish().unwrap();
        assert_eq!(names(&real), ["first"]);
        draft(&root.path().join("link/"), "second")
            .replace()
            .unwrap();
        assert_eq!(names(&real), ["second"]);
        assert!(link.is_symlink());
        assert_eq!(names(root.path()), ["link", "real"]);
    }

    #[test]
    fn what_is_no_folder_is_in_the_way_from_the_start() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().join("out");
        let said = || Draft::beside(&place).unwrap_err().to_string();
        fs::write(&place, "").unwrap();
        assert!(
            said().contains("out: a file is there; choose"),
            "{}",
            said()
        );
        #[cfg(unix)]
        {
            fs::remove_file(&place).unwrap();
            std::os::unix::fs::symlink("gone", &place).unwrap();
            assert!(said().contains("leads nowhere"), "{}", said());
        }
        assert_eq!(names(root.path()), ["out"]);
    }

    #[test]
    fn what_cannot_be_written_is_named() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        fs::write(&file, "").unwrap();
        let error = Draft::beside(&file.join("out")).unwrap_err();
        assert!(error.to_string().contains("file"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_is_as_open_as_any_other() {
        use std::os::unix::fs::PermissionsExt as _;
        let root = tempfile::tempdir().unwrap();
        let (place, other) = (root.path().join("out"), root.path().join("other"));
        draft(&place, "file").finish().unwrap();
        fs::create_dir(&other).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&place), mode(&other));
    }
}
