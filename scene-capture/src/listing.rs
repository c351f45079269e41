//! What is in a folder and its sub-folders, and what of it cannot be named or read.

use crate::error::CaptureError;
use std::io;
use std::path::{Path, PathBuf};

/// The files with some endings in a folder.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    /// Paths below the folder, with `/` between folders, sorted.
    pub(crate) names: Vec<String>,
    /// Files whose paths are not Unicode, which no list of names can hold.
    pub(crate) unnamed: Vec<PathBuf>,
    /// Sub-folders that cannot be read, and why.
    pub(crate) closed: Vec<(PathBuf, io::Error)>,
}

impl Listing {
    /// Fails where the folder itself cannot be read.
    pub(crate) fn of(
        folder: &Path,
        depth: usize,
        endings: &[&str],
    ) -> Result<Listing, CaptureError> {
        let mut listing = Listing::default();
        listing
            .add(folder, Some(""), depth, endings)
            .map_err(|e| CaptureError::io("list", folder, e))?;
        listing.names.sort();
        listing.unnamed.sort();
        Ok(listing)
    }

    /// `prefix` is what names in the folder begin with; `None` where that is not Unicode.
    fn add(
        &mut self,
        folder: &Path,
        prefix: Option<&str>,
        depth: usize,
        endings: &[&str],
    ) -> io::Result<()> {
        for entry in std::fs::read_dir(folder)? {
            let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
            let shown = name.to_string_lossy();
            if shown.starts_with('.') {
                continue;
            }
            let full = prefix
                .zip(name.to_str())
                .map(|(prefix, name)| format!("{prefix}{name}"));
            if path.is_dir() {
                // Masks bear the names of photos.
                if depth > 0 && !shown.to_lowercase().contains("mask") {
                    let inner = full.map(|full| format!("{full}/"));
                    if let Err(error) = self.add(&path, inner.as_deref(), depth - 1, endings) {
                        self.closed.push((path, error));
                    }
                }
            } else if let Some((_, ending)) = shown.rsplit_once('.')
                && endings.contains(&&*ending.to_ascii_lowercase())
            {
                match full {
                    Some(full) => self.names.push(full),
                    None => self.unnamed.push(path),
                }
            }
        }
        Ok(())
    }

    /// How many files there are, by whatever name.
    pub(crate) fn count(&self) -> usize {
        self.names.len() + self.unnamed.len()
    }

    /// What is missing of the names.
    pub(crate) fn notes(&self) -> Vec<String> {
        let unnamed = self.unnamed.first().map(|first| {
            format!(
                "{} photos whose names are not Unicode are left out, such as {}; rename them to have them taken",
                self.unnamed.len(),
                first.display()
            )
        });
        let closed = self.closed.iter().map(|(folder, error)| {
            format!(
                "the sub-folder {} cannot be read and is left out ({error})",
                folder.display()
            )
        });
        unnamed.into_iter().chain(closed).collect()
    }
}
