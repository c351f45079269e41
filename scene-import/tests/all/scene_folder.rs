//! The scene that is written: complete or not there, and read back as it was.

use crate::fixtures::{self, import};
use crate::rig::{HEIGHT, WIDTH, assert_sees, eyes, pinhole};
use io_colmap::Scene;
use scene_import::{Format, Imported, MaskOptions, detect, read};
use serde_json::json;
use std::fs;
use std::path::Path;

#[test]
fn a_written_scene_opens_as_colmaps() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    fixtures::transforms(&scene, |file| {
        let gone = json!({"file_path": "images/x", "transform_matrix": [[0, 0, 0, 0]]});
        file["frames"]
            .as_array_mut()
            .unwrap()
            .extend([gone.clone(), gone]);
    });
    let imported = import(&scene, Format::Transforms).unwrap();
    assert_eq!(
        imported.dropped_sentences(),
        ["2 views are left out: images/x, for one, has no photo"]
    );
    let out = dir.path().join("new/out");
    let written = imported.write(&out, &MaskOptions::default()).unwrap();
    assert_eq!((written.photos, written.masks), (4, 0));
    let opened = Scene::open(&out).unwrap();
    assert_eq!(opened.model, imported.model);
    assert!(opened.notes.is_empty(), "{:?}", opened.notes);
    assert_sees(&opened.model, &eyes(), 1e-6, |_, p| pinhole(p));
    for view in &opened.model.views {
        let (a, b) = (
            opened.image_path(view),
            scene.join("images").join(&view.name),
        );
        assert_eq!(
            fs::read(a).unwrap(),
            fs::read(b).unwrap(),
            "photos are copied as they are"
        );
    }
    let record = fs::read_to_string(out.join("import.txt")).unwrap();
    assert!(
        record.contains("transforms.json") && record.contains("images/x has no photo"),
        "{record}"
    );
    // What was written is a COLMAP scene, which may be imported again.
    assert_eq!(detect(&out, None).unwrap().format, Format::Colmap);
    let again = import(&out, Format::Colmap).unwrap();
    assert_eq!(again.model, imported.model);
    let error = again
        .write(&out, &MaskOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("something in it already, such as images;"),
        "{error}"
    );
    let entries: Vec<_> = fs::read_dir(dir.path().join("new")).unwrap().collect();
    assert_eq!(entries.len(), 1, "nothing else is left");
}

#[test]
fn photos_in_several_folders_keep_them() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    fixtures::transforms(&scene, |file| {
        file["frames"][0]["file_path"] = "images/left/a.png".into();
        file["frames"][1]["file_path"] = "images/right/a.png".into();
    });
    for side in ["left", "right"] {
        crate::rig::write_photo(&scene.join(format!("images/{side}/a.png")), WIDTH, HEIGHT);
    }
    let imported = import(&scene, Format::Transforms).unwrap();
    assert_eq!(
        names(&imported),
        ["0003.png", "0004.png", "left/a.png", "right/a.png"]
    );
    let out = dir.path().join("out");
    imported.write(&out, &MaskOptions::default()).unwrap();
    assert!(out.join("images/right/a.png").is_file());
}

#[test]
fn photos_that_cannot_be_written_are_named_as_they_were() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |name: &str, second: &str| {
        let scene = dir.path().join(name);
        fixtures::transforms(&scene, |file| {
            file["frames"][0]["file_path"] = second.into();
        });
        let path = scene.join(second);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        for path in [path, scene.join("images/0002.png")] {
            let photo = image::RgbaImage::from_pixel(WIDTH, HEIGHT, image::Rgba([9, 9, 9, 255]));
            photo.save(path).unwrap();
        }
        let imported = import(&scene, Format::Transforms).unwrap();
        let out = dir.path().join("out");
        let error = imported.write(&out, &MaskOptions::default()).unwrap_err();
        assert!(!out.exists());
        error.to_string()
    };
    // Both become a PNG without alpha.
    let error = refused("alike", "images/0002.webp");
    assert!(
        error.contains("images/0002.webp: this photo and ")
            && error.contains("images/0002.png would both be written as images/0002.png; rename"),
        "{error}"
    );
    let error = refused("blank", "images/ left/a.png");
    assert!(
        error.contains("out/sparse/0/images: the photo name \" left/a.png\"")
            && !error.contains(".sos-partial-"),
        "{error}"
    );
}

fn names(imported: &Imported) -> Vec<&str> {
    let views = imported.model.views.iter();
    views.map(|view| view.name.as_str()).collect()
}

