//! How Brush finds photos and masks by their names, and which names that mixes up.
//!
//! A photo is any file whose path ends in its name; a mask lies in a folder `masks`, below which its folders are the
//! last of the photo's. Neither looks at small and capital letters.

use crate::error::ExportError;
use crate::run::Posed;
use io_colmap::{Scene, without_ending};
use std::collections::HashMap;

/// A photo and another one, whose file or mask could be taken for its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mixed {
    /// By number.
    With(usize, usize),
    /// In a folder that Brush has for masks.
    WithMasks(usize),
}

/// Refuses photos that Brush would mix up.
pub(crate) fn check(
    scene: &Scene,
    posed: &[Posed<'_>],
    names: &[String],
) -> Result<(), ExportError> {
    let Some(mixed) = mixed(names, true) else {
        return Ok(());
    };
    Err(ExportError::bad(
        &scene.image_path(posed[mixed.photo()].view),
        mixed.what(names),
        "rename it in the photo folder and the model, and make the run again",
    ))
}

impl Mixed {
    /// The number of the first of the two.
    pub(crate) fn photo(self) -> usize {
        let (Mixed::With(photo, _) | Mixed::WithMasks(photo)) = self;
        photo
    }

    /// What is the matter with it.
    pub(crate) fn what(self, names: &[String]) -> String {
        match self {
            Mixed::With(_, other) => format!(
                "Brush finds photos and masks by the end of their paths, and would mix this one up with {:?}",
                names[other]
            ),
            Mixed::WithMasks(_) => {
                "the photo is in a folder named masks, where Brush looks for no photos".to_owned()
            }
        }
    }
}

/// The first photo that is mixed up, by its file or, where there are masks, by its mask.
pub(crate) fn mixed(names: &[String], with_masks: bool) -> Option<Mixed> {
    let files: HashMap<String, usize> = names
        .iter()
        .map(|name| name.to_lowercase())
        .zip(0..)
        .collect();
    let masks: HashMap<(&str, String), usize> = names
        .iter()
        .map(|name| {
            let (folder, file) = split(name);
            (folder, without_ending(file).to_ascii_lowercase())
        })
        .zip(0..)
        .collect();
    for (photo, name) in names.iter().enumerate() {
        let path = format!("images/{name}");
        let (folder, file) = split(&path);
        if folder
            .split('/')
            .any(|part| part.eq_ignore_ascii_case("masks"))
        {
            return Some(Mixed::WithMasks(photo));
        }
        let mut others = ends(&path)
            .filter_map(|end| files.get(&end.to_lowercase()))
            .collect::<Vec<_>>();
        if with_masks {
            let stem = without_ending(file);
            let stems = [file.to_owned(), stem.to_owned(), format!("{stem}.mask")];
            for folder in ends(folder).chain([""]) {
                for stem in &stems {
                    others.extend(masks.get(&(folder, stem.to_ascii_lowercase())));
                }
            }
        }
        if let Some(other) = others.into_iter().find(|other| **other != photo) {
            return Some(Mixed::With(photo, *other));
        }
    }
    None
}

/// A path without its first folders, none to all but the last part.
fn ends(path: &str) -> impl Iterator<Item = &str> {
    let after = path.match_indices('/').map(|(at, _)| &path[at + 1..]);
    [path].into_iter().chain(after)
}

/// Folder and file.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_paths_are_mixed_up() {
        let found = |names: &[&str], with_masks| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            mixed(&names, with_masks)
        };
        for (names, files, masks) in [
            // A usual rig, and names that only look alike.
            (&["a/1.png", "b/1.png"][..], None, None),
            (&["1.png", "11.png", "a1.png"], None, None),
            (&["1.png", "a/1.png"], Some((1, 0)), Some((1, 0))),
            (&["1.png", "a/b/1.PNG"], Some((1, 0)), Some((1, 0))),
            (&["b/1.png", "a/b/1.png"], Some((1, 0)), Some((1, 0))),
            (&["1.png", "images/1.png"], Some((0, 1)), Some((0, 1))),
            // By their masks alone, which have endings of their own.
            (&["1.png", "a/1.jpg"], None, Some((1, 0))),
            (&["1.jpg", "1.jpg.png"], None, Some((0, 1))),
            (&["1.jpg", "1.mask.jpg"], None, Some((0, 1))),
        ] {
            let with = |pair: Option<(usize, usize)>| pair.map(|(a, b)| Mixed::With(a, b));
            assert_eq!(found(names, false), with(files), "{names:?}");
            assert_eq!(found(names, true), with(masks), "{names:?}");
        }
        assert_eq!(
            found(&["a.png", "Masks/b.png"], true),
            Some(Mixed::WithMasks(1))
        );
    }
}
