//! Damaged and hostile files: always an error that helps, never a panic.

use crate::fixtures;
use scene_import::{ImportError, MaskOptions, MaskSource, detect, read};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// SplitMix64: enough randomness for tests, the same on every machine.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
}

/// A scene of every format, and the file in it that says most.
fn scenes(dir: &Path) -> Vec<(PathBuf, PathBuf)> {
    let scene = |name: &str, write: &dyn Fn(&Path), file: &str| {
        let scene = dir.join(name);
        fs::create_dir_all(&scene).unwrap();
        write(&scene);
        (scene.clone(), scene.join(file))
    };
    let mut all = vec![
        scene(
            "ngp",
            &|d| fixtures::transforms(d, |_| {}),
            "transforms.json",
        ),
        scene("llff", &|d| fixtures::llff(d, "images"), "poses_bounds.npy"),
        scene("neus", &fixtures::neus, "cameras_sphere.npz"),
        scene("mvs", &fixtures::blended_mvs, "cams/0002_cam.txt"),
        scene("freiburg1", &fixtures::tum, "groundtruth.txt"),
        scene("freiburg2", &fixtures::tum, "rgb.txt"),
        scene("metashape", &fixtures::metashape, "cameras.xml"),
        scene("rc", &fixtures::reality_capture, "registration.csv"),
    ];
    let co3d = dir.join("co3d");
    let sequence = fixtures::co3d(&co3d, Some("ndc_isotropic"));
    all.push((sequence, co3d.join("apple/frame_annotations.jgz")));
    all
}

fn open(scene: &Path) -> Result<usize, ImportError> {
    let detected = detect(scene, None)?;
    Ok(read(&detected, None)?.model.views.len())
}

fn assert_helps(error: &ImportError) {
    let text = error.to_string();
    assert!(text.contains(';'), "no remedy in: {text}");
}

