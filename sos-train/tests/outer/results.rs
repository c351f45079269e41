//! The table of what comes out of which masks.

use crate::tiny;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Exit code, standard output and standard error of `sos results … --out table`.
fn results(dir: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    let table = ["results", "--out", "table", "--steps", "3"];
    tiny::table(dir, &[&table[..], more].concat())
}

fn scene_with_held_out_views(dir: &Path) {
    let scene = dir.join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    // The same places once more: what counts is that they are drawn and scored.
    let heldout = scene.join("heldout");
    for folder in ["alpha_gt", "sparse/0"] {
        fs::create_dir_all(heldout.join(folder)).unwrap();
        for entry in fs::read_dir(scene.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, heldout.join(folder).join(path.file_name().unwrap())).unwrap();
        }
    }
}

fn score(dir: &Path, contender: &str) -> f64 {
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(["compare", contender, "--gt", "scene", "--json"])
        .current_dir(dir)
        .output()
        .unwrap();
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    json["contenders"][0]["report"]["mean"]["iou"]
        .as_f64()
        .unwrap()
}

#[test]
fn scenes_are_trained_once_from_each_start_and_scored() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    scene_with_held_out_views(dir);
    let starts = ["scene", "--start", "own", "--start", "half-missing"];
    let (code, printed, said) = results(dir, &[&starts[..], &["--seeds", "2"]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("4 runs are to be made, 0 are there"),
        "{said}"
    );
    assert!(printed.contains(" ± "), "{printed}");

    let table = dir.join("table");
    let json = fs::read_to_string(table.join("results.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    // Scores are what the other commands give, and each run is its command.
    for (row, start, masks) in [
        (&rows[0], "own", "scene/coarse_masks"),
        (&rows[1], "half-missing", "table/scene/half-missing/masks"),
    ] {
        assert_eq!(row["start"], start);
        assert_eq!(row["masks"]["iou"], score(dir, &format!("masks={masks}")));
        let hull = format!("hull=table/scene/{start}/hull");
        assert_eq!(row["hull"]["iou"], score(dir, &hull));
        for (run, seed) in row["runs"].as_array().unwrap().iter().zip(1..) {
            assert_eq!(run["seed"], seed);
            let folder = format!("table/scene/{start}/seed{seed}");
            assert_eq!(run["folder"], folder.as_str());
            assert_eq!(run["report"]["mean"]["iou"], score(dir, &folder));
            assert!(run["heldout"]["iou"].is_f64(), "{run}");
            let config = fs::read_to_string(dir.join(&folder).join("config.toml")).unwrap();
            assert!(config.contains(&format!("\nseed = {seed}\n")), "{config}");
            assert!(config.contains(masks), "{config}");
        }
    }
    // Every second view has the true mask.
    assert_eq!(rows[1]["masks"]["iou"], 0.5);
    let markdown = fs::read_to_string(table.join("results.md")).unwrap();
    assert!(
        markdown.contains("--steps 3") && markdown.contains("| half of the views have none |"),
        "{markdown}"
    );

    // Once more: nothing is trained; what was made otherwise is refused.
    let run = table.join("scene/own/seed1");
    let before = fs::read_to_string(run.join("log.jsonl")).unwrap();
    let (code, again, said) = results(dir, &["scene", "--start", "own"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("0 runs are to be made, 1 are there"),
        "{said}"
    );
    assert!(!again.contains(" ± "), "{again}");
    let other = ["scene", "--start", "own", "--set", "loss.mask=0.2"];
    let (code, _, said) = results(dir, &other);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("loss.mask"), "{said}");
    assert_eq!(fs::read_to_string(run.join("log.jsonl")).unwrap(), before);
}

#[test]
fn what_the_table_needs_is_asked_for_before_anything_is_trained() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let scene = dir.join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    for (more, says) in [
        (&["scene", "--start", "erodd"][..], "eroded"),
        (&["nowhere"], "nowhere"),
        (&["scene", "scene/"], "two of the scenes"),
        (&["scene", "--set", "loss.mosk=1"], "loss.mask?"),
    ] {
        let (code, _, said) = results(dir, more);
        assert_eq!(code, Some(2), "{more:?}: {said}");
        assert!(said.contains(says), "{more:?}: {said}");
    }
    fs::remove_dir_all(scene.join("coarse_masks")).unwrap();
    let (code, _, said) = results(dir, &["scene", "--start", "own"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("--start own"), "{said}");
    fs::rename(scene.join("alpha_gt"), dir.join("truth")).unwrap();
    let (code, _, said) = results(dir, &["scene"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("alpha_gt"), "{said}");
    assert!(!dir.join("table").exists(), "something was made: {said}");
}

#[test]
fn a_table_is_not_put_among_other_things() {
    tiny::is_refused_among_other_things("results", |dir| results(dir, &["scene"]));
}
