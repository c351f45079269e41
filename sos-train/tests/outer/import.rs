//! Scenes that are not COLMAP's: imported on request, and by training on its own.

use io_colmap::Scene;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn sos(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(arguments)
        .current_dir(dir)
        .output()
        .unwrap()
}

fn says(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned()
}

/// Exit code 2, one sentence with all of `parts`, and no new entry in `dir`.
fn refused(dir: &Path, arguments: &[&str], parts: &[&str]) {
    let before = fs::read_dir(dir).unwrap().count();
    let output = sos(dir, arguments);
    let text = says(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }
    let after = fs::read_dir(dir).unwrap().count();
    assert_eq!(after, before, "{arguments:?} left something");
}

/// The miniature demo with transforms.json in place of its COLMAP model.
fn scene_with_transforms(dir: &Path) {
    crate::fabricated::SCENE.write(dir).unwrap();
    let scene = Scene::open(dir).unwrap();
    let frames: Vec<serde_json::Value> = scene
        .model
        .views
        .iter()
        .map(|view| {
            let pose = view.camera_from_world.inverse();
            let [right, up, back] = [glam::DVec3::X, -glam::DVec3::Y, -glam::DVec3::Z]
                .map(|axis| pose.transform_vector(axis));
            let c = pose.translation;
            serde_json::json!({
                "file_path": format!("images/{}", view.name),
                "transform_matrix": [
                    [right.x, up.x, back.x, c.x],
                    [right.y, up.y, back.y, c.y],
                    [right.z, up.z, back.z, c.z],
                    [0, 0, 0, 1],
                ],
            })
        })
        .collect();
    let camera = &scene.model.cameras[&scene.model.views[0].camera_id];
    let mut file = serde_json::json!({"frames": frames, "w": camera.width, "h": camera.height});
    for (key, value) in ["fl_x", "fl_y", "cx", "cy"].into_iter().zip(&camera.params) {
        file[key] = (*value).into();
    }
    file["frames"]
        .as_array_mut()
        .unwrap()
        .push(serde_json::json!({
            "file_path": "images/gone.png", "transform_matrix": frames[0]["transform_matrix"],
        }));
    fs::write(dir.join("transforms.json"), file.to_string()).unwrap();
    fs::remove_dir_all(dir.join("sparse")).unwrap();
}

#[test]
fn a_scene_may_be_written_into_the_folder_one_is_in() {
    let dir = tempfile::tempdir().unwrap();
    scene_with_transforms(&dir.path().join("fox"));
    let here = dir.path().join("here");
    fs::create_dir(&here).unwrap();
    // What a killed run leaves is seen by nobody who just lists the folder.
    fs::create_dir(here.join(".sos-partial-a1B2c3")).unwrap();
    refused(
        &here,
        &["import", "../fox", "--out", "."],
        &[
            "something in it already, such as .sos-partial-a1B2c3",
            "delete",
        ],
    );
    fs::remove_dir(here.join(".sos-partial-a1B2c3")).unwrap();
    let output = sos(&here, &["import", "../fox", "--out", "."]);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    let mut names: Vec<_> = fs::read_dir(&here)
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["images", "import.txt", "sparse"]);
    refused(
        &here,
        &["import", "../fox", "--out", "."],
        &["something in it already, such as images; name a folder"],
    );
}

