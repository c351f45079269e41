//! What can be wrong with a run's folder.

use std::io;
use std::path::{Path, PathBuf};

/// What is wrong with a run's folder, or with what is written elsewhere.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}; {}", path.display(), remedy(source))]
    Io {
        /// What was being done.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The operating system refused, with what belongs to no run, so that none can be resumed.
    #[error("cannot {action} {}: {source}; {}", path.display(), io_colmap::remedy(source))]
    Outside {
        /// What was being done.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// There is a run already.
    #[error("{} already holds a run; add --resume to go on with it, --force to replace it, or choose another folder with --out", path.display())]
    Exists {
        /// The run's folder.
        path: PathBuf,
    },
    /// Another process trains into the folder.
    #[error("{} is being written to by another sos train; wait until it is done, stop it, or choose another folder with --out", path.display())]
    Busy {
        /// The run's folder.
        path: PathBuf,
    },
    /// The folder is in use for something else.
    #[error("{} is not empty and holds no run, so nothing is written there; choose another folder with --out", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
    },
    /// The path leads to a file.
    #[error("{} is a file; a run needs a folder, choose another one with --out", path.display())]
    NotAFolder {
        /// The file.
        path: PathBuf,
    },
    /// There is no run to go on with.
    #[error("{} holds no run (config.toml is missing); give the folder that sos train wrote", path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// There is a run, but it was stopped before its first checkpoint.
    #[error("{} has no checkpoint yet, so there is nothing to go on from; start it again with SCENE and --force", path.display())]
    NoCheckpoint {
        /// The run's folder.
        path: PathBuf,
    },
}

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "free some space and go on with --resume"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "choose a folder you may write to with --out"
        }
        _ => io_colmap::remedy(error),
    }
}

impl From<draft_folder::DraftError> for RunError {
    fn from(error: draft_folder::DraftError) -> Self {
        Self::outside(error.action, &error.path, error.source)
    }
}

impl RunError {
    pub(crate) fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Io {
            action,
            path: path.to_path_buf(),
            source,
        }
    }

    pub(crate) fn outside(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Outside {
            action,
            path: path.to_path_buf(),
            source,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_run_is_gone_on_with() {
        let full = || io::ErrorKind::StorageFull.into();
        let of_run = RunError::io("write", Path::new("run/mesh.ply"), full());
        assert!(of_run.to_string().ends_with("go on with --resume"));
        let outside = RunError::outside("write", Path::new("run/mesh.ply"), full());
        let says = outside.to_string();
        assert!(
            says.starts_with("cannot write run/mesh.ply") && says.ends_with("; free some space"),
            "{says}"
        );
    }
}
