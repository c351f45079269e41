//! What can go wrong, said so that a person can repair it.

use io_colmap::{ColmapError, Place};
use std::path::{Path, PathBuf};

/// Every failure of this crate: which file, what is wrong, what to do.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system refused to read or write a file.
    #[error("cannot {action} {}: {source}; {}", path.display(), io_colmap::remedy(source))]
    Io {
        /// `read`, `write`, `list` or `create`.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file holds something that its format does not allow, or the files of a scene do not fit
    /// together.
    #[error("{}{place}: {what}; {remedy}", path.display())]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The COLMAP scene or the masks, once read, do not hold together.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
}

impl From<draft_folder::DraftError> for ImportError {
    fn from(error: draft_folder::DraftError) -> Self {
        Self::io(error.action, &error.path, error.source)
    }
}

impl ImportError {
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        Self::Io {
            action,
            path: path.to_path_buf(),
            source,
        }
    }

    pub(crate) fn bad(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::at(path, Place::File, what, remedy)
    }

    pub(crate) fn line(
        path: &Path,
        line: usize,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::at(path, Place::Line(line), what, remedy)
    }

    fn at(path: &Path, place: Place, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Content {
            path: path.to_path_buf(),
            place,
            what: what.into(),
            remedy: remedy.into(),
        }
    }

    /// What it speaks of.
    pub(crate) fn path_mut(&mut self) -> &mut PathBuf {
        match self {
            Self::Io { path, .. } | Self::Content { path, .. } => path,
            Self::Colmap(error) => error.path_mut(),
        }
    }

    pub(crate) fn json(path: &Path, error: &serde_json::Error) -> Self {
        Self::line(
            path,
            error.line(),
            // Without the place, which is said already.
            error
                .to_string()
                .split(" at line ")
                .next()
                .unwrap_or_default()
                .to_owned(),
            "correct the file or export it again",
        )
    }
}

/// Reads a file whole.
pub(crate) fn load(path: &Path) -> Result<Vec<u8>, ImportError> {
    std::fs::read(path).map_err(|e| ImportError::io("read", path, e))
}

/// Reads a text file whole, without a byte order mark.
pub(crate) fn load_text(path: &Path) -> Result<String, ImportError> {
    let text = String::from_utf8(load(path)?).map_err(|_| {
        ImportError::bad(path, "this is not UTF-8 text", "export it again as UTF-8")
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}