#[test]
fn import_says_what_it_does_and_writes_a_colmap_scene() {
    let dir = tempfile::tempdir().unwrap();
    let fox = dir.path().join("fox");
    scene_with_transforms(&fox);
    fs::create_dir(fox.join("ignore")).unwrap();
    let someone = image::GrayImage::from_pixel(96, 72, image::Luma([255]));
    someone.save(fox.join("ignore/001.png")).unwrap();
    let arguments = [
        "import",
        "fox",
        "--out",
        "new/scene",
        "--masks",
        "fox/coarse_masks",
    ];
    let output = sos(dir.path(), &arguments);
    let text = says(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    for part in [
        "transforms.json",
        "left out: images/gone.png has no photo",
        "6 photos with poses, 5 masks",
        "1 of 6 photos have an ignore picture",
        "train new/scene",
    ] {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }
    let scene = Scene::open(&dir.path().join("new/scene")).unwrap();
    assert_eq!(scene.model.views.len(), 6);
    assert!(scene.root.join("ignore/001.png").is_file());
    refused(
        dir.path(),
        &arguments,
        &["new/scene", "something in it already"],
    );

    let out = ["--out", "other"];
    let import = |more: &[&'static str]| [&["import", "fox"][..], &out, more].concat();
    refused(
        dir.path(),
        &import(&["--format", "llff"]),
        &["LLFF", "not found"],
    );
    refused(
        dir.path(),
        &import(&["--format", "kolmap"]),
        &["kolmap", "colmap"],
    );
    refused(dir.path(), &import(&["--label", "1"]), &["--masks"]);
    refused(
        dir.path(),
        &import(&["--masks", "nothing.json"]),
        &["nothing.json"],
    );
    fs::write(dir.path().join("fox/transforms.json"), "{\"frames\": [").unwrap();
    refused(dir.path(), &import(&[]), &["transforms.json, line 1"]);
}

#[test]
fn training_imports_a_scene_and_keeps_it() {
    let dir = tempfile::tempdir().unwrap();
    let fox = dir.path().join("fox");
    scene_with_transforms(&fox);
    fs::create_dir(fox.join("ignore")).unwrap();
    let white_at_left = |x, _| image::Luma([if x < 10 { 255 } else { 0 }]);
    let someone = image::GrayImage::from_fn(96, 72, white_at_left);
    someone.save(fox.join("ignore/003.png")).unwrap();
    let settings = [
        "steps=4",
        "model.levels=4",
        "model.log2_table_size=12",
        "sampling.target_samples=1024",
        "sampling.occupancy_resolution=32",
        "export.mesh_resolution=32",
    ];
    // The file with the poses does as well as its folder.
    let mut train = vec![
        "train",
        "fox/transforms.json",
        "--masks",
        "fox/coarse_masks",
        "--out",
        "run",
    ];
    train.extend(["--preset", "quick"]);
    train.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    let output = sos(dir.path(), &train);
    let text = says(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(
        text.contains("transforms.json") && text.contains("run/scene"),
        "{text}"
    );
    assert!(
        text.contains("parts of 1 photo are not learned from"),
        "{text}"
    );
    let run = dir.path().join("run");
    for file in [
        "scene/import.txt",
        "scene/sparse/0/images.bin",
        "scene/masks",
        "scene/ignore/003.png",
        "report.html",
    ] {
        assert!(run.join(file).exists(), "{file}");
    }
    let config = fs::read_to_string(run.join("config.toml")).unwrap();
    assert!(
        config.contains("imported_from") && config.contains("fox"),
        "{config}"
    );

    // Made once more in its place, as messages about damaged results tell, it has the same scene as its own.
    let again = ["train", "--config", "run/config.toml", "--out", "run"];
    let output = sos(dir.path(), &[&again[..], &["--force"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    let repeated = fs::read_to_string(run.join("config.toml")).unwrap();
    assert_eq!(repeated, config);

    // It goes on without what it was made from, also from another place.
    fs::remove_dir_all(&fox).unwrap();
    fs::rename(&run, dir.path().join("moved")).unwrap();
    let resume = ["train", "--resume", "--out", "moved", "--steps", "6"];
    let output = sos(dir.path(), &resume);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    let output = sos(dir.path(), &["report", "moved"]);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));

    // Another scene that turns out to be of no use costs neither its scene nor its results.
    scene_with_transforms(&dir.path().join("wolf"));
    fs::create_dir(dir.path().join("nobody")).unwrap();
    fs::write(dir.path().join("moved/scene/earlier.txt"), "").unwrap();
    let replace = ["train", "wolf", "--out", "moved", "--force"];
    let ignore = ["--ignore", "nobody"];
    refused(dir.path(), &[&replace[..], &ignore].concat(), &["nobody"]);
    let run = dir.path().join("moved");
    assert!(run.join("scene/earlier.txt").is_file());
    assert!(run.join("report.html").is_file());
    let mut begun = replace.to_vec();
    begun.extend(["--masks", "wolf/coarse_masks", "--preset", "quick"]);
    begun.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    let output = sos(dir.path(), &begun);
    assert_eq!(output.status.code(), Some(0), "{}", says(&output));
    assert!(!run.join("scene/earlier.txt").exists());
    let left: Vec<_> = fs::read_dir(&run)
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains("partial"))
        .collect();
    assert_eq!(left, [""; 0]);
}

#[test]
fn scenes_that_cannot_be_imported_leave_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("fox");
    scene_with_transforms(&scene);
    let train = |more: &[&'static str]| [&["train", "fox", "--out", "run"][..], more].concat();
    refused(
        dir.path(),
        &train(&["--masks", "alpha"]),
        &["alpha channel"],
    );
    refused(
        dir.path(),
        &train(&["--masks", "nothing.json"]),
        &["nothing.json"],
    );
    refused(
        dir.path(),
        &train(&["--label", "7", "--masks", "fox/coarse_masks"]),
        &["label 7"],
    );
    // Neither does it take anything away: the folder may be the one that a shell is in.
    let here = dir.path().join("here");
    fs::create_dir(&here).unwrap();
    let stated = here.to_str().unwrap();
    refused(
        &here,
        &["train", "../fox", "--out", stated, "--masks", "alpha"],
        &["alpha channel"],
    );
    // A scene folder that no run made is left alone.
    fs::create_dir_all(dir.path().join("run/checkpoint")).unwrap();
    fs::create_dir_all(dir.path().join("run/scene")).unwrap();
    fs::write(dir.path().join("run/scene/mine.txt"), "").unwrap();
    refused(
        dir.path(),
        &train(&["--force"]),
        &["run/scene", "in the way"],
    );
    assert!(dir.path().join("run/scene/mine.txt").is_file());
    fs::remove_dir_all(scene.join("images")).unwrap();
    refused(
        dir.path(),
        &["train", "fox", "--out", "new"],
        &["none of its 7 views"],
    );
}
