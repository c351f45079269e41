//! What is in a folder that should be empty.

use crate::PREFIX;
use std::ffi::OsString;
use std::fmt;
use std::fs;
use std::io;
use std::path::Path;

/// One entry of a folder that should be empty, to be named in a message: a plain listing shows no hidden ones.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Occupant {
    /// Whether it is a draft that was never finished.
    is_leftover: bool,
    name: OsString,
}

impl Occupant {
    /// The entry that is known best: one that is shown before one that is hidden, and a draft that was never finished
    /// last. `None` where the folder is empty or not there.
    ///
    /// # Errors
    /// When the folder cannot be read, or is none.
    pub fn of(folder: &Path) -> io::Result<Option<Self>> {
        let entries = match fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error),
        };
        let mut all = Vec::new();
        for entry in entries {
            let name = entry?.file_name();
            let shown = name.to_string_lossy();
            // With that ending it is what was in the folder before, which is nowhere else.
            let is_leftover = shown.starts_with(PREFIX) && !shown.ends_with(".old");
            all.push((is_leftover, shown.starts_with('.'), name));
        }
        let first = all.into_iter().min();
        Ok(first.map(|(is_leftover, _, name)| Self { is_leftover, name }))
    }

    /// Whether it is a draft whose program was killed, or still writes it.
    #[must_use]
    pub fn is_leftover(&self) -> bool {
        self.is_leftover
    }

    /// What to do: `otherwise`, or to delete it where it is a draft that was never finished.
    #[must_use]
    pub fn remedy(&self, otherwise: &str) -> String {
        if self.is_leftover {
            format!(
                "delete what begins with {PREFIX} there if no program is writing it, or {otherwise}"
            )
        } else {
            otherwise.to_owned()
        }
    }
}

/// After "there is something in it, ".
impl fmt::Display for Occupant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "such as {}", Path::new(&self.name).display())?;
        if self.is_leftover {
            f.write_str(", which a program that was killed has left")?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::Draft;

    #[test]
    fn what_is_hidden_is_named_and_what_was_left_may_be_deleted() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("out");
        assert_eq!(Occupant::of(&folder).unwrap(), None);
        fs::create_dir(&folder).unwrap();
        assert_eq!(Occupant::of(&folder).unwrap(), None);
        let said = || {
            let occupant = Occupant::of(&folder).unwrap().unwrap();
            (occupant.to_string(), occupant.remedy("go elsewhere"))
        };

        // As a program that is killed leaves it.
        let draft = Draft::beside(&folder.join("inner")).unwrap();
        let name = draft.path().file_name().unwrap().to_str().unwrap();
        let (what, remedy) = said();
        assert!(what.contains(name) && what.contains("was killed"), "{what}");
        assert!(
            remedy.starts_with("delete what begins with .sos-partial-"),
            "{remedy}"
        );
        assert!(remedy.ends_with(", or go elsewhere"), "{remedy}");
        // It holds what was there before.
        let aside = folder.join(name).with_extension("old");
        fs::create_dir(&aside).unwrap();
        let said_of = |name: &str| (format!("such as {name}"), "go elsewhere".to_owned());
        assert_eq!(said(), said_of(&format!("{name}.old")));
        fs::remove_dir(&aside).unwrap();
        for name in [".hidden", "b", "a"] {
            fs::write(folder.join(name), "").unwrap();
            assert_eq!(said(), said_of(name));
        }
        assert!(Occupant::of(&folder.join("a")).is_err());
    }
}
