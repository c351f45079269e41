//! Views and masks of every format, against the rig.

use crate::fixtures::{self, import};
use crate::rig::{self, CENTRE, FOCAL, HEIGHT, WIDTH, assert_sees, eyes, pinhole};
use glam::{DMat3, DQuat, DVec2, DVec3};
use scene_import::{Format, detect, read};
use serde_json::{Value, json};
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

/// Exact but for rounding.
const EXACT: f64 = 1e-6;

#[test]
fn transforms_with_a_pinhole() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| {
        let frames = file["frames"].as_array_mut().unwrap();
        frames.push(json!({"file_path": "images/gone.png", "transform_matrix": [[1, 2]]}));
        frames.push(frames[0].clone());
        // As nerfstudio, Windows and NeRF's synthetic scenes write paths.
        frames[0]["file_path"] = "./images/0001".into();
        frames[1]["file_path"] = "images\\0002.png".into();
    });
    let imported = import(dir.path(), Format::Transforms).unwrap();
    assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
    assert_eq!(imported.model.cameras.len(), 1, "equal cameras are one");
    let dropped: Vec<&str> = imported.dropped.iter().map(|d| d.why.as_str()).collect();
    assert_eq!(
        dropped,
        ["has no photo", "is listed twice"],
        "{:?}",
        imported.dropped
    );
    let missing: Vec<bool> = imported.dropped.iter().map(|d| d.is_missing()).collect();
    assert_eq!(missing, [true, false], "one photo is there");
    assert_eq!(imported.model.views[0].name, "0001.png");
}

#[test]
fn transforms_state_the_focal_length_in_many_ways() {
    let across = 2.0 * (0.5 * f64::from(WIDTH) / FOCAL.x).atan();
    let down = 2.0 * (0.5 * f64::from(HEIGHT) / FOCAL.y).atan();
    let centred =
        |p: DVec2, focal: DVec2| p * focal + 0.5 * DVec2::new(f64::from(WIDTH), f64::from(HEIGHT));
    let square = DVec2::splat(FOCAL.x);
    for (lens, focal) in [
        (json!({"camera_angle_x": across}), square),
        (
            json!({"camera_angle_x": across, "camera_angle_y": down}),
            FOCAL,
        ),
        (
            json!({"x_fov": across.to_degrees(), "y_fov": down.to_degrees()}),
            FOCAL,
        ),
        (json!({"fl_x": FOCAL.x, "camera_angle_y": down}), FOCAL),
        (json!({"fl_y": FOCAL.x, "h": HEIGHT, "w": WIDTH}), square),
        // Stated for larger photos: 192.0 as some tools write whole numbers.
        (
            json!({"w": 192.0, "h": 128.0, "fl_x": 220.0, "fl_y": 210.0}),
            FOCAL,
        ),
        (
            json!({"camera_angle_x": across, "w": 960, "h": 640}),
            square,
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        fixtures::transforms(dir.path(), |file| {
            let mut with = lens.clone();
            with["frames"] = file["frames"].clone();
            *file = with;
        });
        let imported = import(dir.path(), Format::Transforms).unwrap();
        assert_sees(&imported.model, &eyes(), EXACT, |_, p| centred(p, focal));
    }
}

#[test]
fn intrinsics_of_a_frame_win_over_those_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| {
        file["k1"] = json!(0.3);
        for (i, frame) in file["frames"]
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .enumerate()
        {
            frame["fl_x"] = json!(100.0 + i as f64);
            frame["k1"] = json!(0.0);
        }
        file["fl_x"] = Value::Null;
    });
    let imported = import(dir.path(), Format::Transforms).unwrap();
    assert_eq!(imported.model.cameras.len(), 4);
    assert_sees(&imported.model, &eyes(), EXACT, |eye, p| {
        let i: f64 = eye.name.parse().unwrap();
        p * DVec2::new(99.0 + i, FOCAL.y) + CENTRE
    });
}

#[test]
fn what_nerfstudio_applied_is_undone() {
    let (turn, shift) = (
        DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.5, 1.0, -2.0)),
        DVec3::new(0.3, -0.1, 2.0),
    );
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| {
        for (frame, eye) in file["frames"]
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .zip(eyes())
        {
            let moved = rig::Eye {
                right: turn * eye.right,
                down: turn * eye.down,
                forward: turn * eye.forward,
                centre: (turn * eye.centre + shift) * 0.25,
                ..eye
            };
            frame["transform_matrix"] = fixtures::opengl_matrix(&moved);
        }
        let row = |i: usize| json!([turn.row(i).x, turn.row(i).y, turn.row(i).z, shift[i]]);
        file["applied_transform"] = json!([row(0), row(1), row(2)]);
        file["applied_scale"] = json!(0.25);
    });
    let imported = import(dir.path(), Format::Transforms).unwrap();
    assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
    assert!(
        imported
            .notes
            .iter()
            .any(|n| n.contains("applied_transform"))
    );
}

