//! A folder that appears when it is complete.

use crate::error::ExportError;
use crate::record::{RECORD, refuse_others, with_files};
use draft_folder::{Draft as Folder, Existing, Occupant};
use io_colmap::Model;
use std::fs;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// A folder in the making, beside its place. It is gone if it is dropped before it is finished.
#[derive(Debug)]
pub struct Draft {
    folder: Folder,
    existing: Existing,
}

impl Draft {
    /// Begins a folder; complains before any work is done about what would be in the way at its end.
    ///
    /// # Errors
    /// [`ExportError`] if something is in the way, or nothing can be written there.
    pub fn begin(out: &Path, existing: Existing) -> Result<Self, ExportError> {
        match Occupant::of(out) {
            Ok(None) => {}
            Ok(Some(_)) if out.join(RECORD).is_file() => {
                if existing == Existing::Keep {
                    return Err(ExportError::Exists {
                        path: out.to_path_buf(),
                    });
                }
                refuse_others(out)?;
            }
            Ok(Some(occupant)) => {
                return Err(ExportError::bad(
                    out,
                    format!(
                        "there is something in it, {occupant}, and nothing that was exported here: it is never replaced"
                    ),
                    occupant.remedy("choose a folder with --out that is empty or does not exist"),
                ));
            }
            Err(_) if out.is_file() => {
                return Err(ExportError::bad(
                    out,
                    "this is a file",
                    "choose a folder with --out",
                ));
            }
            Err(error) => return Err(ExportError::io("list", out, error)),
        }
        let folder = Folder::beside(out)?;
        Ok(Self { folder, existing })
    }

    /// Where a file belongs, with the folders on the way.
    ///
    /// # Errors
    /// [`ExportError::Io`].
    pub fn place(&self, name: &str) -> Result<PathBuf, ExportError> {
        let path = self.folder.path().join(name);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)
                .map_err(|e| ExportError::io("create", &self.goal_of(folder), e))?;
        }
        Ok(path)
    }

    /// Where a file will be at the end, which is what messages say.
    pub(crate) fn goal(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.place().join(name)
    }

    /// The same for a file or folder in the making, which nobody will find.
    fn goal_of(&self, path: &Path) -> PathBuf {
        match path.strip_prefix(self.folder.path()) {
            Ok(inside) => self.goal(inside),
            Err(_) => path.to_path_buf(),
        }
    }

    /// Writes a file.
    pub(crate) fn write(
        &self,
        name: &str,
        fill: impl FnOnce(&mut BufWriter<fs::File>) -> io::Result<()>,
    ) -> Result<(), ExportError> {
        let path = self.place(name)?;
        let write = || {
            let mut out = BufWriter::with_capacity(1 << 16, fs::File::create(&path)?);
            fill(&mut out)?;
            out.flush()
        };
        write().map_err(|e| ExportError::io("write", &self.goal(name), e))
    }

    /// Copies a file, and says which of the two is to blame where that fails.
    pub(crate) fn copy(&self, from: &Path, name: &str) -> Result<(), ExportError> {
        let Err(error) = fs::copy(from, self.place(name)?) else {
            return Ok(());
        };
        // The system does not say it.
        let read = fs::File::open(from).and_then(|mut file| io::copy(&mut file, &mut io::sink()));
        Err(match read {
            Ok(_) => ExportError::io("write", &self.goal(name), error),
            Err(error) => ExportError::io("read", from, error),
        })
    }

    /// Writes a COLMAP model into a folder, in binary.
    pub(crate) fn write_model(&self, model: &Model, name: &str) -> Result<(), ExportError> {
        let mut error = match model.write_binary(&self.folder.path().join(name)) {
            Ok(()) => return Ok(()),
            Err(error) => error,
        };
        let place = self.goal_of(error.path_mut());
        *error.path_mut() = place;
        Err(error.into())
    }

    /// Puts the folder in its place, with a record of what is in it as `export.txt`, to which the names of all files
    /// are added.
    ///
    /// # Errors
    /// [`ExportError::Io`].
    pub fn finish(self, record: &str) -> Result<(), ExportError> {
        let text = with_files(record, self.folder.path())
            .map_err(|e| ExportError::io("list", self.folder.place(), e))?;
        self.write(RECORD, |out| out.write_all(text.as_bytes()))?;
        Ok(match self.existing {
            // Somebody may have put something there meanwhile.
            Existing::Keep => self.folder.finish(),
            Existing::Replace => self.folder.replace(),
        }?)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use glam::DVec3;
    use io_colmap::SparsePoint;

    #[test]
    fn messages_name_the_place_at_the_end_and_the_file_that_is_to_blame() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let draft = Draft::begin(&out, Existing::Keep).unwrap();
        let begins = |error: ExportError, before: &str, path: &Path| {
            let said = error.to_string();
            let wanted = format!("{before}{}: ", path.display());
            assert!(said.starts_with(&wanted), "{said}");
        };
        let photo = dir.path().join("photo.png");
        fs::write(&photo, "pixels").unwrap();
        draft.copy(&photo, "images/photo.png").unwrap();
        let copy = draft.place("images/photo.png").unwrap();
        assert_eq!(fs::read(copy).unwrap(), b"pixels");

        let gone = dir.path().join("gone.png");
        begins(
            draft.copy(&gone, "a.png").unwrap_err(),
            "cannot read ",
            &gone,
        );
        // Unix opens folders like files.
        begins(
            draft.copy(dir.path(), "a.png").unwrap_err(),
            "cannot read ",
            dir.path(),
        );
        let taken = out.join("images");
        begins(
            draft.copy(&photo, "images").unwrap_err(),
            "cannot write ",
            &taken,
        );
        let below = out.join("images/photo.png");
        begins(
            draft.place("images/photo.png/b").unwrap_err(),
            "cannot create ",
            &below,
        );

        draft.place("sparse/0/cameras.bin/taken").unwrap();
        let model = Model::default();
        begins(
            draft.write_model(&model, "sparse/0").unwrap_err(),
            "cannot write ",
            &out.join("sparse/0/cameras.bin"),
        );
        let nowhere = Model {
            points: vec![SparsePoint {
                id: 1,
                position: DVec3::NAN,
                colour: [0; 3],
                error: 0.0,
                views: Vec::new(),
            }],
            ..model
        };
        begins(
            draft.write_model(&nowhere, "sparse/0").unwrap_err(),
            "",
            &out.join("sparse/0/points3D"),
        );
    }
}
