//! What programs are answered.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The object that a command prints, and nothing else with it.
fn asked(dir: &Path, arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .arg("--json")
        .current_dir(dir)
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said}");
    let printed = String::from_utf8(output.stdout).unwrap();
    serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error} in {printed}"))
}

/// Where nothing can be written, as on a full disk.
#[cfg(target_os = "linux")]
#[test]
fn an_answer_that_does_not_arrive_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    let rows = ["ablate", "scene", "--only", "mask", "--out", "rows"];
    for arguments in [
        &["devices", "--json"][..],
        &["doctor", "scene", "--masks", "none"],
        &["completions", "bash"],
        &["man"],
        &[&rows[..], &["--json"]].concat(),
    ] {
        let full = std::fs::File::options().write(true).open("/dev/full");
        let output = Command::new(env!("CARGO_BIN_EXE_sos"))
            .args(arguments)
            .current_dir(dir.path())
            .stdout(full.unwrap())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(
            said.contains("error: cannot write to standard output: ")
                && said.trim_end().ends_with("; free some space"),
            "{arguments:?}: {said}"
        );
    }
    // The table itself has been written by then.
    assert!(dir.path().join("rows/ablation.json").is_file());
}

#[cfg(unix)]
#[test]
fn a_reader_that_has_gone_is_no_error() {
    for arguments in [&["devices"][..], &["completions", "bash"], &["man"]] {
        // The end to be read from is closed at once.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = Command::new(env!("CARGO_BIN_EXE_sos"))
            .args(arguments)
            .stdout(writer)
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said}");
    }
}

#[test]
fn every_command_with_a_result_prints_one_object() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let scene = &*crate::fabricated::SCENE;
    scene.write(&dir.join("scene")).unwrap();
    let photos = scene.views.len();

    let devices = asked(dir, &["devices"]);
    assert!(devices["cpu_threads"].as_u64() >= Some(1), "{devices}");
    assert!(devices["auto"].is_string(), "{devices}");

    let masks = ["--masks", "scene/coarse_masks"];
    let hull = asked(
        dir,
        &[&["hull", "scene", "--out", "hull"], &masks[..]].concat(),
    );
    assert_eq!(
        (&hull["folder"], &hull["mattes"]),
        (&"hull".into(), &photos.into())
    );
    let rough = [
        "--gt",
        "scene/alpha_gt",
        "--photos",
        "scene/images",
        "--fault",
        "eroded",
    ];
    std::fs::create_dir(dir.join("rough")).unwrap();
    let rough = asked(dir, &[&["degrade", "--out", "rough"], &rough[..]].concat());
    assert_eq!(rough["masks"], photos);
    let imported = asked(dir, &["import", "scene", "--out", "imported", "--quiet"]);
    assert_eq!(
        (&imported["photos"], &imported["masks"]),
        (&photos.into(), &0.into())
    );

    let quick = ["--preset", "quick", "--steps", "2", "--quiet"];
    let small = ["--set", "export.mesh_resolution=16", "--out", "run"];
    let run = asked(
        dir,
        &[&["train", "scene"], &masks[..], &quick, &small].concat(),
    );
    assert_eq!(run["finished"], true, "{run}");
    assert_eq!(run["report"], "run/report.html");
    assert!(run["seconds"].as_f64() > Some(0.0), "{run}");
    assert_eq!(
        run["metrics"]["audit"]["views"].as_array().unwrap().len(),
        photos
    );

    let export = asked(dir, &["export", "run", "--to", "alpha8"]);
    assert_eq!(
        (&export["folder"], &export["count"]),
        (&"run/export/alpha8".into(), &photos.into())
    );
    let frames = asked(
        dir,
        &[
            "render", "run", "--path", "2", "--size", "32", "--out", "way",
        ],
    );
    assert_eq!(
        (&frames["folder"], &frames["frames"]),
        (&"way".into(), &2.into())
    );
    let report = asked(dir, &["report", "run"]);
    assert_eq!(report["report"], "run/report.html");
    let table = asked(dir, &["ablate", "scene", "--only", "mask", "--out", "rows"]);
    assert_eq!(table["rows"][0]["row"], "mask", "{table}");
}
