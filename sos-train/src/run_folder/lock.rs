//! One process at a time writes into a run's folder.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::RunError;

/// The file that is locked. What is left of it after a crash holds nobody up.
pub(super) const LOCK: &str = ".lock";

/// Held while a run is made; its file goes with it.
#[derive(Debug)]
pub(super) struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Locks a folder that is there. `None` on file systems that know no locks.
    ///
    /// # Errors
    /// [`RunError::Busy`] while another process holds it, and [`RunError::Io`].
    pub(super) fn take(root: &Path) -> Result<Option<Self>, RunError> {
        let path = root.join(LOCK);
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(|e| RunError::io("write to the folder", root, e))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { path, _file: file })),
            Err(TryLockError::WouldBlock) => Err(RunError::Busy {
                path: root.to_path_buf(),
            }),
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                drop(file);
                let _ = fs::remove_file(path);
                Ok(None)
            }
            Err(TryLockError::Error(error)) => Err(RunError::io("lock the folder", root, error)),
        }
    }

    /// Removes the file, for its folder to be removed.
    pub(super) fn remove_file(&self) {
        // It may be gone already.
        let _ = fs::remove_file(&self.path);
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        self.remove_file();
    }
}
