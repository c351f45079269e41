//! The working folder as a draft's place, in a process of its own, as it is the same for all threads.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

use draft_folder::Draft;
use std::fs;
use std::path::Path;

fn draft(place: &str, file: &str) -> Draft {
    let draft = Draft::beside(Path::new(place)).unwrap();
    fs::create_dir(draft.path().join("folder")).unwrap();
    fs::write(draft.path().join("folder").join(file), "").unwrap();
    draft
}

#[test]
fn a_program_may_fill_the_folder_it_works_in_or_one_above() {
    let root = tempfile::tempdir().unwrap();
    let place = root.path().join("place");
    fs::create_dir(&place).unwrap();
    std::env::set_current_dir(&place).unwrap();
    draft(".", "first").finish().unwrap();
    // As seen by whoever is in the folder, and by others.
    assert!(Path::new("folder/first").is_file());
    assert!(place.join("folder/first").is_file());
    draft(".", "second").replace().unwrap();
    assert!(Path::new("folder/second").is_file() && !Path::new("folder/first").exists());

    std::env::set_current_dir("folder").unwrap();
    draft("../../place", "third").replace().unwrap();
    assert!(place.join("folder/third").is_file() && !place.join("folder/second").exists());
    assert_eq!(fs::read_dir(&place).unwrap().count(), 1);
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
}
