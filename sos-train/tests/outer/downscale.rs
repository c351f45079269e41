//! Training on smaller photos.

use std::fs;
use std::process::Command;

#[test]
fn results_keep_the_size_of_the_photos() {
    let dir = tempfile::tempdir().unwrap();
    crate::fabricated::SCENE
        .write(&dir.path().join("scene"))
        .unwrap();
    let train = |more: &[&str]| crate::tiny::train(dir.path(), more);
    let begin = [
        "scene",
        "--masks",
        "scene/coarse_masks",
        "--preset",
        "quick",
        "--steps",
        "2",
    ];
    let (code, said) = train(&[&begin[..], &["--downscale", "3"]].concat());
    assert_eq!(code, Some(0), "{said}");
    let run = dir.path().join("run");
    assert!(
        fs::read_to_string(run.join("config.toml"))
            .unwrap()
            .contains("downscale = 3")
    );
    for picture in ["alpha/000.png", "foreground/005.png", "background/003.png"] {
        assert_eq!(
            image::image_dimensions(run.join(picture)).unwrap(),
            (96, 72),
            "{picture}"
        );
    }
    let (code, said) = train(&["--resume", "--downscale", "2"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("prepare.downscale is 3"), "{said}");
    let (code, said) = train(&["--resume", "--steps", "3"]);
    assert_eq!(code, Some(0), "{said}");
    // Its record would say that it had fewer.
    let before = fs::read_to_string(run.join("config.toml")).unwrap();
    let (code, said) = train(&["--resume", "--steps", "2"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("at step 3 already"), "{said}");
    assert_eq!(fs::read_to_string(run.join("config.toml")).unwrap(), before);
    // Drawn from elsewhere, the run needs tables of the size that it was trained with.
    let draw = ["render", "run", "--turntable", "1", "--size", "16"];
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(draw)
        .current_dir(dir.path())
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let frame = run.join("render/turntable/object/0000.png");
    assert_eq!(image::image_dimensions(frame).unwrap(), (16, 12));
    let (code, said) = train(&["scene", "--force", "--downscale", "0"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("prepare.downscale = 0"), "{said}");
}
