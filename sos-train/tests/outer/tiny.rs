//! Runs that take a moment.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Exit code, standard output and standard error of `sos ARGUMENTS` in `dir` with a model that learns nothing
/// much.
pub(crate) fn table(dir: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let settings = [
        "model.levels=4",
        "model.log2_table_size=10",
        "sampling.target_samples=2048",
        "sampling.occupancy_resolution=16",
        "export.mesh_resolution=16",
        "export.edge_rays=1",
    ];
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .args(["--preset", "quick"])
        .args(settings.iter().flat_map(|setting| ["--set", setting]))
        .current_dir(dir)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

/// Exit code and standard error of `sos train ARGUMENTS` in `dir`, into `run` and with a coarse mesh.
pub(crate) fn train(dir: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(["train", "--out", "run"])
        .args(["--set", "export.mesh_resolution=16"])
        .args(arguments)
        .current_dir(dir)
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    (output.status.code(), said)
}

/// A table of that name, as `table` makes it in a folder, is not put among other things in `table/`.
pub(crate) fn is_refused_among_other_things(
    name: &str,
    table: impl Fn(&Path) -> (Option<i32>, String, String),
) {
    let dir = tempfile::tempdir().unwrap();
    crate::fabricated::SCENE
        .write(&dir.path().join("scene"))
        .unwrap();
    let own = dir.path().join(format!("table/{name}.md"));
    fs::create_dir_all(own.parent().unwrap()).unwrap();
    fs::write(&own, "mine").unwrap();
    let (code, _, said) = table(dir.path());
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("there is something in it already"), "{said}");
    assert_eq!(fs::read_to_string(&own).unwrap(), "mine");
}
