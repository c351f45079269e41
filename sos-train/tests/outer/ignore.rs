//! Parts of photos that are not learned from.

use image::{GrayImage, Luma};
use std::fs;
use std::process::Command;

#[test]
fn what_is_ignored_is_said_recorded_and_left_out_of_plates() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    let train = |out: &str, more: &[&str]| {
        let quick = [
            "train",
            "scene",
            "--out",
            out,
            "--masks",
            "scene/coarse_masks",
            "--preset",
            "quick",
            "--steps",
            "2",
            "--set",
            "export.mesh_resolution=16",
        ];
        let output = Command::new(env!("CARGO_BIN_EXE_sos"))
            .args([&quick[..], more].concat())
            .current_dir(dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{said}");
        said
    };
    let photo = |path: &str| image::open(dir.path().join(path)).unwrap().into_rgb8();
    let corner = |path: &str| photo(path).get_pixel(2, 2).0;

    assert!(!train("plain", &[]).contains("not learned from"));
    let shown = corner("scene/images/003.png");
    assert_eq!(corner("plain/background/003.png"), shown);

    // Someone stands at the left of one photo.
    fs::create_dir(scene.join("ignore")).unwrap();
    let someone = GrayImage::from_fn(96, 72, |x, _| Luma([if x < 10 { 255 } else { 0 }]));
    someone.save(scene.join("ignore/003.png")).unwrap();
    let said = train("run", &[]);
    assert!(
        said.contains("parts of 1 photo are not learned from"),
        "{said}"
    );
    let record = fs::read_to_string(dir.path().join("run/config.toml")).unwrap();
    assert!(record.contains("scene/ignore\""), "{record}");
    // The plate shows what the other photos say is there: after two steps, something else.
    assert_ne!(corner("run/background/003.png"), shown);
    let beside = |path: &str| photo(path).get_pixel(12, 2).0;
    assert_eq!(
        beside("run/background/003.png"),
        beside("scene/images/003.png")
    );
}

#[test]
fn pictures_that_hide_everything_are_the_wrong_way_round() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    fs::create_dir(scene.join("ignore")).unwrap();
    for photo in fs::read_dir(scene.join("images")).unwrap().flatten() {
        let white = GrayImage::from_pixel(96, 72, Luma([255]));
        white
            .save(scene.join("ignore").join(photo.file_name()))
            .unwrap();
    }
    for command in [
        &["doctor", "scene"][..],
        &[
            "train",
            "scene",
            "--masks",
            "scene/coarse_masks",
            "--out",
            "run",
        ],
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_sos"))
            .args(command)
            .current_dir(dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("hide 100 % of the photos"), "{said}");
    }
}
