//! Why a scene cannot be trained on.

use std::path::PathBuf;

/// What is wrong with a scene, and what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// Cameras, photos and masks do not fit together.
    #[error("{0}")]
    Scene(String),
    /// A device that is not there or cannot be used.
    #[error("--device {name}: {remedy}")]
    Device {
        /// As it was asked for.
        name: String,
        /// What can be done about it.
        remedy: String,
    },
    /// What the COLMAP reader said.
    #[error(transparent)]
    Colmap(#[from] io_colmap::ColmapError),
    /// A checkpoint that does not fit.
    #[error("{}: {what}; to start again, train with SCENE and --force instead of --resume", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// Photos and masks that are too many for the memory, and no room for them elsewhere.
    #[error(
        "{}: photos and masks cannot be kept here ({source}); make room, name another folder in TMPDIR, or give \
         smaller photos",
        folder.display()
    )]
    Store {
        /// Where they were to be kept.
        folder: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The object's box holds nothing that can be seen.
    #[error(
        "the object's box contains nothing: no ray met anything for {0} steps. The masks may show \
         different things, or the poses may not belong to the photos; sos doctor SCENE checks both"
    )]
    Empty(u32),
    /// Training that came out as not-a-number again and again.
    #[error(
        "training diverged at step {0} even at reduced learning rates; try --set \
         schedule.learning_rate=0.003"
    )]
    Diverged(u32),
}