#[test]
fn nerf_synthetic_scenes_are_found_by_their_training_views() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    fs::rename(
        dir.path().join("transforms.json"),
        dir.path().join("transforms_train.json"),
    )
    .unwrap();
    let imported = import(dir.path(), Format::Transforms).unwrap();
    assert!(imported.notes.iter().any(|n| n.contains("training views")));
    // Another file of the same kind, by its own name.
    let other = dir.path().join("transforms_test.json");
    fs::copy(dir.path().join("transforms_train.json"), &other).unwrap();
    let detected = detect(&other, None).unwrap();
    assert_eq!(
        (detected.format, &detected.source),
        (Format::Transforms, &other)
    );
    assert_eq!(read(&detected, None).unwrap().model.views.len(), 4);
}

#[test]
fn photos_may_lie_elsewhere() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let elsewhere = dir.path().join("elsewhere");
    fs::rename(dir.path().join("images"), &elsewhere).unwrap();
    let detected = detect(dir.path(), None).unwrap();
    let error = read(&detected, None).unwrap_err().to_string();
    assert!(
        error.contains("none of its 4 views") && error.contains("--images"),
        "{error}"
    );
    assert_eq!(
        read(&detected, Some(&elsewhere)).unwrap().model.views.len(),
        4
    );
    // So may those of the other formats that state paths.
    let sequence = fixtures::co3d(&dir.path().join("co3d"), None);
    fixtures::tum(&dir.path().join("freiburg1"));
    for (scene, photos) in [(sequence, "images"), (dir.path().join("freiburg1"), "rgb")] {
        let moved = dir.path().join(format!("moved {photos}"));
        let detected = detect(&scene, None).unwrap();
        fs::rename(scene.join(photos), &moved).unwrap();
        fs::create_dir(scene.join(photos)).unwrap();
        assert!(read(&detected, None).is_err());
        let imported = read(&detected, Some(&moved)).unwrap();
        assert_eq!(imported.model.views.len(), 4, "{photos}");
    }
    let nowhere = read(&detected, Some(&dir.path().join("x"))).unwrap_err();
    assert!(nowhere.to_string().contains("no such folder"));
}

#[test]
fn llff_with_smaller_photos() {
    for folder in ["images", "images_4", "images_8"] {
        let dir = tempfile::tempdir().unwrap();
        fixtures::llff(dir.path(), folder);
        if folder != "images" {
            // The originals are there too, but not all of them.
            rig::write_photo(&dir.path().join("images/a.png"), WIDTH, HEIGHT);
        }
        let imported = import(dir.path(), Format::Llff).unwrap();
        assert_sees(&imported.model, &eyes(), EXACT, |_, p| {
            p * 100.0 + 0.5 * DVec2::new(f64::from(WIDTH), f64::from(HEIGHT))
        });
    }
}

#[test]
fn neus_projection_matrices_come_apart() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::neus(dir.path());
    let imported = import(dir.path(), Format::Neus).unwrap();
    assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
    for (view, mask) in imported.model.views.iter().zip(&imported.masks) {
        assert!(
            mask.as_ref()
                .unwrap()
                .ends_with(format!("mask/{}", view.name))
        );
    }
    assert!(
        imported
            .notes
            .iter()
            .any(|n| n.contains("within 2.000 of (0.100, 0.200, 0.300)"))
    );
    // By number, where some photos are gone.
    for (i, eye) in eyes().iter().enumerate() {
        let from = dir.path().join(format!("image/{}.png", eye.name));
        fs::rename(from, dir.path().join(format!("image/{i:03}.png"))).unwrap();
    }
    fs::remove_file(dir.path().join("image/001.png")).unwrap();
    let imported = import(dir.path(), Format::Neus).unwrap();
    let third = &imported.model.views[1];
    assert_eq!(third.name, "002.png");
    assert!(third.camera_from_world.centre().distance(eyes()[2].centre) < EXACT);
}

#[test]
fn arrays_that_neus_does_not_know_may_hold_what_they_like() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::neus(dir.path());
    let add = |name: &str, descr: &str, data: &[u8]| {
        let path = dir.path().join("cameras_sphere.npz");
        let file = fs::File::options().read(true).write(true).open(path);
        let mut archive = zip::ZipWriter::new_append(file.unwrap()).unwrap();
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored);
        archive.start_file(format!("{name}.npy"), options).unwrap();
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1,), }}");
        archive.write_all(b"\x93NUMPY\x01\x00").unwrap();
        let length = (header.len() as u16).to_le_bytes();
        archive.write_all(&length).unwrap();
        archive.write_all(header.as_bytes()).unwrap();
        archive.write_all(data).unwrap();
        archive.finish().unwrap();
    };
    add("image_names", "<U7", &[0; 28]);
    add("world_mat_inv_0", "|O", &[1, 2, 3]);
    let imported = import(dir.path(), Format::Neus).unwrap();
    assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
    // What is used must be numbers.
    add("world_mat_4", "<U7", &[0; 28]);
    let error = import(dir.path(), Format::Neus).unwrap_err().to_string();
    assert!(
        error.contains("world_mat_4: numbers of type \"<U7\" are not known; save it again with numpy, its numbers as float64"),
        "{error}"
    );
}