#[test]
fn stated_folders_decide_between_photos_of_one_name() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, photos) = (dir.path().join("scene"), dir.path().join("photos"));
    fixtures::transforms(&scene, |file| {
        let stated = [
            "C:\\photos\\rig\\left\\a.png",
            "/home/x/rig/Right/a",
            "a.png",
            "gone/b.png",
        ];
        for (i, path) in stated.into_iter().enumerate() {
            file["frames"][i]["file_path"] = path.into();
        }
    });
    for name in ["rig/left/a.png", "rig/right/a.png", "rig/b.png"] {
        crate::rig::write_photo(&photos.join(name), WIDTH, HEIGHT);
    }
    let imported = read(&detect(&scene, None).unwrap(), Some(&photos)).unwrap();
    assert_eq!(names(&imported), ["b.png", "left/a.png", "right/a.png"]);
    assert_eq!(
        imported.dropped_sentences(),
        ["left out: a.png has several photos of that name"]
    );
}

#[test]
fn a_photo_goes_to_the_view_that_states_its_path_best() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, photos) = (dir.path().join("scene"), dir.path().join("photos"));
    let import = |stated: [&str; 4], files: &[&str]| {
        fixtures::transforms(&scene, |file| {
            for (i, path) in stated.into_iter().enumerate() {
                file["frames"][i]["file_path"] = path.into();
            }
        });
        let _ = fs::remove_dir_all(&photos);
        for name in files {
            crate::rig::write_photo(&photos.join(name), WIDTH, HEIGHT);
        }
        read(&detect(&scene, None).unwrap(), Some(&photos)).unwrap()
    };
    let eye = |i: usize| eyes()[i].centre;
    let centre = |imported: &Imported| imported.model.views[0].camera_from_world.centre();

    // The second view has its photo, which the first one shares the name with.
    let stated = ["cam2/a.png", "cam1/a.png", "b.png", "b.png"];
    let imported = import(stated, &["cam1/a.png", "b.png"]);
    assert_eq!(names(&imported), ["b.png", "cam1/a.png"]);
    let pose = imported.model.views[1].camera_from_world;
    assert!(pose.centre().distance(eye(1)) < 1e-6, "{pose:?}");
    let b = photos.join("b.png").display().to_string();
    assert_eq!(
        imported.dropped_sentences(),
        [
            "left out: cam2/a.png has no photo but one that another view fits better: cam1/a.png",
            &*format!("left out: {b} is listed twice"),
        ]
    );
    // Where none has it, both may.
    let imported = import(stated, &["a.png", "b.png"]);
    assert_eq!(names(&imported), ["b.png"]);
    assert!(centre(&imported).distance(eye(2)) < 1e-6);
    let said = "2 views are left out: cam2/a.png, for one, has only a photo that another view fits as well: cam1/a.png";
    assert_eq!(imported.dropped_sentences()[0], said);
    // Somebody put it there for the one that states no folder.
    let imported = import(["cam1/a.png", "a.png", "b.png", "c.png"], &["a.png"]);
    assert!(centre(&imported).distance(eye(1)) < 1e-6);
    // Absolute paths of another machine are no different.
    fixtures::transforms(&scene, |file| {
        file["frames"][0]["file_path"] = "/x/cam1/a.png".into();
        file["frames"][1]["file_path"] = "/x/cam2/a.png".into();
    });
    crate::rig::write_photo(&scene.join("a.png"), WIDTH, HEIGHT);
    let imported = read(&detect(&scene, None).unwrap(), None).unwrap();
    assert_eq!(names(&imported), ["0003.png", "0004.png"]);
    let record = imported.dropped[1].reason();
    assert!(record.ends_with("as well: /x/cam1/a.png"), "{record}");
}

#[test]
fn the_name_of_the_named_folder_decides_too() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, left) = (dir.path().join("scene"), dir.path().join("rig/left"));
    let state = |scene: &Path, stated: [&str; 4]| {
        fixtures::transforms(scene, |file| {
            for (i, path) in stated.into_iter().enumerate() {
                file["frames"][i]["file_path"] = path.into();
            }
        });
    };
    for name in ["a.png", "b.png"] {
        crate::rig::write_photo(&left.join(name), WIDTH, HEIGHT);
    }
    let expect_left = |imported: &Imported| {
        assert_eq!(names(imported), ["a.png", "b.png"]);
        for (view, eye) in imported.model.views.iter().zip([1, 3]) {
            let centre = view.camera_from_world.centre();
            assert!(centre.distance(eyes()[eye].centre) < 1e-6, "{}", view.name);
        }
    };
    state(
        &scene,
        ["right/a.png", "left/a.png", "right/b.png", "left/b.png"],
    );
    expect_left(&read(&detect(&scene, None).unwrap(), Some(&left)).unwrap());
    // The same by absolute paths of another machine, beside the photos.
    state(
        &left,
        [
            "/x/right/a.png",
            "/x/left/a.png",
            "/x/right/b.png",
            "/x/left/b.png",
        ],
    );
    expect_left(&read(&detect(&left, None).unwrap(), None).unwrap());
}

