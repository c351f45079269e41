//! Which file of one folder shows which view of another.

use crate::EvalError;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};

/// Files with their names without extension, below a folder and with `/` between, sorted by name.
pub(crate) type Pictures = BTreeMap<String, PathBuf>;

/// Folders within folders that are looked into: photos of several cameras lie in one each.
const DEPTH: usize = 4;

/// The pictures in a folder, and the sub-folders that may hold more.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    /// By their own names, or by those of the views that they show.
    pub(crate) pictures: Pictures,
    /// Sub-folders that cannot be read, and why.
    closed: Vec<(PathBuf, String)>,
}

/// Lists the PNG and JPEG files of a folder and of those in it; hidden ones and all other files are skipped.
///
/// A sub-folder that cannot be read, such as the `lost+found` of a disk, is no reason to do without all others.
pub(crate) fn list_pictures(folder: &Path) -> Result<Listing, EvalError> {
    let mut listing = Listing::default();
    listing.add(folder, "", DEPTH)?;
    listing.closed.sort();
    if listing.pictures.is_empty() {
        let nothing = EvalError::EmptyFolder {
            path: folder.to_owned(),
        };
        return Err(listing.lacks(folder, ".png, .jpg or .jpeg picture", nothing));
    }
    Ok(listing)
}

impl Listing {
    /// Adds the files of `folder`, their names beginning with `prefix`.
    fn add(&mut self, folder: &Path, prefix: &str, depth: usize) -> Result<(), EvalError> {
        let fail = |e: std::io::Error| EvalError::Folder {
            path: folder.to_owned(),
            reason: e.to_string(),
        };
        for entry in std::fs::read_dir(folder).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            let (Some(name), Some(stem)) = (path.file_name(), path.file_stem()) else {
                continue;
            };
            let name = format!("{prefix}{}", name.to_string_lossy());
            let stem = format!("{prefix}{}", stem.to_string_lossy());
            if stem[prefix.len()..].starts_with('.') {
                continue;
            }
            if path.is_dir() {
                if depth > 0 {
                    match self.add(&path, &format!("{name}/"), depth - 1) {
                        Err(EvalError::Folder { path, reason }) => self.closed.push((path, reason)),
                        added => added?,
                    }
                }
                continue;
            }
            let known = path.extension().is_some_and(|extension| {
                ["png", "jpg", "jpeg"]
                    .iter()
                    .any(|known| extension.eq_ignore_ascii_case(known))
            });
            if !known || !path.is_file() {
                continue;
            }
            if let Some(first) = self.pictures.insert(stem.clone(), path.clone()) {
                return Err(ambiguous(&stem, &first, &path));
            }
        }
        Ok(())
    }

    /// Why there is nothing of what is wanted: it may lie where nobody can look, else it is `nowhere`.
    pub(crate) fn lacks(
        &self,
        folder: &Path,
        wanted: impl Into<String>,
        nowhere: EvalError,
    ) -> EvalError {
        let closed = self.closed.first();
        closed.map_or(nowhere, |closed| unseen(folder, wanted, closed))
    }
}

/// A picture that is wanted of `folder` and may lie in a sub-folder that cannot be read.
fn unseen(
    folder: &Path,
    wanted: impl Into<String>,
    (closed, reason): &(PathBuf, String),
) -> EvalError {
    EvalError::ClosedFolder {
        path: folder.to_owned(),
        wanted: wanted.into(),
        closed: closed.clone(),
        reason: reason.clone(),
    }
}

/// What was left out of several folders, a sentence each.
pub(crate) fn left_out<'a>(listings: impl IntoIterator<Item = &'a Listing>) -> Vec<String> {
    let closed: BTreeSet<_> = listings
        .into_iter()
        .flat_map(|listing| &listing.closed)
        .collect();
    let sentence = |(folder, reason): &(PathBuf, String)| {
        format!(
            "the sub-folder {} cannot be read and is left out ({reason})",
            folder.display()
        )
    };
    closed.into_iter().map(sentence).collect()
}

/// Prefix and trailing number of a name, as far as a round compares them.
type Key<'a> = (&'a str, Option<&'a str>);

/// The file of `folder` for each view of `truth`, `None` where it has none.
///
/// In four rounds, each among the files and views still free: equal names; equal but for the folders they are in; equal
/// but for the zero padding of the trailing number (`view_7`, `view_0007`); equal trailing number (`alpha_7`, `007`).
/// Two candidates for one view, or two views for one file, in a round are an error, as is a folder
/// without any match, and a view without one whose place is in a sub-folder that cannot be read.
pub(crate) fn match_views(
    truth_folder: &Path,
    truth: &Pictures,
    folder: &Path,
) -> Result<Listing, EvalError> {
    let listing = list_pictures(folder)?;
    let files = &listing.pictures;
    let keys: [fn(&str) -> Option<Key<'_>>; 4] = [
        |stem| Some((stem, None)),
        |stem| Some((stem.rsplit('/').next().unwrap_or(stem), None)),
        |stem| trailing_number(stem).map(|(prefix, number)| (prefix, Some(number))),
        |stem| trailing_number(stem).map(|(_, number)| ("", Some(number))),
    ];
    let mut matched = Pictures::new();
    let mut taken: HashSet<&str> = HashSet::new();
    for key in keys {
        let mut free = BTreeMap::new();
        for stem in files
            .keys()
            .map(String::as_str)
            .filter(|stem| !taken.contains(stem))
        {
            if let Some(key) = key(stem) {
                free.entry(key).or_insert_with(Vec::new).push(stem);
            }
        }
        let mut claims: BTreeMap<&str, &String> = BTreeMap::new();
        let waiting: Vec<&String> = truth
            .keys()
            .filter(|view| !matched.contains_key(*view))
            .collect();
        for view in waiting {
            let Some(candidates) = key(view).and_then(|key| free.get(&key)) else {
                continue;
            };
            let stem = candidates[0];
            if let Some(second) = candidates.get(1) {
                return Err(ambiguous(view, &files[stem], &files[*second]));
            }
            if let Some(other) = claims.insert(stem, view) {
                return Err(ambiguous(stem, &truth[other], &truth[view]));
            }
            taken.insert(stem);
            matched.insert(view.clone(), files[stem].clone());
        }
    }
    if matched.is_empty() {
        let nothing = EvalError::NoMatch {
            folder: folder.to_owned(),
            truth: truth_folder.to_owned(),
        };
        let wanted = format!(
            "picture with the name or number of one in {}",
            truth_folder.display()
        );
        return Err(listing.lacks(folder, wanted, nothing));
    }
    // To count a view as empty would be a verdict on what nobody could see.
    for view in truth.keys().filter(|view| !matched.contains_key(*view)) {
        let place = folder.join(view);
        let mut closed = listing.closed.iter();
        if let Some(closed) = closed.find(|(closed, _)| place.starts_with(closed)) {
            return Err(unseen(folder, format!("picture of view {view:?}"), closed));
        }
    }
    Ok(Listing {
        pictures: matched,
        closed: listing.closed,
    })
}

fn ambiguous(view: &str, first: &Path, second: &Path) -> EvalError {
    EvalError::Ambiguous {
        view: view.to_owned(),
        first: first.to_owned(),
        second: second.to_owned(),
    }
}

/// `"frame_0012"` is `("frame_", "12")`; zeros in front do not count.
fn trailing_number(stem: &str) -> Option<(&str, &str)> {
    let prefix = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let digits = &stem[prefix.len()..];
    if digits.is_empty() {
        return None;
    }
    let number = digits.trim_start_matches('0');
    Some((prefix, if number.is_empty() { "0" } else { number }))
}
