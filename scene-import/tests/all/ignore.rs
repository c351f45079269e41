//! What is not to be learned from comes along with the scene.

use crate::fixtures;
use crate::rig::{HEIGHT, WIDTH, write_photos};
use image::{DynamicImage, GrayImage, Luma};
use io_colmap::{MaskSet, Scene};
use scene_import::{MaskOptions, MaskSource, detect, read};
use std::fs;
use std::path::Path;

/// Someone stands at the left, and fades out.
fn someone(width: u32, height: u32) -> GrayImage {
    GrayImage::from_fn(width, height, |x, _| {
        Luma([match 8 * x / width {
            0 => 255,
            1 => 3,
            _ => 0,
        }])
    })
}

fn save(picture: impl Into<DynamicImage>, path: &Path) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    picture.into().save(path).unwrap();
}

#[test]
fn pictures_that_belong_to_photos_are_written_named_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, out) = (dir.path().join("scene"), dir.path().join("out"));
    fixtures::transforms(&scene, |_| {});
    let ignore = scene.join("ignore");
    save(someone(WIDTH, HEIGHT), &ignore.join("0001.png"));
    save(someone(WIDTH, HEIGHT), &ignore.join("0003.png.png"));
    save(someone(WIDTH, HEIGHT), &ignore.join("other.png"));
    // Also where the file with the poses is named, and no masks are wanted.
    let imported = read(&detect(&scene.join("transforms.json"), None).unwrap(), None).unwrap();
    let options = MaskOptions {
        source: MaskSource::None,
        ..MaskOptions::default()
    };
    let written = imported.write(&out, &options).unwrap();
    assert_eq!((written.masks, written.ignored), (0, 2));
    let record = fs::read_to_string(out.join("import.txt")).unwrap();
    for says in [
        "what is not to be learned from is taken from ",
        "2 of 4 photos have an ignore picture",
        "what is not black is ignored",
        "1 files in ",
    ] {
        assert!(record.contains(says), "{says:?} is not in {record}");
        assert!(written.notes.iter().any(|note| note.contains(says)));
    }
    let opened = Scene::open(&out).unwrap();
    let set = MaskSet::find_ignored(&out.join("ignore"), &opened).unwrap();
    let found: Vec<_> = (0..4)
        .map(|i| set.load(i, WIDTH, HEIGHT).unwrap())
        .collect();
    let expected = Some(someone(WIDTH, HEIGHT));
    assert_eq!(found, [expected.clone(), None, expected, None]);
    assert_eq!(fs::read_dir(out.join("ignore")).unwrap().count(), 2);
}

#[test]
fn another_folder_may_be_named_and_one_of_no_use_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    fixtures::transforms(&scene, |_| {});
    save(someone(WIDTH, HEIGHT), &scene.join("people/0002.png"));
    save(someone(WIDTH, HEIGHT), &scene.join("ignore/x.png"));
    let imported = read(&detect(&scene, None).unwrap(), None).unwrap();
    let out = dir.path().join("out");
    let error = imported.write(&out, &MaskOptions::default()).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("ignore: none of the 1 ignore pictures") && !out.exists(),
        "{error}"
    );
    let named = MaskOptions {
        ignore: Some(scene.join("people")),
        ..MaskOptions::default()
    };
    let written = imported.write(&out, &named).unwrap();
    assert_eq!(written.ignored, 1);
    assert!(out.join("ignore/0002.png").is_file());
}

#[test]
fn a_scene_without_any_has_none() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, out) = (dir.path().join("scene"), dir.path().join("out"));
    fixtures::transforms(&scene, |_| {});
    write_photos(&scene.join("ignored"));
    let imported = read(&detect(&scene, None).unwrap(), None).unwrap();
    let written = imported.write(&out, &MaskOptions::default()).unwrap();
    assert_eq!(written.ignored, 0);
    assert!(!out.join("ignore").exists());
}
