//! Files that appear in one piece.

use crate::{DraftError, PREFIX, failed, parent};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

/// What a finished file survives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Durability {
    /// The end of the program.
    Program,
    /// A power cut too: it is on the disk before it takes its place.
    Disk,
}

/// Writes a file beside its place and renames it: a full disk leaves no half of it, and what was there stays. Its
/// folder is made if need be. What is no file, such as a pipe or a terminal, is written to as it is.
///
/// # Errors
/// When the folder cannot be made or the file not be written, or what `fill` says.
pub fn write_file(
    path: &Path,
    durability: Durability,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), DraftError> {
    let write = failed("write", path);
    let buffered = |file| BufWriter::with_capacity(1 << 16, file);
    if fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        let to_end = || {
            let mut out = buffered(File::options().write(true).open(path)?);
            fill(&mut out)?;
            out.flush()
        };
        return to_end().map_err(write);
    }
    if path.is_dir() {
        return Err(write(io::ErrorKind::IsADirectory.into()));
    }
    let folder = parent(path);
    fs::create_dir_all(folder).map_err(failed("create the folder", folder))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    {
        // As for any new file: what the user's umask leaves of it, not the private 0600.
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let to_end = || {
        let (file, unfinished) = builder.tempfile_in(folder)?.into_parts();
        let mut out = buffered(file);
        fill(&mut out)?;
        let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        if durability == Durability::Disk {
            file.sync_all()?;
        }
        unfinished.persist(path).map_err(|error| error.error)
    };
    to_end().map_err(write)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_file_is_whole_or_as_it_was() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("deep/down/file");
        write_file(&path, Durability::Disk, |out| out.write_all(b"first")).unwrap();
        let said = write_file(&path, Durability::Program, |out| {
            out.write_all(b"sec")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        let said = said.unwrap_err().to_string();
        assert!(said.starts_with("cannot write "), "{said}");
        assert!(said.ends_with("; free some space"), "{said}");
        assert_eq!(fs::read(&path).unwrap(), b"first");
        write_file(&path, Durability::Program, |out| out.write_all(b"second")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        let said = write_file(root.path(), Durability::Program, |_| Ok(()));
        let said = said.unwrap_err().to_string();
        assert!(said.ends_with("; choose another file"), "{said}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_no_file_is_written_to() {
        let into = |path: &str| {
            write_file(Path::new(path), Durability::Program, |out| {
                out.write_all(b"text")
            })
        };
        into("/dev/null").unwrap();
        let said = into("/dev/full").unwrap_err().to_string();
        assert!(said.ends_with("; free some space"), "{said}");
    }
}
