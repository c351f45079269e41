use crate::disc;
use crate::folders::save;
use std::path::Path;
use std::process::{Command, Output};

fn sos_eval(args: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sos-eval"))
        .args(args)
        .output()
        .unwrap()
}

#[test]
fn prints_a_table_and_writes_json() {
    let root = tempfile::tempdir().unwrap();
    let (truth, json) = (root.path().join("truth"), root.path().join("scores.json"));
    save(&disc(40, 20.0, 20.0, 10.0), &truth.join("000.png"));
    let out = sos_eval(&[
        &truth,
        &truth,
        Path::new("--start"),
        &truth,
        Path::new("--json"),
        &json,
    ]);
    assert!(out.status.success(), "{out:?}");
    assert!(String::from_utf8(out.stdout).unwrap().contains("mean of 1"));
    let report: sos_eval::Report =
        serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!((report.mean.iou, report.start.unwrap().iou), (1.0, 1.0));
    // Nothing but the folder and the file.
    assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 2);
}

#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    let root = tempfile::tempdir().unwrap();
    save(&disc(40, 20.0, 20.0, 10.0), &root.path().join("000.png"));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let out = Command::new(env!("CARGO_BIN_EXE_sos-eval"))
        .args([root.path(), root.path()])
        .stdout(writer)
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert_eq!((out.status.code(), said.as_str()), (Some(0), ""));
}

#[test]
fn holes_do_not_count_when_filled() {
    let root = tempfile::tempdir().unwrap();
    let [pred, truth] = ["pred", "truth"].map(|name| root.path().join(name));
    let whole = disc(40, 20.0, 20.0, 10.0);
    let mut ring = whole.clone();
    for (alpha, hole) in ring.values.iter_mut().zip(disc(40, 20.0, 20.0, 4.0).values) {
        *alpha -= hole;
    }
    save(&whole, &pred.join("000.png"));
    save(&ring, &truth.join("000.png"));
    let iou = |filled: &[&Path]| {
        let out = sos_eval(&[&[&*pred, &*truth], filled].concat());
        let table = String::from_utf8(out.stdout).unwrap();
        let mean = table.lines().nth(1).unwrap().split_whitespace().nth(3);
        mean.unwrap().parse::<f32>().unwrap()
    };
    assert!(iou(&[]) < 0.9);
    assert!((iou(&[Path::new("--filled")]) - 1.0).abs() < 1e-4);
}

#[test]
fn bad_input_exits_with_2_and_one_sentence() {
    let root = tempfile::tempdir().unwrap();
    let truth = root.path().join("truth");
    save(&disc(40, 20.0, 20.0, 10.0), &truth.join("000.png"));
    let nowhere = root.path().join("nowhere");
    let unwritable = truth.join("000.png/scores.json");
    let empty = root.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    for args in [
        vec![&*nowhere, &*truth],
        vec![&*truth, &*empty],
        vec![&*truth, &*truth, Path::new("--json"), &*unwritable],
    ] {
        let out = sos_eval(&args);
        let text = String::from_utf8(out.stderr).unwrap();
        assert_eq!(out.status.code(), Some(2), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}
