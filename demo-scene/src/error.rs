//! What can go wrong when a scene is written.

use draft_folder::Occupant;
use std::io;
use std::path::PathBuf;

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space",
        _ => "choose a folder that can be written to",
    }
}

/// Failure to write a scene to disk.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// A file or folder could not be created, written or renamed.
    #[error("cannot write {path}: {source}; {}", remedy(source))]
    Write {
        /// The file or folder in question.
        path: PathBuf,
        /// What the operating system said.
        #[source]
        source: io::Error,
    },
    /// The destination is not an empty folder: nothing is ever overwritten.
    #[error("{path} is not empty, there is something in it already, {occupant}; {}", occupant.remedy("choose a folder that is empty or does not exist"))]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// What is in it.
        occupant: Occupant,
    },
}

impl From<draft_folder::DraftError> for DemoError {
    fn from(error: draft_folder::DraftError) -> Self {
        Self::Write {
            path: error.path,
            source: error.source,
        }
    }
}
