//! What an exported folder says about itself, and what in it is of other origin.

use crate::error::ExportError;
use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The file in every folder written here; what lacks it is somebody else's and is never replaced.
pub const RECORD: &str = "export.txt";

/// The line of a record above the files that were exported with it.
const HEADING: &str =
    "Files (the folder is replaced with --force only as long as nothing else is in it):";
/// Before every file.
const INDENT: &str = "  ";
/// What file managers leave in folders that somebody looks at.
const LITTER: [&str; 3] = [".DS_Store", "Thumbs.db", "desktop.ini"];
/// Of files of other origin, as many are named.
const NAMED: usize = 3;

/// A record with the names of all files below a folder.
pub(crate) fn with_files(record: &str, folder: &Path) -> io::Result<String> {
    let mut names: Vec<String> = files_below(folder)?
        .into_iter()
        .map(|(name, _)| name)
        .collect();
    names.sort();
    let mut text = record.trim_end().to_owned();
    text.push_str(&format!("\n\n{HEADING}\n"));
    for name in names {
        text.push_str(&format!("{INDENT}{name}\n"));
    }
    Ok(text)
}

/// Refuses to replace an exported folder that holds what was not exported with it: programs write into the folders
/// that they are given, and what they did takes hours.
pub(crate) fn refuse_others(folder: &Path) -> Result<(), ExportError> {
    let others = files_of_others(folder).map_err(|e| ExportError::io("list", folder, e))?;
    if others.is_empty() {
        return Ok(());
    }
    let named = others.len().min(NAMED);
    let mut what = format!(
        "there is something in it that was not exported, {}",
        others[..named].join(", ")
    );
    if others.len() > named {
        what.push_str(&format!(" and {} more", others.len() - named));
    }
    Err(ExportError::bad(
        folder,
        format!("{what}: it is never replaced"),
        "move that elsewhere or delete it, or choose another folder with --out",
    ))
}

/// The files in an exported folder that were not exported with it, sorted: names below it.
///
/// # Errors
/// When it or its [`RECORD`] cannot be read.
pub fn files_of_others(folder: &Path) -> io::Result<Vec<String>> {
    let record = folder.join(RECORD);
    let text = String::from_utf8_lossy(&fs::read(&record)?).into_owned();
    let mut lines = text.lines();
    let own: Option<HashSet<&str>> = lines
        .any(|line| line == HEADING)
        .then(|| lines.filter_map(|line| line.strip_prefix(INDENT)).collect());
    let written = fs::metadata(&record)?.modified()?;
    let mut others = Vec::new();
    for (name, path) in files_below(folder)? {
        let is_own = match &own {
            Some(own) => own.contains(name.as_str()),
            // Earlier records have no list, but were the last thing to be written.
            None => fs::symlink_metadata(&path)?.modified()? <= written,
        };
        let file = name.rsplit('/').next().unwrap_or_default();
        // What an export that was killed has left.
        let is_partial = name.starts_with(draft_folder::PREFIX);
        if !is_own && name != RECORD && !is_partial && !LITTER.contains(&file) {
            others.push(name);
        }
    }
    others.sort();
    Ok(others)
}

/// What is below a folder apart from folders, as a record names it, with its path. Links are not followed.
fn files_below(folder: &Path) -> io::Result<Vec<(String, PathBuf)>> {
    let mut files = Vec::new();
    let mut folders = vec![(String::new(), folder.to_path_buf())];
    while let Some((prefix, next)) = folders.pop() {
        for entry in fs::read_dir(next)? {
            let entry = entry?;
            // A line has to hold it.
            let name = entry
                .file_name()
                .to_string_lossy()
                .replace(char::is_control, "?");
            let name = format!("{prefix}{name}");
            if entry.file_type()?.is_dir() {
                folders.push((format!("{name}/"), entry.path()));
            } else {
                files.push((name, entry.path()));
            }
        }
    }
    Ok(files)
}
