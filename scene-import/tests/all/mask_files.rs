//! Which file is whose mask: of photos without a pose, in sub-folders, and as the poses' own file lists them.

use crate::fixtures::{self, opengl_matrix};
use crate::rig::{HEIGHT, WIDTH, eyes, write_photo};
use image::{GrayImage, Luma};
use scene_import::{MaskOptions, MaskSource, Written, detect, read};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Black with a white square, in which one pixel says whose it is.
fn mask(mark: u32) -> GrayImage {
    GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let inside = (20..70).contains(&x) && (10..50).contains(&y);
        Luma([if inside && (x, y) != (30 + mark, 30) {
            255
        } else {
            0
        }])
    })
}

fn save(mask: &GrayImage, path: &Path) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    mask.save(path).unwrap();
}

/// `transforms.json` with these photos, which are written; the rig's poses are used in turn.
fn scene(dir: &Path, photos: &[&str]) {
    let eyes = eyes();
    fixtures::transforms(dir, |file| {
        let frames = photos.iter().zip(eyes.iter().cycle());
        let frames = frames.map(
            |(photo, eye)| json!({"file_path": photo, "transform_matrix": opengl_matrix(eye)}),
        );
        file["frames"] = Value::Array(frames.collect());
    });
    fs::remove_dir_all(dir.join("images")).unwrap();
    for photo in photos {
        write_photo(&dir.join(photo), WIDTH, HEIGHT);
    }
}

fn import(dir: &Path, options: &MaskOptions) -> (Written, PathBuf) {
    let imported = read(&detect(dir, None).unwrap(), None).unwrap();
    let out = dir.join("out");
    let _ = fs::remove_dir_all(&out);
    let written = imported.write(&out, options).unwrap();
    (written, out)
}

/// The mark in a mask that was written.
fn mark(path: &Path) -> Option<u32> {
    let found = image::open(path).ok()?.into_luma8();
    (0..40).find(|i| found.get_pixel(30 + i, 30).0[0] == 0)
}

fn frame(i: u32) -> String {
    format!("images/frame_{i:03}.png")
}

#[test]
fn masks_of_photos_without_a_pose_do_not_shift_those_of_the_others() {
    let dir = tempfile::tempdir().unwrap();
    let posed: Vec<String> = (0..12).map(frame).collect();
    let posed: Vec<&str> = posed.iter().map(String::as_str).collect();
    // As many masks as posed photos, and one for every photo.
    for masked in [2..14, 0..14] {
        let scene_dir = dir.path().join(format!("{masked:?}"));
        scene(&scene_dir, &posed);
        for i in 12..14 {
            write_photo(&scene_dir.join(frame(i)), WIDTH, HEIGHT);
        }
        for i in masked.clone() {
            save(&mask(i), &scene_dir.join(format!("masks/{i:05}.png")));
        }
        let (written, out) = import(&scene_dir, &MaskOptions::default());
        assert_eq!(written.masks, 12 - masked.start as usize);
        for i in 0..12 {
            let expected = masked.contains(&i).then_some(i);
            let file = out.join(format!("masks/frame_{i:03}.png"));
            assert_eq!(mark(&file), expected, "{i} of {masked:?}");
        }
        // The same of what is ignored, which is told from masks by its folder alone.
        fs::rename(scene_dir.join("masks"), scene_dir.join("ignore")).unwrap();
        let none = MaskOptions {
            source: MaskSource::None,
            ..MaskOptions::default()
        };
        let (written, out) = import(&scene_dir, &none);
        assert_eq!(written.ignored, 12 - masked.start as usize);
        assert_eq!(mark(&out.join("ignore/frame_011.png")), Some(11));
    }
}

