//! Moving what is in folders, by renaming alone.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// What is in a folder, apart from files and folders of some names.
pub(crate) fn entries(folder: &Path, apart_from: &[&Path]) -> io::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let is_other = |own: &&Path| own.file_name() != path.file_name();
        if apart_from.iter().all(is_other) {
            all.push(path);
        }
    }
    Ok(all)
}

/// Moves files and folders into a folder: all of them, or none.
pub(crate) fn move_all(entries: &[PathBuf], into: &Path) -> io::Result<()> {
    // What a folder lists has a name.
    let moved = |entry: &Path| into.join(entry.file_name().unwrap_or_default());
    for (count, entry) in entries.iter().enumerate() {
        if let Err(error) = fs::rename(entry, moved(entry)) {
            for entry in &entries[..count] {
                // The error that is on its way says more than one from going back.
                let _ = fs::rename(moved(entry), entry);
            }
            return Err(error);
        }
    }
    Ok(())
}

/// Whether another disk begins at a folder, or the same one once more, so that nothing can be renamed from a draft
/// beside it into it. Only trying tells that everywhere.
pub(crate) fn is_elsewhere(folder: &Path, draft: &Path) -> bool {
    let Some(name) = draft.file_name() else {
        return false;
    };
    let (from, to) = (draft.join(name), folder.join(name));
    let moved = fs::create_dir(&from).and_then(|()| fs::rename(&from, &to));
    // One of them is not there.
    let _ = fs::remove_dir(&from);
    let _ = fs::remove_dir(&to);
    moved.is_err_and(|error| error.kind() == io::ErrorKind::CrossesDevices)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn all_is_moved_or_nothing() {
        let root = tempfile::tempdir().unwrap();
        let (from, into) = (root.path().join("from"), root.path().join("into"));
        fs::create_dir_all(from.join("b")).unwrap();
        fs::create_dir_all(into.join("b/full")).unwrap();
        fs::write(from.join("a"), "").unwrap();
        let mut listed = entries(&from, &[]).unwrap();
        listed.sort();
        assert_eq!(listed, [from.join("a"), from.join("b")]);
        assert!(move_all(&listed, &into).is_err());
        assert!(from.join("a").is_file() && !into.join("a").exists());
        fs::remove_dir(into.join("b/full")).unwrap();
        move_all(&listed, &into).unwrap();
        assert!(entries(&from, &[]).unwrap().is_empty());
        let apart = entries(&into, &[Path::new("x/a")]).unwrap();
        assert_eq!(apart, [into.join("b")]);
    }

    #[test]
    fn a_folder_of_the_same_disk_is_not_elsewhere() {
        let root = tempfile::tempdir().unwrap();
        let (folder, draft) = (root.path().join("folder"), root.path().join("draft"));
        fs::create_dir(&folder).unwrap();
        fs::create_dir(&draft).unwrap();
        assert!(!is_elsewhere(&folder, &draft));
        assert!(entries(&folder, &[]).unwrap().is_empty());
        assert!(entries(&draft, &[]).unwrap().is_empty());
    }
}
