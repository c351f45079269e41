//! The report of a run that was never trained.

use crate::fabricated;
use sos_train::report::{ReportError, ReportInputs, write_report};
use std::fs;
use std::process::Command;

#[test]
fn every_view_is_there_and_nothing_comes_from_outside() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, run) = fabricated::run(dir.path(), false);
    write_report(&run, &ReportInputs::gather(&run).unwrap()).unwrap();
    let html = fs::read_to_string(run.report_path()).unwrap();
    for view in &scene.views {
        assert!(
            html.contains(&format!("alt=\"photo of {}\"", view.name)),
            "{}",
            view.name
        );
        assert!(html.contains(&format!("alt=\"cut-out of {}\"", view.name)));
    }
    let n = scene.views.len();
    let masks = scene
        .views
        .iter()
        .filter(|view| view.coarse_mask.is_some())
        .count();
    assert!(masks < n, "the demo has views without a mask");
    assert_eq!(html.matches("<img ").count(), 4 * n + masks);
    assert_eq!(html.matches("src=\"data:image/").count(), 4 * n + masks);
    assert_eq!(html.matches("class=\"none\"").count(), n - masks);
    assert_eq!(html.matches("<svg").count(), 6);
    // Base64 may spell anything.
    let (before, mesh) = html.split_once("id=\"mesh\">").unwrap();
    let (_, after) = mesh.split_once("</script>").unwrap();
    let text: String = [before, after]
        .concat()
        .split("src=\"data:image/")
        .map(|part| part.split_once('"').map_or(part, |(_, rest)| rest))
        .collect();
    for outside in [
        "http:",
        "https:",
        "//cdn",
        "<script src",
        "<link",
        "url(",
        "@import",
        "src=\"/",
        "NaN",
    ] {
        assert!(!text.contains(outside), "{outside}");
    }
    assert!(html.contains("cat &amp; &lt;dog&gt;") && !html.contains("<dog>"));
    assert!(html.contains("&lt;b&gt;markup&lt;/b&gt;"));
    assert!(html.contains("cpu (test)") && html.contains("5 min 13 s"));
    assert!(html.contains("href=\"alpha/000.png\""));
}

#[test]
fn a_scored_demo_shows_scores_and_the_true_mattes() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, run) = fabricated::run(dir.path(), true);
    let scene_dir = run.scene_dir();
    let scores = sos_eval::run_eval(
        run.root(),
        &scene_dir,
        Some(&scene_dir.join("coarse_masks")),
    )
    .unwrap();
    fs::write(run.metrics_path(), serde_json::to_string(&scores).unwrap()).unwrap();

    // A run of the demo can be moved as a whole.
    let moved = dir.path().join("moved");
    fs::rename(run.root(), &moved).unwrap();
    let run = sos_train::run_folder::RunFolder::open_existing(&moved).unwrap();
    write_report(&run, &ReportInputs::gather(&run).unwrap()).unwrap();
    let html = fs::read_to_string(run.report_path()).unwrap();
    assert_eq!(
        html.matches("alt=\"reference alpha of").count(),
        scene.views.len()
    );
    assert!(html.contains("<h2>Scores</h2>") && html.contains("coarse masks"));
    assert_eq!(
        html.matches("<em>IoU 1.000</em>").count(),
        scene.views.len()
    );
    assert!(html.contains("href=\"#v0\""));
    if let Some(keep) = std::env::var_os("SOS_KEEP_REPORT") {
        fs::copy(run.report_path(), keep).unwrap();
    }
}

#[test]
fn results_that_are_missing_are_shown_as_missing() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = fabricated::run(dir.path(), false);
    fs::remove_file(run.alpha_dir().join("000.png")).unwrap();
    fs::remove_file(run.log_path()).unwrap();
    write_report(&run, &ReportInputs::gather(&run).unwrap()).unwrap();
    let html = fs::read_to_string(run.report_path()).unwrap();
    assert!(
        !html.contains("alt=\"alpha of 000.png\"") && html.contains("alt=\"alpha of 001.png\"")
    );
    assert!(!html.contains("<h2>Training</h2>"));
}

#[test]
fn a_damaged_mesh_is_a_note_on_the_page() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = fabricated::run(dir.path(), false);
    fs::write(run.mesh_path(), "not a mesh").unwrap();
    write_report(&run, &ReportInputs::gather(&run).unwrap()).unwrap();
    let html = fs::read_to_string(run.report_path()).unwrap();
    assert!(html.contains("<li>the mesh is not shown: ") && html.contains("mesh.ply"));
    fs::remove_file(run.mesh_path()).unwrap();
    write_report(&run, &ReportInputs::gather(&run).unwrap()).unwrap();
    let html = fs::read_to_string(run.report_path()).unwrap();
    assert!(!html.contains("the mesh is not shown"));
}

#[test]
fn a_damaged_result_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = fabricated::run(dir.path(), false);
    fs::write(run.alpha_dir().join("003.png"), "not a picture").unwrap();
    let error = write_report(&run, &ReportInputs::gather(&run).unwrap()).unwrap_err();
    assert!(matches!(error, ReportError::Picture { .. }));
    assert!(error.to_string().contains("003.png"), "{error}");
    assert!(!run.report_path().exists());
}

#[test]
fn a_run_that_has_not_come_to_its_end_is_called_so() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = fabricated::run(dir.path(), false);
    let sos = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_sos"))
            .args(arguments)
            .current_dir(dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), said)
    };
    let unfinished = "the run has not come to its end";
    let page = || fs::read_to_string(run.report_path()).unwrap();
    assert_eq!(sos(&["report", "run"]), (Some(0), String::new()));
    assert!(!page().contains(unfinished));

    let log = fs::read_to_string(run.log_path()).unwrap();
    let lines: Vec<&str> = log
        .lines()
        .filter(|line| !line.contains("\"end\""))
        .collect();
    fs::write(run.log_path(), lines.join("\n") + "\n").unwrap();
    let (code, said) = sos(&["report", "run"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.starts_with(unfinished), "{said}");
    assert!(page().contains(unfinished));

    fs::remove_dir_all(run.alpha_dir()).unwrap();
    let scene = dir.path().join("cat & <dog>");
    let (code, said) = sos(&["compare", "run", "--gt", scene.to_str().unwrap()]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("this run has drawn no mattes yet"), "{said}");
}
