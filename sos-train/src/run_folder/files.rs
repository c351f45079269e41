//! Files that appear in one piece, and their removal.

use super::RunError;
use draft_folder::{Draft, Durability};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// Start of the names of files that are being written, as of folders.
pub(super) const PARTIAL: &str = draft_folder::PREFIX;

/// Writes a file that belongs to no run in one piece; its folder is made if need be.
///
/// # Errors
/// [`RunError::Outside`] if it cannot be written.
pub(crate) fn write_whole(path: &Path, content: &[u8]) -> Result<(), RunError> {
    draft_folder::write_file(path, Durability::Program, |out| out.write_all(content))?;
    Ok(())
}

/// Fills a folder that belongs to no run in one piece, under another name beside its place, so that no
/// half of it is ever taken for the whole. There must be nothing at `out`, or an empty folder.
///
/// # Errors
/// What `fill` says, and [`RunError::Outside`] if the folder cannot be made.
pub(crate) fn write_folder<T>(
    out: &Path,
    fill: impl FnOnce(&Path) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let draft = Draft::beside(out).map_err(RunError::from)?;
    let filled = fill(draft.path())?;
    draft.finish().map_err(RunError::from)?;
    Ok(filled)
}

/// Writes one of a run's own files in one piece.
pub(super) fn write_file(
    path: &Path,
    durability: Durability,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), RunError> {
    draft_folder::write_file(path, durability, fill)
        .map_err(|error| RunError::io(error.action, &error.path, error.source))
}

/// The path of a view's file below `folder`: as the photo, with another ending. Exports look for it
/// there, so that the rule is theirs.
pub(crate) fn view_file(folder: &Path, photo: &str, ending: &str) -> PathBuf {
    folder.join(format!("{}.{ending}", scene_export::key_of(photo)))
}

pub(super) fn remove_folder(path: &Path) -> Result<(), RunError> {
    match fs::remove_dir_all(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(RunError::io("remove", path, e)),
        _ => Ok(()),
    }
}

pub(super) fn remove_file(path: &Path) -> Result<(), RunError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(RunError::io("remove", path, e)),
        _ => Ok(()),
    }
}

pub(super) fn remove_pictures(folder: &Path, ending: &str) -> Result<(), RunError> {
    // A link leads out of the run.
    if folder.is_symlink() {
        return Ok(());
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let partial = entry.file_name().to_string_lossy().starts_with(PARTIAL);
        if path.is_dir() {
            remove_pictures(&path, ending)?;
        } else if partial || path.extension().is_some_and(|e| e == ending) {
            remove_file(&path)?;
        }
    }
    // Refused while something is left.
    let _ = fs::remove_dir(folder);
    Ok(())
}

/// Whether there is a file with the ending below a folder.
pub(super) fn holds_pictures(folder: &Path, ending: &str) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).any(|path| {
        if path.is_dir() {
            holds_pictures(&path, ending)
        } else {
            path.extension().is_some_and(|e| e == ending)
        }
    })
}

/// Removes what was made of a run's results below `folder`: each folder in it that says so by its record, and in which
/// no other program has written.
pub(super) fn remove_made(folder: &Path) -> Result<(), RunError> {
    // A link leads out of the run.
    if folder.is_symlink() {
        return Ok(());
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_made = || scene_export::files_of_others(&path).is_ok_and(|others| others.is_empty());
        if path.join(scene_export::RECORD).is_file() && !path.is_symlink() && is_made() {
            remove_folder(&path)?;
        }
    }
    // Refused while something is left.
    let _ = fs::remove_dir(folder);
    Ok(())
}
