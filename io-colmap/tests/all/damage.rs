//! Damaged and hostile files: always an error that helps, never a panic.

use crate::sample::{self, Random};
use io_colmap::{ColmapError, Model, Place};
use std::fs;
use std::path::Path;

const FILES: [[&str; 3]; 2] = [
    ["cameras.bin", "images.bin", "points3D.bin"],
    ["cameras.txt", "images.txt", "points3D.txt"],
];

fn write(dir: &Path, model: &Model, files: &[&str; 3]) {
    let done = if files[0].ends_with("bin") {
        model.write_binary(dir)
    } else {
        model.write_text(dir)
    };
    done.unwrap();
}

/// Mutates valid files thousands of times. What still reads must write and behave.
#[test]
fn mutated_files_never_panic() {
    let mut model = sample::model();
    model.points.truncate(8);
    let mut random = Random(2024);
    let (mut accepted, mut refused) = (0, 0);
    for files in &FILES {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), &model, files);
        for name in files {
            let path = dir.path().join(name);
            let intact = fs::read(&path).unwrap();
            for _ in 0..800 {
                fs::write(&path, mutate(intact.clone(), &mut random)).unwrap();
                match Model::read(dir.path()) {
                    Ok(read) => {
                        accepted += 1;
                        exercise(&read);
                    }
                    Err(error) => {
                        refused += 1;
                        assert!(error.to_string().contains(';'), "no remedy in: {error}");
                    }
                }
            }
            fs::write(&path, intact).unwrap();
        }
    }
    assert!(
        accepted > 100 && refused > 1000,
        "{accepted} accepted, {refused} refused"
    );
}

/// Every truncation of every binary file is an error; text may end after any full entry.
#[test]
fn truncated_files_are_refused() {
    let model = sample::small(&["a.png", "b.png"]);
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), &model, &FILES[0]);
    for name in FILES[0] {
        let path = dir.path().join(name);
        let intact = fs::read(&path).unwrap();
        for length in 0..intact.len() {
            fs::write(&path, &intact[..length]).unwrap();
            let error = Model::read(dir.path()).unwrap_err();
            assert!(error.to_string().contains(name), "{error}");
            assert!(
                matches!(
                    error,
                    ColmapError::Format {
                        place: Place::Byte(_),
                        ..
                    }
                ),
                "{error}"
            );
        }
        fs::write(&path, [&intact[..], b"x"].concat()).unwrap();
        assert!(
            Model::read(dir.path())
                .unwrap_err()
                .to_string()
                .contains("follow the last")
        );
        fs::write(&path, intact).unwrap();
    }
}

fn mutate(mut bytes: Vec<u8>, random: &mut Random) -> Vec<u8> {
    const NASTY: [&[u8]; 10] = [
        &[0xff; 8],
        &[0; 8],
        &[0, 0, 0, 0, 0, 0, 0xf8, 0x7f],
        &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f],
        b" nan ",
        b" -1 ",
        b" 1e400 ",
        b"\n",
        b"../",
        b" 99999999999999999999 ",
    ];
    for _ in 0..=random.below(3) {
        let at = random.below(bytes.len().max(1));
        match random.below(5) {
            0 if !bytes.is_empty() => bytes[at] = random.next() as u8,
            1 if !bytes.is_empty() => bytes[at] ^= 1 << random.below(8),
            2 => bytes.truncate(at),
            3 => {
                let piece = NASTY[random.below(NASTY.len())];
                let end = (at + piece.len()).min(bytes.len());
                let at = at.min(end);
                bytes.splice(at..end, piece.iter().copied());
            }
            _ => {
                let piece = NASTY[random.below(NASTY.len())];
                let at = at.min(bytes.len());
                bytes.splice(at..at, piece.iter().copied());
            }
        }
    }
    bytes
}

/// Uses all of a model that was accepted.
fn exercise(model: &Model) {
    for view in &model.views {
        let camera = &model.cameras[&view.camera_id];
        assert!(view.name.split(['/', '\\']).all(|part| part != ".."));
        let pose = view.camera_from_world;
        assert!((pose.rotation.length() - 1.0).abs() < 1e-9);
        for point in &model.points {
            let pixel = camera.project(pose.transform_point(point.position));
            assert!(pixel.is_none_or(|p| p.is_finite()));
        }
        let _ = camera.unproject(glam::DVec2::new(3.0, 400.0));
        let _ = camera.scaled_to(7, 9).project(pose.centre());
    }
}

/// Replaces the first occurrence of `from` in one of the small text model's files.
fn text_error(file: &str, from: &str, to: &str) -> String {
    let mut model = sample::small(&["a.png", "b.png"]);
    model.points = sample::model().points[..1].to_vec();
    let dir = tempfile::tempdir().unwrap();
    model.write_text(dir.path()).unwrap();
    let path = dir.path().join(file);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{text}");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
    Model::read(dir.path()).unwrap_err().to_string()
}

