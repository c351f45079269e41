//! A folder that appears when it is complete.

use crate::error::ExportError;
use draft_folder::{Draft as Folder, Existing, Occupant};
use std::fs;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// The file in every folder written here; what lacks it is somebody else's and is never replaced.
pub const RECORD: &str = "export.txt";

/// A folder in the making, beside its place. It is gone if it is dropped before it is finished.
#[derive(Debug)]
pub struct Draft {
    folder: Folder,
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
        Ok(Self { folder })
    }

    /// The folder to write into.
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Where a file belongs, with the folders on the way.
    ///
    /// # Errors
    /// [`ExportError::Io`].
    pub fn place(&self, name: &str) -> Result<PathBuf, ExportError> {
        let path = self.path().join(name);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| ExportError::io("create", folder, e))?;
        }
        Ok(path)
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
        write().map_err(|e| ExportError::io("write", &self.folder.place().join(name), e))
    }

    /// Puts the folder in its place, with a record of what is in it as `export.txt`.
    ///
    /// # Errors
    /// [`ExportError::Io`].
    pub fn finish(self, record: &str) -> Result<(), ExportError> {
        self.write(RECORD, |out| out.write_all(record.as_bytes()))?;
        Ok(self.folder.replace()?)
    }
}
