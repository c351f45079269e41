//! What can go wrong, said so that a person can repair it.

use std::io;
use std::path::{Path, PathBuf};

/// Where in a file something was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Bytes from the start of a binary file.
    Byte(u64),
    /// Line of a text file, counted from 1.
    Line(usize),
    /// The file as a whole.
    File,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Place::Byte(offset) => write!(f, ", byte {offset}"),
            Place::Line(line) => write!(f, ", line {line}"),
            Place::File => Ok(()),
        }
    }
}

/// What to do where the operating system refused to read or write a file.
#[must_use]
pub fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space",
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "check that you may access it, or choose another place"
        }
        io::ErrorKind::NotFound => "check that it exists",
        _ => "check the path and the disk",
    }
}

/// What the operating system said when a picture could not be written, with the kind that [`remedy`] goes
/// by.
#[must_use]
pub fn picture_error(error: image::ImageError) -> io::Error {
    match error {
        image::ImageError::IoError(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

/// Every failure of this crate: which file, what is wrong, what to do.
#[derive(Debug, thiserror::Error)]
pub enum ColmapError {
    /// The operating system refused to read or write a file.
    #[error("cannot {action} {}: {source}; {}", path.display(), remedy(source))]
    Io {
        /// `read`, `write`, `list` or `create`.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A model file holds something that is not a valid COLMAP model.
    #[error("{}{place}: {what}; {remedy}", path.display())]
    Format {
        /// The model file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The model and the photos do not make a usable scene.
    #[error("{}: {what}; {remedy}", path.display())]
    Scene {
        /// The scene folder or photo.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The masks cannot be used with the scene.
    #[error("{}: {what}; {remedy}", path.display())]
    Mask {
        /// The mask folder or mask file.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
}

impl ColmapError {
    /// The file or folder that it speaks of, for whoever knows it by another name: a copy that does not last, say.
    #[must_use]
    pub fn path_mut(&mut self) -> &mut PathBuf {
        match self {
            Self::Io { path, .. }
            | Self::Format { path, .. }
            | Self::Scene { path, .. }
            | Self::Mask { path, .. } => path,
        }
    }

    pub(crate) fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Io {
            action,
            path: path.to_path_buf(),
            source,
        }
    }

    pub(crate) fn scene(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Scene {
            path: path.to_path_buf(),
            what: what.into(),
            remedy: remedy.into(),
        }
    }

    pub(crate) fn mask(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Mask {
            path: path.to_path_buf(),
            what: what.into(),
            remedy: remedy.into(),
        }
    }
}

/// A place in a model file, ready to turn a complaint into an error.
#[derive(Clone, Copy)]
pub(crate) struct Spot<'a> {
    pub(crate) path: &'a Path,
    pub(crate) place: Place,
}

impl Spot<'_> {
    pub(crate) fn bad(&self, what: impl Into<String>, remedy: impl Into<String>) -> ColmapError {
        ColmapError::Format {
            path: self.path.to_path_buf(),
            place: self.place,
            what: what.into(),
            remedy: remedy.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_not_looked_for_in_the_path() {
        let said = |kind: io::ErrorKind| {
            ColmapError::io("write", Path::new("sparse/0/points3D.bin"), kind.into()).to_string()
        };
        assert!(said(io::ErrorKind::StorageFull).ends_with("; free some space"));
        assert!(said(io::ErrorKind::QuotaExceeded).ends_with("; free some space"));
        assert!(said(io::ErrorKind::PermissionDenied).contains("you may access it"));
        let full = image::ImageError::IoError(io::ErrorKind::StorageFull.into());
        assert_eq!(picture_error(full).kind(), io::ErrorKind::StorageFull);
        assert!(said(io::ErrorKind::NotFound).ends_with("; check that it exists"));
    }
}