fn mutate(mut bytes: Vec<u8>, random: &mut Random) -> Vec<u8> {
    const WORDS: [&[u8]; 10] = [
        b"NaN",
        b"1e999",
        b"-1",
        b"99999999999",
        b"\xff\xff\xff\xff",
        b"\0",
        b"\"",
        b"[",
        b"<",
        b"\n",
    ];
    for _ in 0..=random.below(3) {
        if bytes.is_empty() {
            break;
        }
        let at = random.below(bytes.len());
        match random.below(5) {
            0 => bytes[at] = random.below(256) as u8,
            1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes.truncate(at),
            3 => {
                let end = (at + 1 + random.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
            _ => {
                let word = WORDS[random.below(WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
        }
    }
    bytes
}

#[test]
fn mutated_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let mut random = Random(11);
    for (scene, file) in scenes(dir.path()) {
        assert!(open(&scene).unwrap() >= 4, "{}", scene.display());
        let intact = fs::read(&file).unwrap();
        let (mut accepted, mut refused) = (0, 0);
        for _ in 0..150 {
            fs::write(&file, mutate(intact.clone(), &mut random)).unwrap();
            match open(&scene) {
                Ok(_) => accepted += 1,
                Err(error) => {
                    refused += 1;
                    assert_helps(&error);
                }
            }
        }
        fs::write(&file, &intact).unwrap();
        println!("{}: {accepted} accepted, {refused} refused", file.display());
        assert!(refused > 20, "{}: {refused} refused", file.display());
    }
}

#[test]
fn truncated_files_are_refused_or_shorter() {
    let dir = tempfile::tempdir().unwrap();
    for (scene, file) in scenes(dir.path()) {
        let views = open(&scene).unwrap();
        let intact = fs::read(&file).unwrap();
        for parts in 0..16 {
            fs::write(&file, &intact[..intact.len() * parts / 16]).unwrap();
            match open(&scene) {
                // Lists in lines may end after any of them.
                Ok(left) => assert!(left <= views, "{}", file.display()),
                Err(error) => assert_helps(&error),
            }
        }
        fs::write(&file, &intact).unwrap();
    }
}

/// Replaces the first occurrence, which must be there.
fn spoil(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{from} is not in {}", file.display());
    fs::write(file, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn numbers_that_are_none_are_named_with_their_place() {
    let dir = tempfile::tempdir().unwrap();
    let scene = |name: &str| dir.path().join(name);
    let fails = |scene: &Path, says: &[&str]| {
        let error = open(scene).unwrap_err();
        assert_helps(&error);
        for part in says {
            assert!(
                error.to_string().contains(part),
                "{part:?} is not in {error}"
            );
        }
    };
    scenes(dir.path());

    spoil(
        &scene("freiburg1").join("groundtruth.txt"),
        "1305031102.0100 ",
        "1305031102.0100 NaN ",
    );
    fails(&scene("freiburg1"), &["groundtruth.txt, line 3", "finite"]);
    spoil(
        &scene("freiburg2").join("rgb.txt"),
        "1305031103.004000",
        "soon",
    );
    fails(&scene("freiburg2"), &["rgb.txt, line 4", "time"]);
    spoil(
        &scene("mvs").join("cams/0003_cam.txt"),
        "intrinsic",
        "intrinsic NaN",
    );
    fails(&scene("mvs"), &["0003_cam.txt", "not finite"]);
    spoil(
        &scene("mvs").join("cams/0003_cam.txt"),
        "intrinsic NaN",
        "intrinsic",
    );
    spoil(
        &scene("mvs").join("cams/0001_cam.txt"),
        "110 0.0 47",
        "110 0.0 4700",
    );
    fails(&scene("mvs"), &["0001_cam.txt", "another size"]);
    spoil(
        &scene("rc").join("registration.csv"),
        "0002.png,",
        "0002.png,inf",
    );
    fails(
        &scene("rc"),
        &["registration.csv, line 4", "x is no finite number"],
    );
    spoil(
        &scene("metashape").join("cameras.xml"),
        "label=\"0001\"><transform>",
        "label=\"0001\"><transform>nan ",
    );
    fails(
        &scene("metashape"),
        &["cameras.xml, line 24", "16 finite numbers"],
    );
    let bomb = format!("<!DOCTYPE x [<!ENTITY a \"{}\">]>", "&a;".repeat(10));
    spoil(
        &scene("metashape").join("cameras.xml"),
        "<document",
        &format!("{bomb}<document"),
    );
    fails(&scene("metashape"), &["XML is damaged"]);
}

#[test]
fn matrices_that_are_no_poses_are_refused() {
    let refused = |matrix: Value, says: &str| {
        let dir = tempfile::tempdir().unwrap();
        fixtures::transforms(dir.path(), |file| {
            file["frames"][1]["transform_matrix"] = matrix.clone()
        });
        let error = open(dir.path()).unwrap_err().to_string();
        assert!(
            error.contains(says) && error.contains("frame 2 (images/0002.png)"),
            "{error}"
        );
    };
    refused(json!([]), "3 or 4 rows");
    refused(json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), "3 or 4 rows");
    refused(
        json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]]),
        "singular",
    );
    refused(
        json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
        "mirrors",
    );
    refused(json!([[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]), "none");
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    spoil(
        &dir.path().join("transforms.json"),
        "[0.0,0.0,0.0,1.0]",
        "[0.0,NaN,0.0,1.0]",
    );
    let error = open(dir.path()).unwrap_err().to_string();
    assert!(error.contains("transforms.json, line 1"), "{error}");
}

#[test]
fn values_of_another_kind_are_named_with_their_frame_and_key() {
    let refused = |change: &dyn Fn(&mut Value), says: &str| {
        let dir = tempfile::tempdir().unwrap();
        fixtures::transforms(dir.path(), change);
        let error = open(dir.path()).unwrap_err();
        assert_helps(&error);
        assert!(error.to_string().contains(says), "{error}");
    };
    let frame = |file: &mut Value, key: &str, value: Value| file["frames"][2][key] = value;
    refused(
        &|file| file["w"] = json!("96"),
        "transforms.json: w: invalid type: string",
    );
    refused(
        &|file| frame(file, "k1", json!([0.1])),
        "frame 3 (images/0003.png): k1: invalid type: sequence",
    );
    refused(
        &|file| frame(file, "transform_matrix", json!("none")),
        "frame 3 (images/0003.png): transform_matrix: ",
    );
    refused(
        &|file| frame(file, "transform_matrix", Value::Null),
        "frame 3 (images/0003.png): transform_matrix is missing",
    );
    refused(
        &|file| frame(file, "file_path", json!(3)),
        "frame 3: file_path: invalid type: integer",
    );
    refused(&|file| file["frames"][2] = json!(7), "frame 3: it is no");
    refused(&|file| file["frames"] = json!({}), "frames: there is no");
    refused(&|file| *file = json!([]), "it is no object with frames");
}

#[test]
fn intrinsics_that_nobody_knows_are_said_to_be_unknown() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("desk");
    fixtures::tum(&scene);
    // In the benchmark's shape, a guess will do.
    assert_eq!(open(&scene).unwrap(), 4);
    crate::rig::write_photo(&scene.join("rgb/0002.png"), 128, 72);
    let error = open(&scene).unwrap_err();
    assert_helps(&error);
    let error = error.to_string();
    assert!(
        error.contains("rgb/0002.png: the photo is 128x72, and intrinsics are not known")
            && error.contains("transforms.json"),
        "{error}"
    );
}

#[test]
fn counts_that_do_not_agree_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::llff(&dir.path().join("llff"), "images");
    fs::remove_file(dir.path().join("llff/images/0002.png")).unwrap();
    let error = open(&dir.path().join("llff")).unwrap_err().to_string();
    assert!(
        error.contains("4 poses") && error.contains("3 in "),
        "{error}"
    );
    let values = vec![0.0; 15 * 4];
    fs::write(
        dir.path().join("llff/poses_bounds.npy"),
        fixtures::npy(&[4, 15], &values),
    )
    .unwrap();
    let error = open(&dir.path().join("llff")).unwrap_err().to_string();
    assert!(error.contains("[4, 15]"), "{error}");

    fixtures::neus(&dir.path().join("neus"));
    fs::remove_file(dir.path().join("neus/image/0002.png")).unwrap();
    let error = open(&dir.path().join("neus")).unwrap_err().to_string();
    assert!(
        error.contains("4 cameras") && error.contains("3 photos"),
        "{error}"
    );
}

#[test]
fn mutated_annotations_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let imported = read(&detect(dir.path(), None).unwrap(), None).unwrap();
    let file = dir.path().join("coco.json");
    let intact = json!({
        "images": [
            {"id": 1, "file_name": "0001.png", "width": 96, "height": 64},
            {"id": 2, "file_name": "0002.png", "width": 96, "height": 64},
        ],
        "annotations": [
            {"image_id": 1, "category_id": 1, "segmentation": [[10.0, 10.0, 50.0, 12.0, 40.0, 44.5]]},
            {"image_id": 2, "category_id": 1, "segmentation": {"size": [64, 96], "counts": [100, 50, 5994]}},
            {"image_id": 2, "category_id": 1, "segmentation": {"size": [64, 96], "counts": crate::masks::PACKED}},
        ],
        "categories": [{"id": 1, "name": "cat"}],
    })
    .to_string()
    .into_bytes();
    let options = MaskOptions {
        source: MaskSource::Path(file.clone()),
        ..MaskOptions::default()
    };
    fs::write(&file, &intact).unwrap();
    let written = imported
        .write(&dir.path().join("intact"), &options)
        .unwrap();
    assert_eq!(written.masks, 2);
    let (mut random, mut refused) = (Random(5), 0);
    for i in 0..150 {
        fs::write(&file, mutate(intact.clone(), &mut random)).unwrap();
        let out = dir.path().join(format!("out{i}"));
        if let Err(error) = imported.write(&out, &options) {
            refused += 1;
            assert_helps(&error);
            assert!(!out.exists(), "nothing is left behind");
        }
    }
    assert!(refused > 20, "{refused}");
}