#[cfg(unix)]
#[test]
fn a_closed_sub_folder_is_left_out_and_named() {
    use std::os::unix::fs::PermissionsExt as _;
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    fixtures::transforms(&scene, |_| ());
    let photos = dir.path().join("photos");
    let closed = photos.join("lost+found");
    fs::create_dir_all(&closed).unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o000)).unwrap();
    if fs::read_dir(&closed).is_ok() {
        eprintln!("skipped: this user may read every folder");
        return;
    }
    let import = || read(&detect(&scene, None).unwrap(), Some(&photos));
    let error = import().unwrap_err().to_string();
    assert!(error.contains("lost+found cannot be read"), "{error}");
    crate::rig::write_photos(&photos);
    let imported = import().unwrap();
    assert_eq!(imported.model.views.len(), 4);
    assert!(
        imported.notes[0].contains("lost+found cannot be read and is left out"),
        "{:?}",
        imported.notes
    );
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o700)).unwrap();
}

#[test]
fn photos_that_must_be_turned_are() {
    let dir = tempfile::tempdir().unwrap();
    let scene = dir.path().join("scene");
    fixtures::transforms(&scene, |file| {
        for frame in file["frames"].as_array_mut().unwrap() {
            let path = frame["file_path"].as_str().unwrap().replace(".png", ".jpg");
            frame["file_path"] = path.into();
        }
    });
    fs::remove_dir_all(scene.join("images")).unwrap();
    fs::create_dir(scene.join("images")).unwrap();
    // Stored lying on the side: its right third is red, which is the bottom when upright.
    let stored = image::RgbImage::from_fn(HEIGHT, WIDTH, |x, _| {
        image::Rgb(if x > HEIGHT * 2 / 3 {
            [220, 10, 10]
        } else {
            [10, 10, 220]
        })
    });
    for eye in eyes() {
        let mut jpeg = Vec::new();
        stored
            .write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(
                &mut jpeg, 95,
            ))
            .unwrap();
        // "Rotate by 90 degrees clockwise to see it upright": the only entry of an Exif block.
        let exif = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        jpeg.splice(2..2, exif.iter().copied());
        fs::write(scene.join(format!("images/{}.jpg", eye.name)), jpeg).unwrap();
    }
    let imported = import(&scene, Format::Transforms).unwrap();
    assert!(
        imported
            .notes
            .iter()
            .any(|n| n.contains("4 photos are turned upright"))
    );
    assert_sees(&imported.model, &eyes(), 1e-6, |_, p| pinhole(p));
    let out = dir.path().join("out");
    let written = imported.write(&out, &MaskOptions::default()).unwrap();
    assert!(
        written.notes.iter().any(|n| n.contains("written anew")),
        "{:?}",
        written.notes
    );
    let photo = image::open(out.join("images/0001.png"))
        .unwrap()
        .into_rgb8();
    assert_eq!(photo.dimensions(), (WIDTH, HEIGHT));
    assert!(photo.get_pixel(40, 60).0[0] > 150 && photo.get_pixel(40, 5).0[0] < 100);
    // A camera that knows the photo as it is stored gets it so.
    let lying = dir.path().join("lying");
    fixtures::transforms(&lying, |file| {
        file["w"] = HEIGHT.into();
        file["h"] = WIDTH.into();
        file["cx"] = 32.into();
        file["cy"] = 48.into();
        for frame in file["frames"].as_array_mut().unwrap() {
            let path = frame["file_path"].as_str().unwrap().replace(".png", ".jpg");
            frame["file_path"] = path.into();
        }
    });
    fs::remove_dir_all(lying.join("images")).unwrap();
    fs::rename(scene.join("images"), lying.join("images")).unwrap();
    let imported = read(&detect(&lying, None).unwrap(), None).unwrap();
    assert!(
        imported.notes.iter().any(|n| n.contains("used as stored")),
        "{:?}",
        imported.notes
    );
    assert_eq!(imported.model.cameras[&1].width, HEIGHT);
}
