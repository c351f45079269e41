//! The program as its users meet it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

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

/// Exit code 2, one sentence on standard error that contains all of `says`, nothing left behind.
fn refused(dir: &Path, arguments: &[&str], says: &[&str]) {
    let before = fs::read_dir(dir).unwrap().count();
    let output = sos(dir, arguments);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
    let lines: Vec<&str> = error
        .lines()
        .filter(|line| line.starts_with("error: "))
        .collect();
    assert_eq!(lines.len(), 1, "{arguments:?}: {error}");
    for part in says {
        assert!(
            lines[0].contains(part),
            "{arguments:?}: {part:?} is not in {error}"
        );
    }
    assert!(!error.contains("panicked"), "{error}");
    assert_eq!(
        fs::read_dir(dir).unwrap().count(),
        before,
        "{arguments:?} left something"
    );
}

fn tiny_scene(dir: &Path) {
    crate::fabricated::SCENE.write(dir).unwrap();
}

#[test]
fn help_fits_a_screen() {
    let dir = tempfile::tempdir().unwrap();
    let help = text(&sos(dir.path(), &["--help"]).stdout);
    assert!(help.lines().count() <= 24, "{help}");
    assert_eq!(
        help.matches("\n  sos ").count(),
        3,
        "three examples in\n{help}"
    );
    for command in ["train", "import", "eval", "ablate", "report", "demo-scene"] {
        assert!(help.contains(command), "{help}");
    }
    let help = text(&sos(dir.path(), &["train", "--help"]).stdout);
    assert!(help.lines().count() <= 40, "{help}");
    for option in [
        "SCENE",
        "--masks",
        "--out",
        "--steps",
        "--preset",
        "--device",
        "--seed",
        "--resume",
        "--force",
        "--set",
        "--quiet",
        "--polarity",
    ] {
        assert!(help.contains(option), "{option} is not in\n{help}");
    }
}

#[test]
fn the_command_line_itself_can_be_wrong() {
    let dir = tempfile::tempdir().unwrap();
    for arguments in [
        &["fly"][..],
        &["train", "--steps", "many"],
        &["train", "--resume", "--force"],
        &["train", "--preset", "huge"],
        &["train", "--click", "photo.jpg"],
        &["train", "--box", "1,1,1,0,0,0"],
        &["train", "--box", "0,0,0,1,1,1", "--click", "a.jpg:1,2"],
        &["eval", "run"],
        &["render", "run"],
        &["render", "run", "--path", "0"],
        &["export", "run", "--masks-for", "neus", "--fps", "12"],
    ] {
        assert_eq!(
            sos(dir.path(), arguments).status.code(),
            Some(2),
            "{arguments:?}"
        );
    }
}

#[test]
fn a_misspelt_word_is_answered_with_the_nearest() {
    let dir = tempfile::tempdir().unwrap();
    for (arguments, says) in [
        (&["trian"][..], "'train'"),
        (&["train", "--stesp", "3"], "'--steps'"),
        (&["train", "--preset", "quik"], "'quick'"),
        (&["train", "--device", "cdua"], "did you mean cuda?"),
        (
            &["train", "--set", "model.fields=bth"],
            "did you mean both?",
        ),
        (&["export", "run", "--to", "gltf"], "\"glb\""),
        (
            &["export", "run", "--masks-for", "nerfstduio"],
            "\"nerfstudio\"",
        ),
        (
            &["import", "scene", "--out", "x", "--format", "colamp"],
            "did you mean colmap?",
        ),
        (
            &["ablate", "scene", "--only", "densty"],
            "did you mean density?",
        ),
    ] {
        let output = sos(dir.path(), arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains(says), "{arguments:?}: {error}");
    }
}

