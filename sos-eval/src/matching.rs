//! Which file of one folder shows which view of another.

use crate::EvalError;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

/// Files with their names without extension, below a folder and with `/` between, sorted by name.
pub(crate) type Pictures = BTreeMap<String, PathBuf>;

/// Folders within folders that are looked into: photos of several cameras lie in one each.
const DEPTH: usize = 4;

/// Lists the PNG and JPEG files of a folder and of those in it; hidden ones and all other files are skipped.
pub(crate) fn list_pictures(folder: &Path) -> Result<Pictures, EvalError> {
    let mut pictures = Pictures::new();
    add_pictures(folder, "", DEPTH, &mut pictures)?;
    if pictures.is_empty() {
        return Err(EvalError::EmptyFolder {
            path: folder.to_owned(),
        });
    }
    Ok(pictures)
}

/// Adds those of `folder`, their names beginning with `prefix`.
fn add_pictures(
    folder: &Path,
    prefix: &str,
    depth: usize,
    pictures: &mut Pictures,
) -> Result<(), EvalError> {
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
                add_pictures(&path, &format!("{name}/"), depth - 1, pictures)?;
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
        if let Some(first) = pictures.insert(stem.clone(), path.clone()) {
            return Err(ambiguous(&stem, &first, &path));
        }
    }
    Ok(())
}

/// Prefix and trailing number of a name, as far as a round compares them.
type Key<'a> = (&'a str, Option<&'a str>);

/// The file of `folder` for each view of `truth`, `None` where it has none.
///
/// In four rounds, each among the files and views still free: equal names; equal but for the folders they are in; equal
/// but for the zero padding of the trailing number (`view_7`, `view_0007`); equal trailing number (`alpha_7`, `007`).
/// Two candidates for one view, or two views for one file, in a round are an error, as is a folder
/// without any match.
pub(crate) fn match_views(
    truth_folder: &Path,
    truth: &Pictures,
    folder: &Path,
) -> Result<BTreeMap<String, PathBuf>, EvalError> {
    let files = list_pictures(folder)?;
    let keys: [fn(&str) -> Option<Key<'_>>; 4] = [
        |stem| Some((stem, None)),
        |stem| Some((stem.rsplit('/').next().unwrap_or(stem), None)),
        |stem| trailing_number(stem).map(|(prefix, number)| (prefix, Some(number))),
        |stem| trailing_number(stem).map(|(_, number)| ("", Some(number))),
    ];
    let mut matched: BTreeMap<String, PathBuf> = BTreeMap::new();
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
        return Err(EvalError::NoMatch {
            folder: folder.to_owned(),
            truth: truth_folder.to_owned(),
        });
    }
    Ok(matched)
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