#[test]
fn text_errors_name_file_line_cause_and_remedy() {
    for (file, from, to, line, says) in [
        (
            "cameras.txt",
            "SIMPLE_RADIAL",
            "KANNALA",
            2,
            "unknown model \"KANNALA\"; undistort",
        ),
        (
            "cameras.txt",
            " 0.01",
            "",
            2,
            "has 3 parameters but SIMPLE_RADIAL takes 4",
        ),
        ("cameras.txt", " 0.01", " 0.01 7", 2, "has 5 parameters"),
        ("cameras.txt", " 60 ", " NaN ", 2, "has the parameter NaN"),
        (
            "cameras.txt",
            " 60 ",
            " -60 ",
            2,
            "focal length that is not positive",
        ),
        ("cameras.txt", " 64 ", " 0 ", 2, "has the size 0x48"),
        (
            "cameras.txt",
            " 64 ",
            " 99999999 ",
            2,
            "has the size 99999999x48",
        ),
        (
            "cameras.txt",
            " 64 ",
            " wide ",
            2,
            "\"wide\" is no valid image width; correct",
        ),
        (
            "images.txt",
            "1 1 0 0 0",
            "1 0 0 0 0",
            3,
            "zero quaternion; the reconstruction failed",
        ),
        (
            "images.txt",
            "1 1 0 0 0",
            "1 nan 0 0 0",
            3,
            "the pose of \"a.png\" is not finite",
        ),
        (
            "images.txt",
            "a.png",
            "../a.png",
            3,
            "leads out of the image folder; give the photo",
        ),
        (
            "images.txt",
            "a.png",
            "/etc/a.png",
            3,
            "leads out of the image folder",
        ),
        (
            "images.txt",
            "a.png",
            "c:\\a.png",
            3,
            "leads out of the image folder",
        ),
        (
            "images.txt",
            "a.png",
            "x\\..\\a.png",
            3,
            "leads out of the image folder",
        ),
        ("images.txt", " a.png", "", 3, "empty name"),
        (
            "images.txt",
            "a.png\n\n",
            "a.png\n",
            4,
            "every photo takes two lines",
        ),
        (
            "points3D.txt",
            " 128 ",
            " 256 ",
            2,
            "\"256\" is no valid colour",
        ),
        (
            "points3D.txt",
            "1000 ",
            "1000 inf 0 0 1 2 3 0\n1000 ",
            2,
            "point 1000 is at [inf",
        ),
    ] {
        let error = text_error(file, from, to);
        assert!(error.contains(&format!("{file}, line {line}: ")), "{error}");
        assert!(
            error.contains(says) && error.contains("; "),
            "{says}: {error}"
        );
    }
    let error = text_error("images.txt", "b.png", "a.png");
    assert!(
        error.contains("two photos are named \"a.png\"; a model must list each once"),
        "{error}"
    );
    let error = text_error("images.txt", " 1 b.png", " 9 b.png");
    assert!(
        error.contains("\"b.png\" uses camera 9, which is not listed"),
        "{error}"
    );
}

/// Overwrites bytes in one of the small binary model's files.
fn binary_error(file: &str, at: usize, bytes: &[u8]) -> String {
    let dir = tempfile::tempdir().unwrap();
    sample::small(&["a.png", "b.png"])
        .write_binary(dir.path())
        .unwrap();
    let path = dir.path().join(file);
    let mut all = fs::read(&path).unwrap();
    all[at..at + bytes.len()].copy_from_slice(bytes);
    fs::write(&path, all).unwrap();
    Model::read(dir.path()).unwrap_err().to_string()
}

#[test]
fn binary_errors_name_file_offset_cause_and_remedy() {
    let huge = (1_u64 << 60).to_le_bytes();
    let nan = f64::NAN.to_le_bytes();
    for (file, at, bytes, says) in [
        (
            "cameras.bin",
            0,
            &huge[..],
            "byte 0: the number of cameras says 1152921504606846976, more than",
        ),
        ("images.bin", 0, &huge, "byte 0: the number of photos says"),
        (
            "points3D.bin",
            0,
            &huge,
            "byte 0: the number of points says",
        ),
        (
            "cameras.bin",
            12,
            &99_u32.to_le_bytes(),
            "byte 8: camera 1 has the unknown model number 99",
        ),
        ("cameras.bin", 32, &nan, "camera 1 has the parameter NaN"),
        (
            "images.bin",
            12,
            &nan,
            "byte 8: the pose of \"a.png\" is not finite",
        ),
        (
            "images.bin",
            12,
            &[0; 8],
            "the rotation of \"a.png\" is a zero quaternion",
        ),
        (
            "images.bin",
            72,
            b"\xff",
            "byte 72: the photo name \"\u{fffd}.png\" is not UTF-8; rename",
        ),
        (
            "images.bin",
            72,
            b"../..",
            "\"../..\" leads out of the image folder",
        ),
        (
            "images.bin",
            78,
            &huge,
            "byte 78: a photo's number of measured positions says",
        ),
    ] {
        let error = binary_error(file, at, bytes);
        assert!(
            error.contains(file) && error.contains(says),
            "{says}: {error}"
        );
        assert!(error.contains("; "), "{error}");
    }
}

#[test]
fn a_folder_without_a_model_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let error = Model::read(dir.path()).unwrap_err().to_string();
    assert!(
        error.contains("holds no COLMAP model; it needs cameras.bin"),
        "{error}"
    );
}