#[test]
fn every_option_says_what_it_is_for_and_what_it_is_otherwise() {
    use clap::CommandFactory as _;
    let mut program = sos_train::cli::Sos::command();
    program.build();
    for command in program.get_subcommands() {
        let name = command.get_name();
        let one_of: Vec<&clap::Id> = command.get_groups().flat_map(|g| g.get_args()).collect();
        for option in command.get_arguments() {
            let help = option.get_help().map(ToString::to_string);
            let help = help.unwrap_or_default();
            let what = format!("{name} {}: {help:?}", option.get_id());
            assert!(help.starts_with(char::is_uppercase), "{what}");
            let has_default = !option.is_required_set()
                && option.get_action().takes_values()
                && !one_of.contains(&option.get_id());
            if has_default {
                let said = help.contains("[default: ") || !option.get_default_values().is_empty();
                assert!(said, "{what}: what if it is not given?");
            }
        }
    }
}

#[test]
fn settings_are_checked_before_anything_starts() {
    let dir = tempfile::tempdir().unwrap();
    for (arguments, says) in [
        (
            &["train", "--set", "loss.mosk=1"][..],
            &["loss.mosk", "loss.mask?"][..],
        ),
        (&["train", "--set", "loss.mask"], &["key=value"]),
        (&["train", "--steps", "10000001"], &["steps", "0..="]),
        (&["train", "--device", "abacus"], &["abacus", "flex"]),
        (&["train", "--config", "none.toml"], &["none.toml"]),
        (&["train", "--resume"], &["runs/demo", "holds no run"]),
    ] {
        refused(dir.path(), arguments, says);
    }
}

#[test]
fn bad_scenes_are_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    refused(
        dir.path(),
        &["train", "none"],
        &["none", "no such file or folder", "video"],
    );
    refused(
        dir.path(),
        &["train", "none.mp4", "--out", "run"],
        &["none.mp4", "no such file or folder", "video"],
    );
    refused(
        dir.path(),
        &["doctor", "none.mp4"],
        &["none.mp4", "no such file or folder", "sos capture"],
    );
    fs::create_dir(dir.path().join("empty")).unwrap();
    refused(
        dir.path(),
        &["train", "empty"],
        &["empty", "no COLMAP model"],
    );
    let scene = dir.path().join("scene");
    tiny_scene(&scene);
    refused(
        dir.path(),
        &["train", "scene", "--masks", "none-here"],
        &["none-here"],
    );
    refused(
        dir.path(),
        &["train", "scene", "--masks", "empty"],
        &["empty", "masks"],
    );
    fs::remove_file(scene.join("images/004.png")).unwrap();
    refused(dir.path(), &["train", "scene"], &["004.png"]);
    fs::write(scene.join("sparse/0/cameras.txt"), "1 WARPED 96 72 1 2 3\n").unwrap();
    refused(dir.path(), &["train", "scene"], &["cameras.txt", "WARPED"]);
}

#[test]
fn folders_that_cannot_take_a_run_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    tiny_scene(&dir.path().join("scene"));
    let run = dir.path().join("run");
    fs::create_dir(&run).unwrap();
    fs::write(run.join("config.toml"), "steps = 3\n").unwrap();
    let train = |more: &[&'static str]| [&["train", "scene", "--out", "run"][..], more].concat();
    refused(dir.path(), &train(&[]), &["run", "--resume", "--force"]);
    refused(
        dir.path(),
        &train(&["--resume"]),
        &["no checkpoint", "--force"],
    );
    fs::write(run.join("config.toml"), "steps = maybe\n").unwrap();
    fs::create_dir(run.join("checkpoint")).unwrap();
    fs::write(run.join("checkpoint/numbers.json"), "{}").unwrap();
    refused(
        dir.path(),
        &train(&["--resume"]),
        &["config.toml", "line 1"],
    );
    fs::write(dir.path().join("file"), "").unwrap();
    refused(
        dir.path(),
        &["train", "scene", "--out", "file"],
        &["file", "--out"],
    );
    refused(
        dir.path(),
        &["train", "scene", "--out", "file/run"],
        &["file/run"],
    );
    refused(
        dir.path(),
        &["train", "scene", "--out", "scene"],
        &["scene", "holds no run"],
    );
    refused(
        dir.path(),
        &["demo-scene", "scene"],
        &["scene", "not empty"],
    );
}

