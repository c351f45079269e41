//! The checks of a scene: a good one passes, and each kind of damage is found and named.

use demo_scene::{DemoConfig, DemoScene, generate};
use glam::DVec3;
use image::{GrayImage, RgbImage};
use io_colmap::Model;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;
use tempfile::TempDir;

/// Enough small views that each has neighbours.
static SCENE: LazyLock<DemoScene> = LazyLock::new(|| {
    generate(&DemoConfig {
        views: 14,
        mesh_cell: 0.004,
        ..DemoConfig::tiny()
    })
});

fn sos(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .current_dir(dir)
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A scene in `scene/`, with the true mattes as its masks.
fn scene() -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    SCENE.write(&scene).unwrap();
    fs::rename(scene.join("alpha_gt"), scene.join("masks")).unwrap();
    (dir, scene)
}

/// The report as JSON, after making sure of the exit code.
fn report(dir: &TempDir, more: &[&str], code: i32) -> Value {
    let output = sos(dir.path(), &[&["doctor", "scene", "--json"], more].concat());
    assert_eq!(
        output.status.code(),
        Some(code),
        "{}{}",
        text(&output.stderr),
        text(&output.stdout)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn check<'a>(report: &'a Value, name: &str) -> &'a Value {
    let checks = report["checks"].as_array().unwrap();
    let found = checks.iter().find(|check| check["check"] == name);
    found.unwrap_or_else(|| panic!("no check {name} in {report:#}"))
}

fn invert(path: &Path) {
    let mut mask: GrayImage = image::open(path).unwrap().into_luma8();
    mask.iter_mut().for_each(|value| *value = 255 - *value);
    mask.save(path).unwrap();
}

/// The model with its cameras changed.
fn change_poses(scene: &Path, change: impl Fn(&mut io_colmap::Pose)) {
    let sparse = scene.join("sparse/0");
    let mut model = Model::read(&sparse).unwrap();
    for view in &mut model.views {
        change(&mut view.camera_from_world);
    }
    fs::remove_dir_all(&sparse).unwrap();
    // Points that no view can see any more have lost their tracks.
    model
        .points
        .iter_mut()
        .for_each(|point| point.views.clear());
    model.write_binary(&sparse).unwrap();
}

