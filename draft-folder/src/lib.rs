//! Folders that appear in one piece.
//!
//! A [`Draft`] lies beside its place, on the same disk, and is renamed when it is complete. One that is dropped
//! before that is gone; of one whose program was killed, a folder whose name starts with [`PREFIX`] remains.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// Start of the names of folders that are being written.
pub const PREFIX: &str = ".sos-partial-";

/// A folder in the making. It is gone if it is dropped before it is finished.
#[derive(Debug)]
pub struct Draft {
    folder: TempDir,
    place: PathBuf,
}

/// What went wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}: {source}; {}", path.display(), remedy(source))]
pub struct DraftError {
    /// What was to be done, as in "create" or "remove".
    pub action: &'static str,
    /// With which file or folder.
    pub path: PathBuf,
    /// Why it could not be done.
    pub source: io::Error,
}

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space",
        _ => "choose a folder that can be written to",
    }
}

impl Draft {
    /// An empty folder beside `place`, whose parents are made if need be.
    ///
    /// # Errors
    /// When nothing can be written there.
    pub fn beside(place: &Path) -> Result<Self, DraftError> {
        let parent = match place.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        fs::create_dir_all(parent).map_err(failed("create", parent))?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        #[cfg(unix)]
        {
            // As for any new folder: what the user's umask leaves of it, not the private 0700.
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(fs::Permissions::from_mode(0o777));
        }
        let folder = builder
            .tempdir_in(parent)
            .map_err(failed("write to", parent))?;
        Ok(Self {
            folder,
            place: place.to_owned(),
        })
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
        // An empty folder gives way as it is, also where a system would not rename onto it.
        let _ = fs::remove_dir(&self.place);
        fs::rename(self.folder.path(), &self.place).map_err(failed("create", &self.place))?;
        self.leave();
        Ok(())
    }

    /// Puts the folder in its place and removes what was there.
    ///
    /// # Errors
    /// When that cannot be moved aside, or the folder cannot take its place: then what was there is back. When what was
    /// there cannot be removed afterwards, the folder is in its place already.
    pub fn replace(self) -> Result<(), DraftError> {
        let _ = fs::remove_dir(&self.place);
        if !self.place.exists() {
            return self.finish();
        }
        let old = self.folder.path().with_extension("old");
        fs::rename(&self.place, &old).map_err(failed("replace", &self.place))?;
        if let Err(error) = fs::rename(self.folder.path(), &self.place) {
            // The error that is on its way says more than one from going back.
            let _ = fs::rename(&old, &self.place);
            return Err(failed("create", &self.place)(error));
        }
        self.leave();
        fs::remove_dir_all(&old).map_err(failed("remove", &old))
    }

    /// There is nothing left to remove at the temporary name.
    fn leave(self) {
        let _ = self.folder.keep();
    }
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