#[test]
fn neus_masks_stay_with_their_photos_when_some_are_gone() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::neus(dir.path());
    let rename = |folder: &str, to: &dyn Fn(usize) -> String| {
        let folder = dir.path().join(folder);
        for (i, eye) in eyes().iter().enumerate() {
            fs::rename(folder.join(format!("{}.png", eye.name)), folder.join(to(i))).unwrap();
        }
    };
    let masks = || -> Vec<String> {
        let imported = import(dir.path(), Format::Neus).unwrap();
        let name = |mask: &Option<PathBuf>| {
            let name = mask.as_deref().unwrap().file_name().unwrap();
            name.to_string_lossy().into_owned()
        };
        imported.masks.iter().map(name).collect()
    };
    rename("image", &|i| format!("{i:06}.png"));
    rename("mask", &|i| format!("{i:03}.png"));
    fs::remove_file(dir.path().join("image/000001.png")).unwrap();
    // All four masks are there, and go by number.
    assert_eq!(masks(), ["000.png", "002.png", "003.png"]);
    // As many as photos.
    fs::remove_file(dir.path().join("mask/001.png")).unwrap();
    assert_eq!(masks(), ["000.png", "002.png", "003.png"]);
    // Names that say nothing: by order.
    for (from, to) in [("000", "a"), ("002", "b"), ("003", "c")] {
        let mask = |name: &str| dir.path().join(format!("mask/{name}.png"));
        fs::rename(mask(from), mask(to)).unwrap();
    }
    assert_eq!(masks(), ["a.png", "b.png", "c.png"]);
    fs::remove_file(dir.path().join("mask/b.png")).unwrap();
    let imported = import(dir.path(), Format::Neus).unwrap();
    assert!(imported.masks.iter().all(Option::is_none));
    assert!(imported.notes.iter().any(|note| note.contains("2 masks")));
}

#[test]
fn blended_mvs_text_files() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::blended_mvs(dir.path());
    let imported = import(dir.path(), Format::BlendedMvs).unwrap();
    assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
    let photo = |name: &str| dir.path().join("blended_images").join(name);
    fs::rename(photo("0001.png"), photo("0001.PNG")).unwrap();
    fs::remove_file(photo("0002.png")).unwrap();
    let imported = import(dir.path(), Format::BlendedMvs).unwrap();
    assert_eq!((imported.model.views.len(), imported.dropped.len()), (3, 1));
}

#[test]
fn json_may_begin_with_a_byte_order_mark() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    let path = dir.path().join("transforms.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, format!("\u{feff}{text}")).unwrap();
    let imported = import(dir.path(), Format::Transforms).unwrap();
    assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
    fs::write(&path, "\u{feff}{\n\"frames\": [],\n\"w\": }").unwrap();
    let error = import(dir.path(), Format::Transforms).unwrap_err();
    assert!(
        error.to_string().contains("transforms.json, line 3: "),
        "{error}"
    );
}

#[test]
fn co3d_in_both_conventions_by_sequence_or_category() {
    for intrinsics in [None, Some("ndc_norm_image_bounds"), Some("ndc_isotropic")] {
        let dir = tempfile::tempdir().unwrap();
        let sequence = fixtures::co3d(dir.path(), intrinsics);
        for folder in [&sequence, &dir.path().join("apple")] {
            let imported = import(folder, Format::Co3d).unwrap();
            assert_sees(&imported.model, &eyes(), EXACT, |_, p| pinhole(p));
            assert!(
                imported
                    .masks
                    .iter()
                    .all(|mask| { mask.as_ref().unwrap().parent().unwrap().ends_with("masks") })
            );
        }
        fs::create_dir(dir.path().join("apple/99_9_9")).unwrap();
        let error = import(&dir.path().join("apple"), Format::Co3d).unwrap_err();
        assert!(error.to_string().contains("2 sequences"), "{error}");
    }
}

