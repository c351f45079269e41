//! What has been said about a run's results, and made of them, when they are drawn anew; and results that are not.

use super::files::{remove_file, remove_pictures};
use super::{MADE_FOLDERS, RunError, RunFolder};

impl RunFolder {
    /// Removes scores and report, which would pass for being those of the results that are about to be drawn. Exports and renders
    /// stay, as nobody said that they may go; returns a sentence for people where there are any.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub(crate) fn forget_verdicts(&self) -> Result<Option<String>, RunError> {
        remove_file(&self.metrics_path())?;
        remove_file(&self.report_path())?;
        let made: Vec<String> = MADE_FOLDERS
            .iter()
            .filter(|folder| self.root().join(folder).is_dir())
            .map(|folder| format!("{folder}/"))
            .collect();
        let note = format!(
            "results are drawn anew; what is in {} was made of those before",
            made.join(" and ")
        );
        Ok(Some(note).filter(|_| !made.is_empty()))
    }

    /// Removes the cameras of an earlier end, for no camera is where they have it.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub(crate) fn forget_cameras(&self) -> Result<(), RunError> {
        remove_pictures(&self.cameras_dir(), "bin")
    }

    /// Removes the mesh of an earlier end, for there is none now.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub(crate) fn forget_mesh(&self) -> Result<(), RunError> {
        remove_file(&self.mesh_path())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::Existing;
    use super::*;
    use std::fs;
    use std::io::Write as _;

    #[test]
    fn scores_go_and_exports_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let run = RunFolder::create(&dir.path().join("run"), Existing::Keep).unwrap();
        for path in [run.metrics_path(), run.report_path(), run.mesh_path()] {
            run.write(&path, |out| out.write_all(b"old")).unwrap();
        }
        assert_eq!(run.forget_verdicts().unwrap(), None);
        assert!(!run.metrics_path().exists() && !run.report_path().exists());
        assert!(run.mesh_path().exists());
        fs::create_dir_all(run.root().join("render/turntable")).unwrap();
        let note = run.forget_verdicts().unwrap().unwrap();
        assert!(
            note.contains("render/") && !note.contains("export/"),
            "{note}"
        );
        assert!(run.root().join("render/turntable").is_dir());
        let cameras = run.cameras_dir();
        for name in ["images.bin", "mine.txt"] {
            run.write(&cameras.join(name), |out| out.write_all(b"old"))
                .unwrap();
        }
        run.forget_cameras().unwrap();
        run.forget_mesh().unwrap();
        assert!(!cameras.join("images.bin").exists() && !run.mesh_path().exists());
        // No run has written that.
        assert!(cameras.join("mine.txt").exists());
        // There may be none.
        run.forget_cameras().unwrap();
        run.forget_mesh().unwrap();
    }
}