#[test]
fn evaluation_prints_a_table_or_json_and_keeps_the_scores() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = crate::fabricated::run(dir.path(), true);
    let gt = run.scene_dir();
    let (run_path, gt_path) = (run.root().to_str().unwrap(), gt.to_str().unwrap());
    let output = sos(dir.path(), &["report", run_path]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let before = fs::read_to_string(run.report_path()).unwrap();
    assert!(!before.contains("<h2>Scores</h2>"));

    let masks = gt.join("coarse_masks");
    let evaluate = [
        "eval",
        run_path,
        "--gt",
        gt_path,
        "--start",
        masks.to_str().unwrap(),
    ];
    let output = sos(dir.path(), &evaluate);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let metrics: serde_json::Value =
        serde_json::from_slice(&fs::read(run.metrics_path()).unwrap()).unwrap();
    assert!(metrics["mean"]["iou"].as_f64().unwrap() > 0.999);
    assert!(metrics["start"]["iou"].as_f64().unwrap() < 0.9);
    for key in [
        "name",
        "iou",
        "miou",
        "acc",
        "boundary_iou",
        "sad",
        "mse",
        "grad",
        "conn",
    ] {
        assert!(!metrics["views"][0][key].is_null(), "{key}");
    }
    assert!(
        fs::read_to_string(run.report_path())
            .unwrap()
            .contains("<h2>Scores</h2>")
    );

    let output = sos(dir.path(), &[&evaluate[..], &["--json"]].concat());
    let printed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(printed["mean"], metrics["mean"]);
    refused(
        dir.path(),
        &["eval", run_path, "--gt", "nowhere"],
        &["nowhere"],
    );
    refused(dir.path(), &["report", gt_path], &["holds no run"]);
}

#[test]
fn a_run_without_a_checkpoint_is_not_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = crate::fabricated::run(dir.path(), true);
    refused(
        dir.path(),
        &["render", run.root().to_str().unwrap(), "--turntable", "4"],
        &["no checkpoint"],
    );
    assert!(!run.root().join("render").join("turntable").exists());
}

#[test]
fn cameras_to_draw_from_are_looked_at_first() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = crate::fabricated::run(dir.path(), true);
    let model = dir.path().join("other/sparse/0");
    fs::create_dir_all(&model).unwrap();
    let camera = "1 PINHOLE 96 72 100 100 48 36\n";
    fs::write(model.join("cameras.txt"), camera).unwrap();
    let render = ["render", run.root().to_str().unwrap(), "--views", "other"];
    let view = |camera: u32| format!("1 1 0 0 0 0 0 0 {camera} new.png\n\n");
    for (images, says) in [
        (view(7), &["new.png", "camera 7"][..]),
        (String::new(), &["other", "no views"]),
        // It goes on with what comes next.
        (view(1), &["no checkpoint"]),
    ] {
        fs::write(model.join("images.txt"), images).unwrap();
        refused(dir.path(), &render, says);
    }
}

