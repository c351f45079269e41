//! Which file is read, where one is named.

use crate::fixtures::{self, import};
use io_colmap::Scene;
use scene_import::{Format, MaskOptions, detect, read};
use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn a_named_file_is_not_replaced_by_another() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    for name in ["cameras.xml", "poses.txt", "images/0001.png", "table.csv"] {
        let path = dir.path().join(name);
        if !path.exists() {
            fs::write(&path, "nothing that is known").unwrap();
        }
        let error = detect(&path, None).unwrap_err().to_string();
        let says = format!(
            "{}: this file is in none of the known formats; give",
            path.display()
        );
        assert!(error.starts_with(&says), "{error}");
    }
}

#[test]
fn the_files_of_a_model_or_sequence_stand_for_the_whole() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let written = dir.path().join("written");
    let imported = import(dir.path(), Format::Transforms).unwrap();
    imported.write(&written, &MaskOptions::default()).unwrap();
    for name in ["images.bin", "cameras.bin"] {
        let detected = detect(&written.join("sparse/0").join(name), None).unwrap();
        assert_eq!(detected.format, Format::Colmap);
        assert_eq!(read(&detected, None).unwrap().model.views.len(), 4);
    }
    assert!(Scene::open(&written).is_ok());
    assert!(detect(&written.join("import.txt"), None).is_err());

    let sequence = dir.path().join("freiburg1");
    fixtures::tum(&sequence);
    for name in ["groundtruth.txt", "rgb.txt"] {
        let detected = detect(&sequence.join(name), None).unwrap();
        assert_eq!(detected.format, Format::Tum);
        assert_eq!(detected.source, sequence.join("groundtruth.txt"));
    }
}

/// Set in the process that works in the folder of a scene, which all tests of one would share.
const INSIDE: &str = "SOS_TEST_INSIDE_SCENE";

#[test]
fn a_file_may_be_named_from_the_folder_it_is_in() {
    if std::env::var_os(INSIDE).is_some() {
        for name in ["groundtruth.txt", "./groundtruth.txt"] {
            let detected = detect(Path::new(name), None).unwrap();
            assert_eq!(detected.format, Format::Tum, "{name}");
        }
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    // One that is preferred, unless the other is named.
    fixtures::transforms(dir.path(), |_| {});
    fixtures::tum(dir.path());
    let status = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "detection::a_file_may_be_named_from_the_folder_it_is_in",
        ])
        .current_dir(dir.path())
        .env(INSIDE, "1")
        .status();
    assert!(status.unwrap().success());
}
