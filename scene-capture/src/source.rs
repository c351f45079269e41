//! What a path holds: photos, a video, or neither.

use crate::photos::{VIDEO_ENDINGS, has_photos};
use std::path::{Path, PathBuf};

/// What a scene can be captured from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// A folder of photos without poses.
    Photos(PathBuf),
    /// A video file.
    Video(PathBuf),
}

impl Source {
    /// The folder or file.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Source::Photos(path) | Source::Video(path) => path,
        }
    }
}

/// Finds out whether a path is a video, or a folder of photos (JPEG, PNG, WebP, TIFF) that no
/// known tool has put poses to. `None` for anything else, scenes with poses among it.
#[must_use]
pub fn detect(path: &Path) -> Option<Source> {
    if path.is_file() {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        return VIDEO_ENDINGS
            .contains(&&*ending)
            .then(|| Source::Video(path.to_path_buf()));
    }
    let photos_only = path.is_dir() && scene_import::detect(path, None).is_err();
    (photos_only && has_photos(path)).then(|| Source::Photos(path.to_path_buf()))
}
