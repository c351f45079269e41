//! What can go wrong, said so that a person can repair it.

use io_colmap::ColmapError;
use std::io;
use std::path::{Path, PathBuf};

/// Every failure of this crate: which file, what is wrong, what to do.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The operating system refused to read or write a file.
    #[error("cannot {action} {}: {source}; {}", path.display(), remedy(action, source))]
    Io {
        /// `read`, `write`, `list` or `create`.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The run, its scene or the folder to write to is not what it has to be.
    #[error("{}: {what}; {remedy}", path.display())]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// A program that is needed is not there, or failed.
    #[error("{}: {what}; {remedy}", program.display())]
    Program {
        /// Its name or path.
        program: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// There is something where the export would go.
    #[error("{} is there already; add --force to replace it, or choose another folder with --out", path.display())]
    Exists {
        /// The folder of an earlier export.
        path: PathBuf,
    },
    /// The scene that the run was made from cannot be read.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
}

/// A word that names nothing that can be exported.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no {kind} {word:?}; did you mean {nearest:?}? There are {list}")]
pub struct UnknownWord {
    pub(crate) kind: &'static str,
    pub(crate) word: String,
    pub(crate) nearest: &'static str,
    pub(crate) list: String,
}

fn remedy(action: &str, error: &io::Error) -> &'static str {
    let is_read = ["read", "list", "copy"].contains(&action);
    match error.kind() {
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem if !is_read => {
            "choose a folder you may write to with --out"
        }
        _ => io_colmap::remedy(error),
    }
}

impl From<draft_folder::DraftError> for ExportError {
    fn from(error: draft_folder::DraftError) -> Self {
        Self::io(error.action, &error.path, error.source)
    }
}

impl ExportError {
    pub(crate) fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Io {
            action,
            path: path.to_path_buf(),
            source,
        }
    }

    pub(crate) fn bad(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Content {
            path: path.to_path_buf(),
            // Messages of parsers span lines.
            what: what.into().split_whitespace().collect::<Vec<_>>().join(" "),
            remedy: remedy.into(),
        }
    }
}
