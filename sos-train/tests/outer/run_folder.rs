//! What a run may and may not do to a folder.

use sos_train::run_folder::{Existing, RunError, RunFolder};
use std::fs;
use std::io::{Error, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// All files but the lock that a process holds on a run.
fn tree(dir: &Path) -> Vec<String> {
    fn walk(dir: &Path, base: &Path, out: &mut Vec<String>) {
        for entry in fs::read_dir(dir).unwrap().flatten() {
            if entry.path().is_dir() {
                walk(&entry.path(), base, out);
            } else {
                out.push(
                    entry
                        .path()
                        .strip_prefix(base)
                        .unwrap()
                        .display()
                        .to_string(),
                );
            }
        }
    }
    let mut out = Vec::new();
    walk(dir, dir, &mut out);
    out.retain(|name| name != ".lock");
    out.sort();
    out
}

fn fill(run: &RunFolder) {
    run.set_config("steps = 1\n".to_owned());
    for path in [
        run.alpha_dir().join("a/1.png"),
        run.depth_dir().join("1.exr"),
        run.checkpoint_dir().join("numbers.json"),
        run.mesh_path(),
        run.log_path(),
    ] {
        run.write(&path, |out| out.write_all(b"old")).unwrap();
    }
}

fn run_in(dir: &Path) -> PathBuf {
    let path = dir.join("runs/cat");
    fill(&RunFolder::create(&path, Existing::Keep).unwrap());
    path
}

#[test]
fn an_existing_run_is_kept_unless_told_otherwise() {
    let dir = tempfile::tempdir().unwrap();
    let path = run_in(dir.path());
    let before = tree(&path);
    let error = RunFolder::create(&path, Existing::Keep).unwrap_err();
    assert!(matches!(error, RunError::Exists { .. }));
    let text = error.to_string();
    assert!(
        text.contains("--resume") && text.contains("--force"),
        "{text}"
    );
    assert_eq!(tree(&path), before);
    assert!(RunFolder::open_existing(&path).unwrap().has_checkpoint());
}

#[test]
fn one_process_at_a_time_makes_a_run() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    let run = RunFolder::create(&path, Existing::Keep).unwrap();
    // Before it has written anything, and afterwards.
    let error = RunFolder::create(&path, Existing::Keep).unwrap_err();
    assert!(matches!(error, RunError::Busy { .. }), "{error}");
    assert!(error.to_string().contains("--out"), "{error}");
    fill(&run);
    let busy = |result: Result<RunFolder, RunError>| matches!(result, Err(RunError::Busy { .. }));
    assert!(busy(RunFolder::create(&path, Existing::Replace)));
    assert!(busy(RunFolder::go_on(&path)));
    // Whoever looks at it takes no part.
    assert!(RunFolder::open_existing(&path).is_ok());
    let clone = run.clone();
    drop(run);
    assert!(busy(RunFolder::go_on(&path)));
    drop(clone);
    let before = tree(&path);
    assert!(!path.join(".lock").exists());
    // What a process that was killed leaves holds nobody up.
    fs::write(path.join(".lock"), "").unwrap();
    drop(RunFolder::go_on(&path).unwrap());
    assert!(!path.join(".lock").exists() && tree(&path) == before);
}

