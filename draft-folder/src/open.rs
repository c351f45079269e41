//! Which drafts there are, for a program that is told to end.

use std::fs;
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Folders of all drafts.
static OPEN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Held while a draft takes its place.
static PLACING: Mutex<()> = Mutex::new(());
/// What a thread that goes on writing keeps from being removed is tried this often.
const ATTEMPTS: usize = 3;

/// A draft's entry in the list, as long as it lasts.
#[derive(Debug)]
pub(crate) struct Open(PathBuf);

impl Open {
    pub(crate) fn new(folder: &Path) -> Self {
        lock(&OPEN).push(folder.to_owned());
        Self(folder.to_owned())
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        lock(&OPEN).retain(|folder| *folder != self.0);
    }
}

/// To be held while a draft takes its place.
pub(crate) fn placing() -> MutexGuard<'static, ()> {
    lock(&PLACING)
}

/// Removes all drafts of this program, which is to end at once: none takes its place any more, and whoever waits for that
/// waits for ever. One that is on its way there arrives first.
pub fn abandon_all() {
    mem::forget(placing());
    for folder in &*lock(&OPEN) {
        for _ in 0..ATTEMPTS {
            // Nobody is left to be told.
            if fs::remove_dir_all(folder).is_ok() || !folder.exists() {
                break;
            }
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
