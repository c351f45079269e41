//! One process at a time writes into a run's folder.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use super::RunError;

/// The file that is locked. What is left of it after a crash holds nobody up.
pub(super) const LOCK: &str = ".lock";

/// Held while a run is made; its file goes with it.
#[derive(Debug)]
pub(super) struct Lock {
    path: PathBuf,
    _file: File,
    /// Whether the file is gone already: one that is there now is another process's.
    is_removed: AtomicBool,
}

impl Lock {
    /// Locks a folder that is there. `None` on file systems that know no locks.
    ///
    /// # Errors
    /// [`RunError::Busy`] while another process holds it, and [`RunError::Io`].
    pub(super) fn take(root: &Path) -> Result<Option<Self>, RunError> {
        let path = root.join(LOCK);
        loop {
            let file = File::options()
                .create(true)
                .truncate(false)
                .write(true)
                .open(&path)
                .map_err(|e| RunError::io("write to the folder", root, e))?;
            match file.try_lock() {
                // Its holder may have removed it in between: a lock on it would keep nobody out.
                Ok(()) if !lies_at(&file, &path) => {}
                Ok(()) => {
                    return Ok(Some(Self {
                        path,
                        _file: file,
                        is_removed: AtomicBool::new(false),
                    }));
                }
                Err(TryLockError::WouldBlock) => {
                    return Err(RunError::Busy {
                        path: root.to_path_buf(),
                    });
                }
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                    drop(file);
                    let _ = fs::remove_file(path);
                    return Ok(None);
                }
                Err(TryLockError::Error(error)) => {
                    return Err(RunError::io("lock the folder", root, error));
                }
            }
        }
    }

    /// Removes the file, for its folder to be removed.
    pub(super) fn remove_file(&self) {
        if !self.is_removed.swap(true, Ordering::Relaxed) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Whether an open file is the one at `path`.
#[cfg(unix)]
fn lies_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(own), Ok(there)) => (own.dev(), own.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// An open file is not removed there.
#[cfg(not(unix))]
fn lies_at(_: &File, _: &Path) -> bool {
    true
}

impl Drop for Lock {
    fn drop(&mut self) {
        self.remove_file();
    }
}
