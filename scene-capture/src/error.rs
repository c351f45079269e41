//! What can go wrong, said so that a person can repair it.

use io_colmap::ColmapError;
use std::path::{Path, PathBuf};

/// Every failure of this crate: which file or program, what is wrong, what to do.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// A program that does the work is not installed, or not where it was said to be.
    #[error("{what}; {remedy}")]
    Missing {
        /// What was looked for and where.
        what: String,
        /// How to get it.
        remedy: &'static str,
    },
    /// COLMAP's Python module is of a release that does not do what is asked of it.
    #[error(
        "the pycolmap {version} of {} is too old, 4.0 or newer is needed; install the program colmap, or \
         pycolmap for a newer Python (pip install -U pycolmap)",
        python.display()
    )]
    TooOld {
        /// What it calls itself.
        version: String,
        /// The Python that it belongs to.
        python: PathBuf,
    },
    /// A program was started and failed.
    #[error("{} failed at {task} ({what}); {remedy}", program.display())]
    Failed {
        /// The program.
        program: PathBuf,
        /// What it was to do.
        task: &'static str,
        /// What it said last, or how it ended.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The operating system refused to read or write a file, or to start a program.
    #[error("cannot {action} {}: {source}; {}", path.display(), io_colmap::remedy(source))]
    Io {
        /// `read`, `write`, `list`, `create` or `start`.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The photos or the video cannot be used, or gave no scene.
    #[error("{}: {what}; {remedy}", path.display())]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// Someone asked to stop. Programs that ran were ended, nothing was written.
    #[error("stopped before the scene was complete; nothing was written")]
    Interrupted,
    /// A photo, a mask or the model that COLMAP wrote cannot be read.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
}

impl From<draft_folder::DraftError> for CaptureError {
    fn from(error: draft_folder::DraftError) -> Self {
        Self::io(error.action, &error.path, error.source)
    }
}

impl CaptureError {
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        Self::Io {
            action,
            path: path.to_path_buf(),
            source,
        }
    }

    /// The same about files that last, where `draft` is what will be `out`. Photos in it are copies of the `originals`.
    pub(crate) fn outside(mut self, draft: &Path, out: &Path, originals: Option<&Path>) -> Self {
        let is_about_photo = matches!(self, Self::Colmap(ColmapError::Scene { .. }));
        let path = match &mut self {
            Self::Failed { what, .. } => {
                let [inner, outer] = [draft, out].map(|path| path.display().to_string());
                *what = what.replace(&inner, &outer);
                return self;
            }
            Self::Io { path, .. } | Self::Content { path, .. } => path,
            Self::Colmap(error) => error.path_mut(),
            Self::Missing { .. } | Self::TooOld { .. } | Self::Interrupted => return self,
        };
        if let Ok(inner) = path.strip_prefix(draft) {
            let photo = inner.strip_prefix("images").ok().zip(originals);
            *path = match photo.filter(|_| is_about_photo) {
                Some((name, originals)) => originals.join(name),
                None => out.join(inner),
            };
        }
        self
    }

    pub(crate) fn bad(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Content {
            path: path.to_path_buf(),
            what: what.into(),
            remedy: remedy.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_files_that_last() {
        let (draft, out) = (Path::new("a/.sos-partial-x"), Path::new("a/scene"));
        let said = |error: CaptureError| {
            let error = error.outside(draft, out, Some(Path::new("photos")));
            error.to_string()
        };
        let full = || std::io::ErrorKind::StorageFull.into();
        let photo = draft.join("images/left/a.jpg");
        let written = CaptureError::io("create", &photo, full());
        assert!(said(written).contains("a/scene/images/left/a.jpg"));
        let database = CaptureError::Failed {
            program: PathBuf::from("colmap"),
            task: "finding poses",
            what: "cannot open a/.sos-partial-x/sparse/0".to_owned(),
            remedy: "free some space".to_owned(),
        };
        assert!(said(database).contains("(cannot open a/scene/sparse/0)"));
        let read = |path: &Path| {
            said(CaptureError::Colmap(ColmapError::Scene {
                path: path.to_owned(),
                what: "it is damaged".to_owned(),
                remedy: "copy it again".to_owned(),
            }))
        };
        assert!(read(&photo).starts_with("photos/left/a.jpg: "));
        assert!(read(&draft.join("sparse/0")).starts_with("a/scene/sparse/0: "));
        assert!(read(Path::new("m/a.png")).starts_with("m/a.png: "));
    }
}