#[test]
fn tum_sequences_are_associated_by_time() {
    // Published for freiburg1 at 640x480; the first pixel's centre is at 0 there, at 0.5 here.
    let (focal, centre) = (
        DVec2::new(517.306408, 516.469215),
        DVec2::new(318.643040, 255.313989),
    );
    let lens = [0.262383, -0.953104, -0.005358, 0.002628, 1.163314];
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("rgbd_dataset_freiburg1_desk");
    fixtures::tum(&scene);
    let imported = import(&scene, Format::Tum).unwrap();
    assert_sees(&imported.model, &eyes(), 1e-4, |_, p| {
        (rig::brown(p, lens) * focal + centre + 0.5) * 0.1
    });
    let dropped: Vec<&str> = imported.dropped.iter().map(|d| d.why.as_str()).collect();
    assert_eq!(dropped, ["has no pose near its time", "has no photo"]);
    let third = dir.path().join("fr3_office");
    fixtures::tum(&third);
    let imported = import(&third, Format::Tum).unwrap();
    assert_sees(&imported.model, &eyes(), 1e-4, |_, p| {
        (p * DVec2::new(535.4, 539.2) + DVec2::new(320.6, 248.1)) * 0.1
    });
    let unnamed = dir.path().join("desk");
    fixtures::tum(&unnamed);
    let imported = import(&unnamed, Format::Tum).unwrap();
    assert!(
        imported.notes.iter().any(|n| n.contains("guessed")),
        "{:?}",
        imported.notes
    );
}

#[test]
fn scenes_far_from_the_origin_are_brought_near() {
    let far = DVec3::new(512_345.0, 5_412_345.0, 432.0);
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| {
        for (frame, eye) in file["frames"]
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .zip(eyes())
        {
            let moved = rig::Eye {
                centre: eye.centre + far,
                ..eye
            };
            frame["transform_matrix"] = fixtures::opengl_matrix(&moved);
        }
    });
    let imported = import(dir.path(), Format::Transforms).unwrap();
    let note = imported
        .notes
        .iter()
        .find(|n| n.contains("moved by"))
        .unwrap();
    let offset: Vec<f64> = note[note.find('(').unwrap() + 1..note.find(')').unwrap()]
        .split(", ")
        .map(|v| v.parse().unwrap())
        .collect();
    let offset = DVec3::from_slice(&offset);
    assert!(offset.distance(far) < 5.0);
    for (view, eye) in imported.model.views.iter().zip(eyes()) {
        let centre = view.camera_from_world.centre() + offset;
        assert!(centre.distance(eye.centre + far) < 1e-6);
    }
}

#[test]
fn cameras_that_only_turn_stay_where_they_are() {
    let place = DVec3::new(5.0, 2.0, 1.0);
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| {
        let frames = file["frames"].as_array_mut().unwrap();
        for (frame, eye) in frames.iter_mut().zip(eyes()) {
            let turned = rig::Eye {
                centre: place,
                ..eye
            };
            frame["transform_matrix"] = fixtures::opengl_matrix(&turned);
        }
    });
    let imported = import(dir.path(), Format::Transforms).unwrap();
    assert!(!imported.notes.iter().any(|note| note.contains("moved by")));
    for view in &imported.model.views {
        assert!(view.camera_from_world.centre().distance(place) < 1e-6);
    }
}

#[test]
fn what_is_found_is_said_and_may_be_overruled() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |_| {});
    fixtures::llff(dir.path(), "images");
    let detected = detect(dir.path(), None).unwrap();
    assert_eq!(
        (detected.format, detected.others.as_slice()),
        (Format::Transforms, &[Format::Llff][..])
    );
    assert!(
        detected.sentence().contains("--format llff"),
        "{}",
        detected.sentence()
    );
    let llff = detect(dir.path(), Some(Format::Llff)).unwrap();
    assert_eq!(llff.others, [Format::Transforms]);
    assert_eq!(read(&llff, None).unwrap().format, Format::Llff);
    let none = detect(dir.path(), Some(Format::Tum))
        .unwrap_err()
        .to_string();
    assert!(none.contains("TUM") && none.contains("--format"), "{none}");
    let by_file = detect(&dir.path().join("poses_bounds.npy"), None).unwrap();
    assert_eq!(
        (by_file.format, by_file.root.as_path()),
        (Format::Llff, dir.path())
    );

    let empty = tempfile::tempdir().unwrap();
    let error = detect(empty.path(), None).unwrap_err().to_string();
    assert!(
        error.contains("no photos, and no camera poses") && error.contains("COLMAP"),
        "{error}"
    );
    assert!(detect(&empty.path().join("x"), None).is_err());
    for format in Format::ALL {
        assert_eq!(format.name().parse::<Format>(), Ok(format));
    }
    let said = |word: &str| word.parse::<Format>().unwrap_err();
    assert!(said("kolmap").contains("did you mean colmap?"));
    assert!(said("tmu").contains("did you mean tum?"));
    assert!(!said("x").contains("did you mean"), "{}", said("x"));
}