#[test]
fn what_would_go_unheard_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = crate::fabricated::run(dir.path(), true);
    refused(
        dir.path(),
        &["report", run.root().to_str().unwrap(), "--gt", "nowhere"],
        &["nowhere", "no such folder", "--gt"],
    );
    tiny_scene(&dir.path().join("scene"));
    let masks = ["scene", "--masks", "scene/coarse_masks"];
    for hint in [["--click", "000.png:1,1"], ["--box", "0,0,0,1,1,1"]] {
        for command in ["train", "doctor"] {
            let arguments = [&[command][..], &masks, &hint].concat();
            refused(dir.path(), &arguments, &[hint[0], "--masks none"]);
        }
        // The demo has masks, and is not drawn first.
        refused(
            dir.path(),
            &[&["train"][..], &hint].concat(),
            &[hint[0], "--masks none"],
        );
    }
    fs::write(dir.path().join("file"), "").unwrap();
    refused(dir.path(), &["demo-scene", "file"], &["file", "choose"]);
    // Phones' photos that nothing here reads, with what to do about them.
    fs::create_dir(dir.path().join("phone")).unwrap();
    fs::write(dir.path().join("phone/IMG_1.HEIC"), "").unwrap();
    let output = sos(dir.path(), &["doctor", "phone"]);
    assert!(text(&output.stderr).contains("capture phone"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_path_that_no_text_can_hold_is_refused_before_a_folder_is_made() {
    use std::os::unix::ffi::OsStrExt as _;
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9"));
    tiny_scene(&scene);
    let output = Command::new(env!("CARGO_BIN_EXE_sos"))
        .current_dir(dir.path())
        .arg("train")
        .arg(&scene)
        .args(["--masks", "none", "--out", "run"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let says = text(&output.stderr);
    assert!(
        says.contains("Unicode") && says.contains("rename"),
        "{says}"
    );
    assert!(!dir.path().join("run").exists());
}

#[test]
fn quiet_is_quiet() {
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = crate::fabricated::run(dir.path(), true);
    let run = run.root().to_str().unwrap();
    tiny_scene(&dir.path().join("scene"));
    for arguments in [
        &["export", run, "--to", "alpha8", "--quiet"][..],
        &["import", "scene", "--out", "imported", "-q"],
    ] {
        let output = sos(dir.path(), arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(text(&output.stderr) + &text(&output.stdout), "");
    }
    assert!(dir.path().join("imported/sparse/0/images.bin").is_file());
}

#[test]
fn the_visual_hull_is_written_and_compared() {
    let dir = tempfile::tempdir().unwrap();
    tiny_scene(&dir.path().join("scene"));
    let hull = [
        "hull",
        "scene",
        "--masks",
        "scene/coarse_masks",
        "--out",
        "hull",
    ];
    // Somebody else's, whatever its name.
    let foreign = dir.path().join("hull.part/000.png");
    fs::create_dir_all(dir.path().join("hull.part")).unwrap();
    fs::write(&foreign, "mine").unwrap();
    // An empty folder is as good as none.
    fs::create_dir(dir.path().join("hull")).unwrap();
    let output = sos(dir.path(), &hull);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(fs::read_to_string(&foreign).unwrap(), "mine");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3);
    refused(
        dir.path(),
        &hull,
        &[
            "hull: there is something in it already, such as 000.png",
            "--out",
        ],
    );

    let output = sos(
        dir.path(),
        &[
            "compare",
            "hull",
            "rough=scene/coarse_masks",
            "--gt",
            "scene",
            "--page",
            "page.html",
        ],
    );
    let table = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let iou = |name: &str| -> f64 {
        let line = table.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    // The hull of so few views is fat, but it covers also the view that has no mask.
    assert!(iou("hull") > 0.3 && iou("hull") < 1.0, "{table}");
    assert!(
        table.contains("rough: 1 of 6 mattes missing") && !table.contains("hull:"),
        "{table}"
    );
    let page = fs::read_to_string(dir.path().join("page.html")).unwrap();
    // Truth and hull of six views, five masks.
    assert_eq!(page.matches("<img ").count(), 17);
    assert!(!page.contains("http"), "the page needs the network");
    refused(
        dir.path(),
        &["compare", "--gt", "scene", "nowhere"],
        &["nowhere"],
    );
    refused(
        dir.path(),
        &["compare", "--gt", "scene", "a=hull", "a=scene/coarse_masks"],
        &["two of the entries are called a", "NAME=DIR"],
    );
}