#[test]
fn a_mask_of_a_photo_that_is_gone_tells_how_masks_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let posed: Vec<String> = (0..4).map(frame).collect();
    let posed: Vec<&str> = posed.iter().map(String::as_str).collect();
    scene(dir.path(), &posed);
    for i in 0..4 {
        save(&mask(i), &dir.path().join(format!("masks/{i:05}.png")));
    }
    fs::remove_file(dir.path().join(frame(3))).unwrap();
    let (written, out) = import(dir.path(), &MaskOptions::default());
    assert_eq!(written.masks, 3);
    assert_eq!(mark(&out.join("masks/frame_002.png")), Some(2));
    // What lies with the masks is none of the photos, though one of them may be beside it.
    let inside = dir.path().join("images/m");
    fs::rename(dir.path().join("masks"), &inside).unwrap();
    save(&mask(9), &inside.join("00009.png"));
    let named = MaskOptions {
        source: MaskSource::Path(inside),
        ..MaskOptions::default()
    };
    let imported = read(&detect(dir.path(), None).unwrap(), None).unwrap();
    let error = imported
        .write(&dir.path().join("other"), &named)
        .unwrap_err();
    assert!(error.to_string().contains("can be matched"), "{error}");
}

#[test]
fn photos_of_one_folder_find_their_masks_in_one_of_that_name() {
    let dir = tempfile::tempdir().unwrap();
    let photos = ["images/left/a.png", "images/left/b.png"];
    scene(dir.path(), &photos);
    for (i, name) in (1..).zip(["left/a", "left/b"]) {
        save(&mask(i), &dir.path().join(format!("masks/{name}.png")));
    }
    fs::create_dir(dir.path().join("ignore")).unwrap();
    save(&mask(5), &dir.path().join("ignore/left/b.png"));
    let (written, out) = import(dir.path(), &MaskOptions::default());
    assert_eq!((written.masks, written.ignored), (2, 1));
    let marks = ["a", "b"].map(|name| mark(&out.join(format!("masks/{name}.png"))));
    assert_eq!(marks, [Some(1), Some(2)]);
    assert_eq!(mark(&out.join("ignore/b.png")), Some(5));
}

#[test]
fn a_mask_that_several_stated_paths_fit_is_nobodys() {
    let dir = tempfile::tempdir().unwrap();
    let photos = ["images/l/1.png", "images/r/1.png", "images/r/2.png"];
    scene(dir.path(), &photos);
    let path = dir.path().join("transforms.json");
    let mut file: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    // The scene was moved, and of its two folders of masks one is there without its name.
    for (i, mask) in ["/old/l/1.png", "/old/r/1.png", "/old/r/2.png"]
        .into_iter()
        .enumerate()
    {
        file["frames"][i]["mask_path"] = mask.into();
    }
    fs::write(&path, file.to_string()).unwrap();
    save(&mask(1), &dir.path().join("1.png"));
    save(&mask(2), &dir.path().join("2.png"));
    let (written, out) = import(dir.path(), &MaskOptions::default());
    assert_eq!(written.masks, 1);
    assert_eq!(mark(&out.join("masks/r/2.png")), Some(2));
    let said = |text: &str| written.notes.iter().any(|note| note.contains(text));
    assert!(
        said("the mask /old/l/1.png is missing: ") && said("may as well be /old/l/1.png"),
        "{:?}",
        written.notes
    );
    // One that all frames state is everybody's.
    for i in 0..3 {
        file["frames"][i]["mask_path"] = "1.png".into();
    }
    fs::write(&path, file.to_string()).unwrap();
    assert_eq!(import(dir.path(), &MaskOptions::default()).0.masks, 3);
}

#[test]
fn what_is_said_beside_listed_masks_is_heard() {
    let dir = tempfile::tempdir().unwrap();
    let photos = ["images/a.png", "images/b.png"];
    scene(dir.path(), &photos);
    let path = dir.path().join("transforms.json");
    let mut file: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    for (i, name) in ["m/x/a.png", "m/y/b.png"].into_iter().enumerate() {
        file["frames"][i]["mask_path"] = name.into();
        save(&mask(1), &dir.path().join(name));
    }
    fs::write(&path, file.to_string()).unwrap();
    let object = |out: &Path| {
        let found = image::open(out.join("masks/a.png")).unwrap().into_luma8();
        found.get_pixel(50, 20).0[0]
    };
    assert_eq!(object(&import(dir.path(), &MaskOptions::default()).1), 255);
    fs::write(dir.path().join("m/polarity.txt"), "black = object\n").unwrap();
    assert_eq!(object(&import(dir.path(), &MaskOptions::default()).1), 0);
}
