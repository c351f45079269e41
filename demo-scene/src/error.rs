//! What can go wrong when a scene is written.

use draft_folder::{DraftError, Occupant};
use std::path::PathBuf;

/// Failure to write a scene to disk.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// A file or folder could not be created, written or renamed.
    #[error(transparent)]
    Write(#[from] DraftError),
    /// The destination is not an empty folder: nothing is ever overwritten.
    #[error("{path} is not empty, there is something in it already, {occupant}; {}", occupant.remedy("choose a folder that is empty or does not exist"))]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// What is in it.
        occupant: Occupant,
    },
}
