//! Finding models and photos in folders, and what is said when they do not fit.

use crate::sample::{small, write_photo, write_scene};
use io_colmap::Scene;
use std::fs;

#[test]
fn the_sub_model_with_the_most_photos_wins_and_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let full = small(&["a.png", "b.png", "c.png"]);
    write_scene(dir.path(), &full);
    fs::rename(dir.path().join("sparse/0"), dir.path().join("sparse/10")).unwrap();
    small(&["a.png"])
        .write_binary(&dir.path().join("sparse/0"))
        .unwrap();
    small(&["a.png", "b.png"])
        .write_text(&dir.path().join("sparse/2"))
        .unwrap();
    let scene = Scene::open(dir.path()).unwrap();
    assert_eq!(scene.model.views.len(), 3);
    let note = &scene.notes[0];
    assert!(
        note.starts_with("there are 3 models; sparse/10 was taken"),
        "{note}"
    );
    assert!(
        note.contains("sparse/0 has 1, sparse/2 has 2, sparse/10 has 3"),
        "{note}"
    );
    assert!(
        scene
            .image_path(&scene.model.views[2])
            .ends_with("images/c.png")
    );
}

#[test]
fn models_and_photos_are_found_in_their_usual_places() {
    for model_at in ["sparse/0", "sparse", ".", "colmap/sparse/0"] {
        for photos_at in ["images", "image", "input", "rgb", "."] {
            let dir = tempfile::tempdir().unwrap();
            small(&["x/a.png"])
                .write_text(&dir.path().join(model_at))
                .unwrap();
            write_photo(&dir.path().join(photos_at).join("x/a.png"), 64, 48);
            let scene = Scene::open(dir.path()).unwrap();
            assert!(scene.image_path(&scene.model.views[0]).is_file());
            let odd_photos = usize::from(photos_at != "images");
            let odd_model = usize::from(!model_at.starts_with("sparse"));
            assert_eq!(
                scene.notes.len(),
                odd_photos + odd_model,
                "{:?}",
                scene.notes
            );
        }
    }
}

#[test]
fn missing_things_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let open = || Scene::open(dir.path()).unwrap_err().to_string();
    assert!(open().contains("no COLMAP model was found in sparse/"));
    small(&[])
        .write_binary(&dir.path().join("sparse/0"))
        .unwrap();
    assert!(open().contains("no registered photos; the reconstruction failed"));
    write_scene(dir.path(), &small(&["a.png", "b.png", "c.png"]));
    fs::remove_file(dir.path().join("images/b.png")).unwrap();
    fs::remove_file(dir.path().join("images/c.png")).unwrap();
    let error = open();
    assert!(
        error.contains("images/b.png: this registered photo is missing"),
        "{error}"
    );
    assert!(
        error.contains("1 more of the model's 3; put the photos into images/"),
        "{error}"
    );
    let (scene, missing) = Scene::open_present(dir.path()).unwrap();
    assert_eq!(missing, ["b.png", "c.png"]);
    assert_eq!(scene.model.views.len(), 1);
    assert_eq!(scene.model.views[0].name, "a.png");
    fs::remove_file(dir.path().join("images/a.png")).unwrap();
    let error = Scene::open_present(dir.path()).unwrap_err().to_string();
    assert!(error.contains("as are all 3 of the model"), "{error}");
    write_photo(&dir.path().join("images/a.png"), 64, 48);
    fs::write(dir.path().join("images/b.png"), b"nonsense").unwrap();
    write_photo(&dir.path().join("images/c.png"), 64, 48);
    let error = open();
    assert!(error.contains("b.png: the photo cannot be read"), "{error}");
    let error = Scene::open(&dir.path().join("nowhere"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("nowhere: there is no such folder"),
        "{error}"
    );
}

#[test]
fn a_photo_of_another_shape_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    write_scene(dir.path(), &small(&["a.png", "b.png"]));
    write_photo(&dir.path().join("images/b.png"), 64, 40);
    let error = Scene::open(dir.path()).unwrap_err().to_string();
    assert!(
        error.contains("b.png: the photo is 64x40 but its camera 1 is 64x48"),
        "{error}"
    );
    assert!(
        error.contains("; use the photos the model was made from"),
        "{error}"
    );
    write_photo(&dir.path().join("images/b.png"), 48, 64);
    assert!(
        Scene::open(dir.path())
            .unwrap_err()
            .to_string()
            .contains("have been turned")
    );
}

#[test]
fn cameras_are_scaled_to_their_photos() {
    let dir = tempfile::tempdir().unwrap();
    write_scene(dir.path(), &small(&["a.png", "b.png", "c.png"]));
    for name in ["a.png", "b.png", "c.png"] {
        write_photo(&dir.path().join("images").join(name), 32, 24);
    }
    let scene = Scene::open(dir.path()).unwrap();
    assert_eq!(scene.model.cameras.len(), 1);
    assert_eq!(scene.model.cameras[&1].params, [30.0, 16.0, 12.0, 0.01]);
    assert!(
        scene.notes[0].contains("64x48 but 3 of its photos are 32x24"),
        "{:?}",
        scene.notes
    );

    // Photos of one camera in three sizes: each view gets a camera of its own size.
    write_photo(&dir.path().join("images/b.png"), 64, 48);
    write_photo(&dir.path().join("images/c.png"), 128, 96);
    let scene = Scene::open(dir.path()).unwrap();
    let widths: Vec<u32> = scene
        .model
        .views
        .iter()
        .map(|v| scene.model.cameras[&v.camera_id].width)
        .collect();
    assert_eq!(widths, [32, 64, 128]);
    assert_eq!(
        scene.model.cameras[&1].width, 64,
        "who fits keeps the number"
    );
}

#[test]
fn poses_of_another_model_are_taken_by_name() {
    let dir = tempfile::tempdir().unwrap();
    write_scene(dir.path(), &small(&["a.png", "b.png"]));
    let mut scene = Scene::open(dir.path()).unwrap();
    let given = scene.model.views.clone();
    let moved = dir.path().join("moved");
    assert!(!scene.take_poses(&moved).unwrap());
    let mut other = small(&["b.png", "c.png"]);
    other.views[0].camera_from_world.translation.x += 0.5;
    other.write_binary(&moved).unwrap();
    assert!(scene.take_poses(&moved).unwrap());
    let views = &scene.model.views;
    assert_eq!(views[0], given[0]);
    assert_eq!(views[1].camera_from_world, other.views[0].camera_from_world);
    fs::write(moved.join("images.bin"), b"cut off").unwrap();
    assert!(scene.take_poses(&moved).is_err());
}