#[test]
fn a_good_scene_passes_and_the_page_needs_no_network() {
    let (dir, _) = scene();
    let report = report(&dir, &["--html", "new/doctor.html"], 0);
    assert_eq!(report["verdict"], "pass", "{report:#}");
    let names: Vec<&str> = report["checks"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c["check"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        [
            "cameras",
            "photos",
            "object",
            "coverage",
            "parallax",
            "sharpness",
            "exposure",
            "masks",
            "agreement",
            "ground",
            "cost"
        ]
    );
    assert_eq!(check(&report, "coverage")["numbers"]["capture"], "orbit");
    assert!(
        check(&report, "parallax")["numbers"]["widest_deg"]
            .as_f64()
            .unwrap()
            > 60.0
    );
    assert_eq!(check(&report, "masks")["numbers"]["masks"], 14);
    assert_eq!(check(&report, "ground")["numbers"]["found"], true);
    assert!(
        check(&report, "cost")["numbers"]["minutes_least"]
            .as_f64()
            .unwrap()
            > 0.0
    );

    let page = fs::read_to_string(dir.path().join("new/doctor.html")).unwrap();
    for outside in [
        "http:", "https:", "//cdn", "<link", "src=", "url(", "import ",
    ] {
        assert!(!page.contains(outside), "the page has {outside:?}");
    }
    // Data, and a script that does not end early.
    let data = page
        .split("id=\"drawing\">")
        .nth(1)
        .unwrap()
        .split("</script>")
        .next()
        .unwrap();
    let drawing: Value = serde_json::from_str(data).unwrap();
    assert_eq!(drawing["cameras"].as_array().unwrap().len(), 14);
    assert_eq!(drawing["corners"].as_array().unwrap().len(), 8);
    assert_eq!(
        drawing["points"].as_array().unwrap().len(),
        drawing["colours"].as_array().unwrap().len()
    );
    assert_eq!(page.matches("</script>").count(), 2);
    assert_eq!(page.matches("<tr class=\"pass\">").count(), 11);

    let options = ["--masks", "none", "--preset", "quick"];
    let output = sos(dir.path(), &[&["doctor", "scene"][..], &options].concat());
    let table = text(&output.stdout);
    assert!(
        table.lines().all(|line| line.chars().count() <= 100),
        "{table}"
    );
    assert!(
        table.contains("  pass  cameras    14 photos of 96x72 pixels"),
        "{table}"
    );
    assert!(table.contains("all checks passed"), "{table}");
    assert!(
        table.ends_with("train on it with: sos train scene --preset quick --masks none\n"),
        "{table}"
    );
}

#[test]
fn blurred_dark_and_contradicted_photos_are_named() {
    let (dir, scene) = scene();
    let blurred = scene.join("images/003.png");
    let photo: RgbImage = image::open(&blurred).unwrap().into_rgb8();
    image::imageops::blur(&photo, 1.5).save(&blurred).unwrap();
    let dark = scene.join("images/009.png");
    let mut photo: RgbImage = image::open(&dark).unwrap().into_rgb8();
    photo.iter_mut().for_each(|value| *value /= 2);
    photo.save(&dark).unwrap();
    invert(&scene.join("masks/006.png"));
    GrayImage::new(96, 72)
        .save(scene.join("masks/011.png"))
        .unwrap();
    fs::copy(scene.join("images/000.png"), scene.join("images/extra.png")).unwrap();

    let report = report(&dir, &[], 0);
    assert_eq!(report["verdict"], "warn", "{report:#}");
    let about = |name: &str, photos: &[&str]| {
        let check = check(&report, name);
        assert_eq!(check["status"], "warn", "{check:#}");
        assert_eq!(check["photos"], Value::from(photos), "{check:#}");
        assert!(!check["remedy"].as_str().unwrap().is_empty());
    };
    about("sharpness", &["003.png"]);
    about("exposure", &["009.png"]);
    about("masks", &["011.png"]);
    assert_eq!(check(&report, "masks")["numbers"]["empty"], 1);
    let agreement = check(&report, "agreement");
    assert_eq!(agreement["status"], "warn");
    assert_eq!(
        (
            &agreement["numbers"]["set_aside"],
            &agreement["numbers"]["inverted"]
        ),
        (&2.into(), &1.into())
    );
    assert!(
        agreement["says"]
            .as_str()
            .unwrap()
            .ends_with("inverted: 006.png"),
        "{agreement}"
    );
    // One photo in fifteen without a pose is no reason to worry.
    assert_eq!(check(&report, "photos")["status"], "pass");
    assert_eq!(check(&report, "photos")["photos"][0], "extra.png");

    // Training says the same, a line each, and goes on.
    let train = [
        "train", "scene", "--out", "run", "--preset", "quick", "--steps", "1", "--quiet",
    ];
    let sizes = [
        "--set",
        "export.mesh_resolution=16",
        "--set",
        "export.edge_rays=1",
    ];
    let output = sos(dir.path(), &[&train[..], &sizes].concat());
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let warnings: Vec<&str> = said
        .lines()
        .filter(|line| line.starts_with("warning: "))
        .collect();
    assert_eq!(warnings.len(), 4, "{said}");
    assert!(
        warnings[0].starts_with("warning: sharpness: 1 of 14 photos is blurred"),
        "{said}"
    );
    let log = fs::read_to_string(dir.path().join("run/log.jsonl")).unwrap();
    assert!(log.contains("is blurred"), "{log}");
}

#[test]
fn photos_that_are_all_blurred_are_soft_as_a_whole() {
    let (dir, scene) = scene();
    for entry in fs::read_dir(scene.join("images")).unwrap() {
        let path = entry.unwrap().path();
        let photo: RgbImage = image::open(&path).unwrap().into_rgb8();
        image::imageops::blur(&photo, 4.0).save(&path).unwrap();
    }
    let report = report(&dir, &[], 0);
    let sharpness = check(&report, "sharpness");
    assert_eq!(sharpness["status"], "warn", "{sharpness:#}");
    let says = sharpness["says"].as_str().unwrap();
    assert!(says.starts_with("the photos are soft as a whole"), "{says}");
}

#[test]
fn inverted_masks_are_understood_or_said() {
    let (dir, scene) = scene();
    for entry in fs::read_dir(scene.join("masks")).unwrap() {
        invert(&entry.unwrap().path());
    }
    let detected = report(&dir, &[], 0);
    let masks = check(&detected, "masks");
    assert_eq!(masks["status"], "pass", "{masks:#}");
    assert!(
        masks["says"].as_str().unwrap().contains("black = object"),
        "{masks}"
    );
    // Stated wrongly.
    let output = sos(
        dir.path(),
        &["doctor", "scene", "--json", "--polarity", "white"],
    );
    let stated: Value = serde_json::from_slice(&output.stdout).unwrap();
    let masks = check(&stated, "masks");
    assert_eq!(masks["status"], "warn", "{masks:#}");
    assert!(
        masks["remedy"]
            .as_str()
            .unwrap()
            .contains("--polarity black"),
        "{masks}"
    );
}

#[test]
fn cameras_that_only_turn_stop_training() {
    let (dir, scene) = scene();
    let place = DVec3::new(1.0, 0.2, 1.4);
    change_poses(&scene, |pose| pose.translation = -(pose.rotation * place));
    for masks in ["none", "scene/masks"] {
        let report = report(&dir, &["--masks", masks], 3);
        assert_eq!(report["verdict"], "fail");
        let parallax = check(&report, "parallax");
        assert_eq!(parallax["status"], "fail", "{report:#}");
        assert!(
            parallax["remedy"].as_str().unwrap().contains("walk around"),
            "{parallax}"
        );
    }
    let output = sos(dir.path(), &["train", "scene", "--out", "run"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    let error = said
        .lines()
        .find(|line| line.starts_with("error: "))
        .unwrap();
    for part in ["scene: ", "sos doctor", "--skip-checks"] {
        assert!(error.contains(part), "{part:?} is not in {error}");
    }
    assert!(!dir.path().join("run").exists(), "an empty run was left");
}

#[test]
fn files_that_do_not_fit_are_failures_not_errors() {
    let (dir, scene) = scene();
    fs::remove_file(scene.join("images/004.png")).unwrap();
    let missing = report(&dir, &[], 3);
    let photos = check(&missing, "photos");
    assert_eq!(
        (&photos["status"], &photos["photos"][0]),
        (&"fail".into(), &"004.png".into())
    );
    // The rest is checked all the same.
    assert_eq!(check(&missing, "cameras")["numbers"]["photos"], 13);
    assert_eq!(check(&missing, "agreement")["status"], "pass");

    let (dir, scene) = self::scene();
    GrayImage::new(50, 50)
        .save(scene.join("masks/002.png"))
        .unwrap();
    let shape = report(&dir, &[], 3);
    let masks = check(&shape, "masks");
    assert_eq!(masks["status"], "fail");
    for part in ["002.png", "50x50", "96x72", "another shape"] {
        assert!(masks["says"].as_str().unwrap().contains(part), "{masks}");
    }
    assert!(
        masks["remedy"]
            .as_str()
            .unwrap()
            .contains("without cropping"),
        "{masks}"
    );
    assert_eq!(check(&shape, "parallax")["status"], "pass");
}

#[test]
fn what_is_no_scene_is_bad_input() {
    let (dir, scene) = scene();
    fs::create_dir(dir.path().join("empty")).unwrap();
    fs::remove_dir_all(scene.join("sparse")).unwrap();
    for (arguments, says) in [
        (&["doctor", "nowhere"][..], "nowhere"),
        (&["doctor", "empty"], "empty"),
        (&["doctor", "scene/images"], "capture"),
        (&["doctor", "scene", "--masks", "no-masks"], "no"),
        (&["doctor"], "SCENE"),
    ] {
        let output = sos(dir.path(), arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        assert!(
            text(&output.stderr).contains(says),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
}