#[test]
fn replacing_waits_for_something_to_write_and_spares_what_is_not_ours() {
    let dir = tempfile::tempdir().unwrap();
    let path = run_in(dir.path());
    for folder in [
        "export/glb",
        "export/mine",
        "export/spin-nerf",
        "render/turntable",
    ] {
        fs::create_dir_all(path.join(folder)).unwrap();
    }
    for foreign in [
        "notes.txt",
        "alpha/readme.md",
        "sketch.png",
        "export/mine/a.obj",
    ] {
        fs::write(path.join(foreign), "mine").unwrap();
    }
    // Made of results that are about to go, in one of which somebody has worked since.
    for made in ["export/glb", "export/spin-nerf", "render/turntable"] {
        fs::write(path.join(made).join(scene_export::RECORD), "from this run").unwrap();
    }
    let record = path.join("export/spin-nerf").join(scene_export::RECORD);
    let long_ago = SystemTime::now() - Duration::from_secs(3600);
    let record = fs::File::options().write(true).open(record).unwrap();
    record.set_modified(long_ago).unwrap();
    fs::write(path.join("export/spin-nerf/poses_bounds.npy"), "mine").unwrap();
    let before = tree(&path);
    let run = RunFolder::create(&path, Existing::Replace).unwrap();
    assert_eq!(
        tree(&path),
        before,
        "nothing is removed before there is something new"
    );
    run.set_config("steps = 2\n".to_owned());
    run.begin().unwrap();
    assert_eq!(
        tree(&path),
        [
            "alpha/readme.md",
            "config.toml",
            "export/mine/a.obj",
            "export/spin-nerf/export.txt",
            "export/spin-nerf/poses_bounds.npy",
            "notes.txt",
            "sketch.png"
        ]
    );
    assert!(!path.join("export/glb").exists() && !path.join("render").exists());
    assert_eq!(
        fs::read_to_string(run.config_path()).unwrap(),
        "steps = 2\n"
    );
}

#[test]
fn a_folder_in_other_use_is_refused_even_with_force() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("thesis.doc"), "years of work").unwrap();
    for existing in [Existing::Keep, Existing::Replace] {
        let error = RunFolder::create(dir.path(), existing).unwrap_err();
        assert!(matches!(error, RunError::Foreign { .. }), "{error}");
    }
    let file = dir.path().join("thesis.doc");
    let error = RunFolder::create(&file, Existing::Replace).unwrap_err();
    assert!(matches!(error, RunError::NotAFolder { .. }), "{error}");
    assert_eq!(tree(dir.path()), ["thesis.doc"]);
}

#[test]
fn there_must_be_a_run_to_go_on_with() {
    let dir = tempfile::tempdir().unwrap();
    let error = RunFolder::open_existing(&dir.path().join("none")).unwrap_err();
    assert!(matches!(error, RunError::NoRun { .. }), "{error}");
}

#[test]
fn a_failing_writer_leaves_nothing_and_names_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = run_in(dir.path());
    let run = RunFolder::open_existing(&path).unwrap();
    let before = tree(&path);
    let full = || Error::from(std::io::ErrorKind::StorageFull);
    let error = run
        .write(&run.mesh_path(), |out| {
            out.write_all(&[0; 200_000])?;
            Err(full())
        })
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("mesh.ply") && error.contains("free some space"),
        "{error}"
    );
    assert_eq!(tree(&path), before);
    assert_eq!(fs::read(run.mesh_path()).unwrap(), b"old");
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_reported_with_the_file() {
    if !Path::new("/dev/full").exists() {
        return;
    }
    let full = fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let dir = tempfile::tempdir().unwrap();
    let run = RunFolder::create(dir.path(), Existing::Keep).unwrap();
    let error = run
        .write(&run.preview_path(), |_| (&full).write_all(b"x"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("preview.png") && error.contains("free some space"),
        "{error}"
    );
}

#[cfg(unix)]
#[test]
fn files_have_usual_permissions() {
    use std::os::unix::fs::PermissionsExt as _;
    let dir = tempfile::tempdir().unwrap();
    let usual = dir.path().join("usual");
    fs::write(&usual, "").unwrap();
    let path = run_in(dir.path());
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&path.join("mesh.ply")), mode(&usual));
}

#[test]
fn a_folder_that_cannot_be_made_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("file"), "").unwrap();
    let error = RunFolder::create(&dir.path().join("file/run"), Existing::Keep).unwrap_err();
    assert!(matches!(error, RunError::Io { .. }), "{error}");
    assert!(error.to_string().contains("file/run"), "{error}");
}
