//! A run stays in the box that it began in.

use std::fs;
use std::path::Path;

/// What a training says of its box.
fn boxed(dir: &Path, more: &[&str]) -> String {
    let (code, said) = crate::tiny::train(dir, more);
    assert_eq!(code, Some(0), "{said}");
    let line = said.lines().find(|line| line.starts_with("object box:"));
    line.expect("a box").to_owned()
}

#[test]
fn masks_that_change_later_do_not_move_it() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    let begin = [
        "scene",
        "--masks",
        "scene/coarse_masks",
        "--preset",
        "quick",
    ];
    let first = boxed(dir.path(), &[&begin[..], &["--steps", "2"]].concat());
    // Their upper halves are gone.
    for entry in fs::read_dir(scene.join("coarse_masks")).unwrap() {
        let path = entry.unwrap().path();
        let mut mask = image::open(&path).unwrap().into_luma8();
        let half = mask.height() / 2;
        for (_, _, pixel) in mask.enumerate_pixels_mut().filter(|(_, y, _)| *y < half) {
            pixel.0 = [0];
        }
        mask.save(&path).unwrap();
    }
    let went_on = boxed(dir.path(), &["--resume", "--steps", "3"]);
    assert_eq!(went_on, first);
    let anew = boxed(
        dir.path(),
        &[&begin[..], &["--steps", "2", "--force"]].concat(),
    );
    assert_ne!(anew, first);
}
