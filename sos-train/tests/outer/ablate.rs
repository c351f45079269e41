//! The table of what the method's parts are worth.

use crate::tiny;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Exit code, standard output and standard error of `sos ablate scene --out table …`.
fn ablate(dir: &Path, more: &[&str]) -> (Option<i32>, String, String) {
    tiny::table(
        dir,
        &[&["ablate", "scene", "--out", "table"], more].concat(),
    )
}

#[test]
fn rows_are_trained_once_and_scored_together() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    let table = dir.path().join("table");
    let few = ["--steps", "3"];
    let rows = ["mask", "hull", "object", "semantic", "density"];
    let only: Vec<&str> = rows.iter().flat_map(|row| ["--only", row]).collect();

    let (code, printed, said) = ablate(dir.path(), &[&few[..], &only].concat());
    assert_eq!(code, Some(0), "{said}");
    for title in [
        "mask only",
        "mask + F",
        "soft visual hull",
        "radiance field for FoCoR",
        "semantic field",
    ] {
        assert!(
            printed.lines().any(|line| line.starts_with(title)),
            "{title}: {printed}"
        );
    }
    // The start masks are what they are scored as elsewhere, a missing one included.
    let comparison = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args([
            "compare",
            "masks=scene/coarse_masks",
            "--gt",
            "scene",
            "--json",
        ])
        .current_dir(dir.path())
        .output()
        .unwrap();
    let masks: serde_json::Value = serde_json::from_slice(&comparison.stdout).unwrap();
    let json = fs::read_to_string(table.join("ablation.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), rows.len());
    assert_eq!(json["rows"][0]["row"], "mask");
    let iou = &json["rows"][0]["report"]["mean"]["iou"];
    assert_eq!(*iou, masks["contenders"][0]["report"]["mean"]["iou"]);
    assert!(iou.as_f64().unwrap() > 0.3);
    // A row is its settings.
    for (row, line) in [
        ("object", "fields = \"object\""),
        ("semantic", "fields = \"semantic\""),
        ("density", "foreground = \"density\""),
    ] {
        let config = fs::read_to_string(table.join(row).join("config.toml")).unwrap();
        assert!(config.lines().any(|l| l == line), "{row}: {config}");
        assert!(config.contains("steps = 3\n"), "{config}");
    }
    let markdown = fs::read_to_string(table.join("ablation.md")).unwrap();
    assert!(
        markdown.contains("| mask + F |") && markdown.contains("--steps 3"),
        "{markdown}"
    );
    let page = fs::read_to_string(table.join("ablation.html")).unwrap();
    // Truth and four full rows of six views, five masks.
    assert_eq!(page.matches("<img ").count(), 35);
    assert!(!page.contains("http"), "the page needs the network");

    // Once more: nothing is trained, and a row that is missing comes to those that are there.
    let log = |row: &str| fs::read_to_string(table.join(row).join("log.jsonl")).unwrap();
    let before = log("semantic");
    let (code, printed, said) = ablate(
        dir.path(),
        &[&few[..], &["--only", "semantic", "--only", "all"]].concat(),
    );
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("semantic field: is there"), "{said}");
    assert_eq!(log("semantic"), before);
    for title in ["all ", "semantic field ", "mask only "] {
        assert!(
            printed.lines().any(|line| line.starts_with(title)),
            "{printed}"
        );
    }

    // Runs of other settings or masks are not mixed into a table.
    let other = ["--masks", "scene/alpha_gt", "--only", "semantic"];
    let (code, _, said) = ablate(dir.path(), &[&few[..], &other].concat());
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("with the masks in") && said.contains("coarse_masks"),
        "{said}"
    );
    let (code, _, said) = ablate(dir.path(), &["--steps", "4", "--only", "semantic"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("steps = 3, not 4"), "{said}");
    let white = ["--polarity", "white", "--only", "semantic"];
    let (code, _, said) = ablate(dir.path(), &[&few[..], &white].concat());
    assert_eq!(code, Some(2), "{said}");
    let expected = "without --polarity, not with --polarity white";
    assert!(said.contains(expected), "{said}");
    // Nor those that knew nothing of somebody in the photos.
    fs::create_dir(scene.join("ignore")).unwrap();
    let someone = image::GrayImage::new(96, 72);
    someone.save(scene.join("ignore/003.png")).unwrap();
    let (code, _, said) = ablate(dir.path(), &[&few[..], &["--only", "semantic"]].concat());
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("without ignore pictures, not with the ignore pictures in"),
        "{said}"
    );
    assert_eq!(log("semantic"), before);
}

#[test]
fn seeds_are_runs_of_their_own_with_a_spread() {
    let dir = tempfile::tempdir().unwrap();
    crate::fabricated::SCENE
        .write(&dir.path().join("scene"))
        .unwrap();
    let only = ["--only", "all", "--only", "mask", "--set", "seed=7"];
    let few = ["--steps", "3", "--seeds", "2"];
    let (code, printed, said) = ablate(dir.path(), &[&few[..], &only].concat());
    assert_eq!(code, Some(0), "{said}");
    let table = dir.path().join("table");
    for (folder, seed) in [("all", 7), ("all-seed8", 8)] {
        let config = fs::read_to_string(table.join(folder).join("config.toml")).unwrap();
        assert!(config.contains(&format!("\nseed = {seed}\n")), "{config}");
    }
    let json = fs::read_to_string(table.join("ablation.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    // The masks themselves, and two runs.
    let iou = |i: usize| json["rows"][i]["report"]["mean"]["iou"].as_f64().unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), 3);
    let over = &json["over_seeds"];
    assert_eq!(over.as_array().unwrap().len(), 1);
    assert_eq!(
        (&over[0]["row"], &over[0]["runs"]),
        (&"all".into(), &2.into())
    );
    let spread = |key: &str| over[0]["iou"][key].as_f64().unwrap();
    assert!((spread("mean") - 0.5 * (iou(1) + iou(2))).abs() < 1e-12);
    assert!((spread("deviation") - (iou(1) - iou(2)).abs() / 2f64.sqrt()).abs() < 1e-12);
    let markdown = fs::read_to_string(table.join("ablation.md")).unwrap();
    for text in [&printed, &markdown] {
        assert!(
            text.contains("over seeds") && text.contains(" ± "),
            "{text}"
        );
    }
    assert!(markdown.contains("sos train --set seed=8"), "{markdown}");

    // A later table has them still.
    let hull = ["--steps", "3", "--set", "seed=7", "--only", "hull"];
    let (code, printed, said) = ablate(dir.path(), &hull);
    assert_eq!(code, Some(0), "{said}");
    assert!(
        printed.contains("all, seed 8") && printed.contains(" ± "),
        "{printed}"
    );
}

#[test]
fn what_a_table_needs_is_asked_for_before_anything_is_trained() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    for (more, says) in [
        (&["--only", "everything"][..], "no-sparsity"),
        (&["--masks", "none"], "--masks"),
        (&["--gt", "nowhere"], "nowhere"),
        (&["--set", "loss.mosk=1"], "loss.mask?"),
    ] {
        let (code, _, said) = ablate(dir.path(), more);
        assert_eq!(code, Some(2), "{more:?}: {said}");
        assert!(said.contains(says), "{more:?}: {said}");
    }
    fs::rename(scene.join("alpha_gt"), dir.path().join("truth")).unwrap();
    let (code, _, said) = ablate(dir.path(), &[]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("--gt"), "{said}");
    assert!(!dir.path().join("table").exists());
}

#[test]
fn a_table_is_not_put_among_other_things() {
    tiny::is_refused_among_other_things("ablation", |dir| ablate(dir, &[]));
}
