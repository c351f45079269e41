//! Photos without poses, with a stand-in for COLMAP on the PATH that gives the true ones.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// What every version of COLMAP answers, as far as it is asked; the mapper copies a model.
const COLMAP: &str = r#"#!/bin/sh
if [ "$1" = help ]; then echo 'COLMAP 3.8 -- a stand-in'; exit 0; fi
if [ "$2" = -h ]; then echo '  --database_path arg'; exit 0; fi
if [ "$1" = mapper ]; then mkdir "$7/0"; cp "$TRUTH"/* "$7/0"; echo 'Registering image #2 (9)'; fi
"#;

/// Runs the program where the only other program is in `bin`, apart from the shell's.
fn sos(dir: &Path, path: &str, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .current_dir(dir)
        .env("PATH", path)
        .env("TRUTH", dir.join("truth/sparse/0"))
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap()
}

fn says(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[test]
fn photos_alone_are_captured_and_trained_on() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    crate::fabricated::SCENE.write(&dir.join("truth")).unwrap();
    fs::rename(dir.join("truth/images"), dir.join("photos")).unwrap();
    let photos = fs::read_dir(dir.join("photos")).unwrap().count();

    let train = [
        "train",
        "photos",
        "--masks",
        "truth/coarse_masks",
        "--out",
        "run",
    ];
    let output = sos(dir, "/nowhere", &train);
    assert_eq!(output.status.code(), Some(2));
    let text = says(&output);
    assert!(
        text.contains("photos has photos but no camera poses") && text.contains("install colmap"),
        "{text}"
    );
    assert!(!dir.join("run").exists());

    fs::create_dir(dir.join("bin")).unwrap();
    fs::write(dir.join("colmap.sh"), COLMAP).unwrap();
    // By another process: what is open for writing here, other tests' programs inherit, and it is busy then.
    let install = Command::new("install")
        .args(["-m", "755"])
        .args([dir.join("colmap.sh"), dir.join("bin/colmap")])
        .status();
    assert!(install.unwrap().success());
    let path = format!("{}:/usr/bin:/bin", dir.join("bin").display());
    let output = sos(dir, &path, &["capture", "photos", "--out", "made"]);
    let text = says(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    let answer =
        format!("made: {photos} of {photos} photos have poses; train on it with: sos train made");
    assert!(text.contains(&answer), "{text}");
    assert!(dir.join("made/capture.txt").is_file());
    let output = sos(dir, &path, &["capture", "made", "--out", "again"]);
    assert!(
        says(&output).contains("it has camera poses already"),
        "{}",
        says(&output)
    );
    let output = sos(dir, &path, &["capture", "absent.mp4", "--out", "again"]);
    assert_eq!(output.status.code(), Some(2));

    // What COLMAP found outlives a run that cannot begin.
    let lost = [
        "--masks",
        "none",
        "--click",
        "nobody.jpg:1,1",
        "--out",
        "lost",
    ];
    let output = sos(dir, &path, &[&["train", "photos"][..], &lost].concat());
    let text = says(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(
        text.contains("are kept in lost/scene; go on with: sos train lost/scene --out lost"),
        "{text}"
    );
    assert!(dir.join("lost/scene/sparse").is_dir());
    let output = sos(dir, &path, &[&["train", "lost/scene"][..], &lost].concat());
    let text = says(&output);
    assert!(text.contains("no photo of that name"), "{text}");
    assert!(dir.join("lost/scene/sparse").is_dir(), "{text}");
    // And masks that turn out to be of no use.
    fs::create_dir(dir.join("wrong")).unwrap();
    for photo in fs::read_dir(dir.join("photos")).unwrap().flatten() {
        let stem = Path::new(&photo.file_name()).with_extension("png");
        image::GrayImage::new(60, 8)
            .save(dir.join("wrong").join(stem))
            .unwrap();
    }
    let wrong = ["train", "photos", "--masks", "wrong", "--out", "kept"];
    let output = sos(dir, &path, &wrong);
    let text = says(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(
        text.contains("another shape") && text.contains("are kept in kept/scene"),
        "{text}"
    );
    assert!(dir.join("kept/scene/sparse").is_dir());

    let settings = [
        "steps=4",
        "model.levels=4",
        "model.log2_table_size=12",
        "sampling.target_samples=1024",
        "sampling.occupancy_resolution=32",
        "export.mesh_resolution=32",
    ];
    let mut words = train.to_vec();
    words.extend(["--preset", "quick"]);
    words.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    let output = sos(dir, &path, &words);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    for file in [
        "scene/capture.txt",
        "scene/sparse/0/images.bin",
        "scene/masks",
        "report.html",
    ] {
        assert!(dir.join("run").join(file).exists(), "{file}");
    }
    let leftovers = fs::read_dir(dir.join("run")).unwrap().any(|entry| {
        let name = entry.unwrap().file_name();
        name.to_string_lossy().starts_with(".sos-partial")
    });
    assert!(!leftovers);
    let config = fs::read_to_string(dir.join("run/config.toml")).unwrap();
    assert!(
        config.contains("imported_from") && config.contains("photos"),
        "{config}"
    );
}

/// Whether a program can be started; says so where the test cannot go on without.
fn installed(program: &str) -> bool {
    let found = Command::new(program).arg("-h").output().is_ok();
    if !found {
        eprintln!("skipped: there is no {program} here");
    }
    found
}

/// Photos and a video of the demo scene, with the real programs; skipped where they are not installed.
#[test]
fn photos_and_a_video_are_trained_on_with_the_real_colmap_and_ffmpeg() {
    if !installed("colmap") || !installed("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let config = demo_scene::DemoConfig {
        views: 28,
        mesh_cell: 0.01,
        ..demo_scene::DemoConfig::default()
    };
    demo_scene::generate(&config)
        .write(&dir.join("truth"))
        .unwrap();
    fs::rename(dir.join("truth/images"), dir.join("film")).unwrap();
    // Photos are farther apart than frames.
    fs::create_dir(dir.join("photos")).unwrap();
    for number in (0..28).step_by(2) {
        let name = format!("{number:03}.png");
        fs::copy(dir.join("film").join(&name), dir.join("photos").join(&name)).unwrap();
    }
    let filmed = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-framerate", "4"])
        .args(["-i", "film/%03d.png", "-c:v", "mpeg4", "-q:v", "1"])
        .arg("film.mp4")
        .current_dir(dir)
        .status();
    if !filmed.unwrap().success() {
        eprintln!("skipped: this ffmpeg cannot write the video of the test");
        return;
    }
    let path = std::env::var("PATH").unwrap_or_default();
    let quick = [
        "--preset",
        "quick",
        "--steps",
        "20",
        "--set",
        "model.levels=4",
        "--set",
        "model.log2_table_size=12",
        "--set",
        "export.mesh_resolution=32",
        "--set",
        "export.edge_rays=1",
    ];
    let photos = ["train", "photos", "--masks", "truth/coarse_masks"];
    // Nothing shows the object in a film: it is found, or the next step is named.
    let film = ["train", "film.mp4", "--masks", "none"];
    for (run, words) in [("of_photos", photos), ("of_film", film)] {
        let output = sos(dir, &path, &[&words[..], &["--out", run], &quick].concat());
        let text = says(&output);
        println!("{text}");
        if run == "of_film" && output.status.code() == Some(2) {
            assert!(text.contains("--click"), "{text}");
            continue;
        }
        assert_eq!(output.status.code(), Some(0), "{text}");
        for file in ["scene/capture.txt", "alpha", "report.html"] {
            assert!(dir.join(run).join(file).exists(), "{run}/{file}");
        }
    }
}
