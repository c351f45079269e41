//! Cameras that are for photos of another size.

use crate::fixtures::{self, import};
use crate::rig::{CENTRE, FOCAL, HEIGHT, WIDTH, assert_sees, eyes, pinhole, write_photo};
use scene_import::Format;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Photos of half the size, and of twice.
fn resize(folder: &Path, larger: bool) {
    for entry in fs::read_dir(folder).unwrap() {
        let (width, height) = match larger {
            true => (2 * WIDTH, 2 * HEIGHT),
            false => (WIDTH / 2, HEIGHT / 2),
        };
        write_photo(&entry.unwrap().path(), width, height);
    }
}

#[test]
fn cameras_without_a_size_are_refused_where_they_are_for_another() {
    for larger in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let made = |name: &str, photos: &str, write: &dyn Fn(&Path)| {
            let scene = dir.path().join(name);
            write(&scene);
            resize(&scene.join(photos), larger);
            scene
        };
        let unsized_lens = |file: &mut Value| {
            file["w"] = Value::Null;
            file["h"] = Value::Null;
        };
        for (scene, format, remedy) in [
            (
                made("neus", "image", &fixtures::neus),
                Format::Neus,
                "use the photos",
            ),
            (
                made("mvs", "blended_images", &fixtures::blended_mvs),
                Format::BlendedMvs,
                "use the photos",
            ),
            (
                made("nerf", "images", &|scene| {
                    fixtures::transforms(scene, unsized_lens);
                }),
                Format::Transforms,
                "state w and h",
            ),
        ] {
            let error = import(&scene, format).unwrap_err().to_string();
            assert!(
                error.contains("so it is for pictures of another size") && error.contains(remedy),
                "{error}"
            );
        }
    }
}

#[test]
fn axes_may_lie_outside_a_picture_whose_size_is_stated() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| file["cx"] = json!(WIDTH + 1));
    let imported = import(dir.path(), Format::Transforms).unwrap();
    let cameras = imported.model.cameras.values();
    let axes = cameras.map(|camera| camera.principal_point().0);
    assert!(axes.into_iter().any(|x| x == f64::from(WIDTH + 1)));
    // Unless that is the photo's, which the camera may not be for.
    fixtures::transforms(dir.path(), |file| {
        file["cx"] = json!(WIDTH + 1);
        let lens = file.as_object_mut().unwrap();
        lens.remove("w");
        lens.remove("h");
    });
    let error = import(dir.path(), Format::Transforms).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("frame 1 (images/0001.png): its optical axis meets the picture at (97, ")
            && error.contains("outside the picture's 96x64 pixels"),
        "{error}"
    );
}

#[test]
fn of_one_stated_side_the_photos_shape_tells_the_other() {
    for (side, pixels) in [("w", 2 * WIDTH), ("h", 2 * HEIGHT)] {
        let dir = tempfile::tempdir().unwrap();
        fixtures::transforms(dir.path(), |file| {
            let lens = json!({
                "fl_x": 2.0 * FOCAL.x, "fl_y": 2.0 * FOCAL.y, "cx": 2.0 * CENTRE.x, "cy": 2.0 * CENTRE.y,
                "frames": file["frames"], side: pixels,
            });
            *file = lens;
        });
        let imported = import(dir.path(), Format::Transforms).unwrap();
        assert_sees(&imported.model, &eyes(), 1e-6, |_, p| pinhole(p));
    }
}
