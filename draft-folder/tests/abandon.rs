//! A program that is told to end. In a process of its own, for no draft takes its place afterwards.
#![allow(clippy::unwrap_used)]

use std::fs;

use draft_folder::{Draft, abandon_all};

#[test]
fn what_is_not_finished_is_gone_and_what_is_stays() {
    let root = tempfile::tempdir().unwrap();
    let finished = Draft::beside(&root.path().join("finished")).unwrap();
    fs::write(finished.path().join("file"), "").unwrap();
    finished.finish().unwrap();
    let replaced = Draft::beside(&root.path().join("finished")).unwrap();
    fs::write(replaced.path().join("other"), "").unwrap();
    replaced.replace().unwrap();
    let dropped = Draft::beside(&root.path().join("dropped")).unwrap();
    drop(dropped);
    let open = Draft::beside(&root.path().join("open")).unwrap();
    fs::create_dir(open.path().join("folder")).unwrap();
    fs::write(open.path().join("folder/file"), "").unwrap();

    abandon_all();
    assert!(!open.path().exists());
    let left: Vec<_> = fs::read_dir(root.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(left, ["finished"]);
    assert!(root.path().join("finished/other").exists());
}
