//! A run that is interrupted, and goes on.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

fn sos(dir: &Path, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .current_dir(dir)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits until `path` is there.
fn wait_for(path: &Path, run: &mut Child) {
    let started = Instant::now();
    while !path.exists() {
        assert!(run.try_wait().unwrap().is_none(), "the run ended early");
        assert!(
            started.elapsed() < Duration::from_secs(120),
            "no {} after two minutes",
            path.display()
        );
        sleep(Duration::from_millis(20));
    }
}

fn interrupt(run: &Child) {
    let sent = Command::new("kill")
        .args(["-INT", &run.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
}

fn says(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder that is being written is gone, or has been whole before the signal came.
#[test]
fn ctrl_c_leaves_nothing_half_written() {
    let dir = tempfile::tempdir().unwrap();
    let names = || -> Vec<String> {
        fs::read_dir(dir.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    };
    let mut run = sos(dir.path(), &["demo-scene", "scene"]);
    while names().is_empty() && run.try_wait().unwrap().is_none() {
        sleep(Duration::from_millis(1));
    }
    if run.try_wait().unwrap().is_none() {
        interrupt(&run);
    }
    let output = run.wait_with_output().unwrap();
    match output.status.code() {
        Some(130) => {
            assert_eq!(names(), [""; 0], "{}", says(&output));
            assert_eq!(says(&output).trim(), "stopped");
        }
        code => {
            assert_eq!((code, names()), (Some(0), vec!["scene".to_owned()]));
        }
    }
}

#[test]
fn ctrl_c_saves_and_resume_finishes() {
    let dir = tempfile::tempdir().unwrap();
    crate::fabricated::SCENE
        .write(&dir.path().join("scene"))
        .unwrap();
    let run_dir = dir.path().join("run");

    let settings = [
        "steps=200",
        "model.levels=5",
        "model.log2_table_size=12",
        "sampling.target_samples=2048",
        "sampling.occupancy_resolution=32",
        "export.mesh_resolution=48",
    ];
    let mut arguments = vec!["train", "scene", "--masks", "scene/coarse_masks"];
    arguments.extend(["--out", "run", "--preset", "quick"]);
    arguments.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    let mut run = sos(dir.path(), &arguments);
    wait_for(&run_dir.join("log.jsonl"), &mut run);
    interrupt(&run);
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", says(&output));
    let message = says(&output);
    assert!(message.contains("train --resume --out run"), "{message}");
    assert!(run_dir.join("checkpoint").join("numbers.json").exists());
    assert!(!run_dir.join("report.html").exists());

    // Another scene would be learned from in the name of this one.
    let config = fs::read(run_dir.join("config.toml")).unwrap();
    let other = dir.path().join("other");
    crate::fabricated::SCENE.write(&other).unwrap();
    let elsewhere = ["train", "other", "--resume", "--out", "run"];
    let output = sos(dir.path(), &elsewhere).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", says(&output));
    for part in ["it is a run of", "scene, not of other", "leave SCENE out"] {
        assert!(says(&output).contains(part), "{}", says(&output));
    }
    assert_eq!(fs::read(run_dir.join("config.toml")).unwrap(), config);

    let resume = ["train", "--resume", "--out", "run"];
    let output = sos(dir.path(), &resume).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    for folder in [
        "alpha",
        "foreground",
        "background",
        "background_seen",
        "normal",
        "depth",
    ] {
        assert_eq!(
            fs::read_dir(run_dir.join(folder)).unwrap().count(),
            fs::read_dir(dir.path().join("scene/images"))
                .unwrap()
                .count(),
            "{folder}"
        );
    }
    assert!(run_dir.join("report.html").exists());
    // The log has one unbroken row of steps.
    let log = fs::read_to_string(run_dir.join("log.jsonl")).unwrap();
    let steps: Vec<u64> = log
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .filter(|line| !line["psnr"].is_null())
        .map(|line| line["step"].as_u64().unwrap())
        .collect();
    assert!(steps.is_sorted_by(|a, b| a < b), "{steps:?}");
    assert_eq!(steps.last(), Some(&200));

    draws_from_elsewhere(dir.path());
}

/// The finished run, from where no photo was taken.
fn draws_from_elsewhere(dir: &Path) {
    let render = |arguments: &[&str]| {
        let arguments = [&["render", "run", "--size", "48"], arguments].concat();
        sos(dir, &arguments).wait_with_output().unwrap()
    };
    let output = render(&["--turntable", "3"]);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    let folder = dir.join("run/render/turntable");
    for number in 0..3 {
        let frame = image::open(folder.join(format!("object/{number:04}.png"))).unwrap();
        assert_eq!(frame.color(), image::ColorType::Rgba8);
        assert_eq!(frame.width().max(frame.height()), 48);
    }
    let record = fs::read_to_string(folder.join("export.txt")).unwrap();
    // Where there is no ffmpeg, the record says how to get it.
    assert!(folder.join("paper.mp4").is_file() || record.contains("install ffmpeg"));

    let output = render(&["--turntable", "3"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(says(&output).contains("--force"), "{}", says(&output));
    let output = render(&["--path", "2", "--out", "way"]);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    for folder in ["scene", "object", "background"] {
        assert_eq!(
            fs::read_dir(dir.join("way").join(folder)).unwrap().count(),
            2
        );
    }
    let scene = image::open(dir.join("way/scene/0001.png"))
        .unwrap()
        .to_rgb8();
    assert!(
        scene
            .pixels()
            .any(|pixel| pixel.0 != scene.get_pixel(0, 0).0)
    );
}
