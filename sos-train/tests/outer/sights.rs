//! Training that is told where rays end.

use std::fs;
use std::path::Path;

fn train(dir: &Path, steps: &str) -> String {
    let arguments = [
        "train",
        "scene",
        "--masks",
        "scene/coarse_masks",
        "--out",
        "run",
        "--force",
        "--steps",
        steps,
        "--set",
        "loss.sight=0.02",
    ];
    let (code, _, said) = crate::tiny::table(dir, &arguments);
    assert_eq!(code, Some(0), "{said}");
    said
}

#[test]
fn runs_learn_from_where_sparse_points_are_seen_or_say_why_not() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    crate::fabricated::SCENE.write(&scene).unwrap();
    let without = "loss.sight does nothing";
    let said = train(dir.path(), "100");
    assert!(!said.contains(without), "{said}");
    let log = fs::read_to_string(dir.path().join("run/log.jsonl")).unwrap();
    let records = log.lines().map(|line| {
        let record: serde_json::Value = serde_json::from_str(line).unwrap();
        (record["step"].as_u64(), record["losses"]["sight"].as_f64())
    });
    let at = |wanted: u64| {
        let mut records = records.clone();
        let found = records.find(|(step, loss)| *step == Some(wanted) && loss.is_some());
        found.unwrap().1.unwrap()
    };
    // It has fallen to nothing at 60 % of the steps.
    assert!(at(50) > 0.0 && at(100) == 0.0, "{log}");

    fs::write(scene.join("sparse/0/points3D.txt"), "").unwrap();
    let said = train(dir.path(), "1");
    assert!(said.contains(without), "{said}");
}
