//! Runs that take a moment.

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
