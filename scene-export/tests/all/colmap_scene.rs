//! The object alone, as a scene that opens.

use crate::rig::{HEIGHT, PHOTOS, Rig, WIDTH, alpha, key, listing};
use io_colmap::{MaskSet, Polarity, Scene};
use scene_export::Target;
use std::fs;

#[test]
fn the_scene_holds_cutouts_and_the_objects_points() {
    let rig = Rig::new();
    // Enough that the mesh is not asked.
    rig.remodel(|model| {
        let middle = model.points[0].clone();
        for id in 10..200 {
            let mut point = middle.clone();
            point.id = id;
            model.points.push(point);
        }
    });
    let (out, written) = rig.files(Target::ColmapScene);
    assert_eq!(written.count, PHOTOS.len());
    let scene = Scene::open(&out).unwrap();
    let names: Vec<&str> = scene.model.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["000.png", "001.png", "002.png", "cam2/b.c.png"]);
    let kept: Vec<u64> = scene.model.points.iter().map(|p| p.id).collect();
    assert_eq!(
        &kept[..3],
        [1, 2, 10],
        "the point beside the object is left out"
    );
    assert_eq!(kept.len(), 192);
    for name in PHOTOS {
        let photo = image::open(out.join(format!("images/{}.png", key(name)))).unwrap();
        let run = image::open(rig.run().join(format!("foreground/{}.png", key(name)))).unwrap();
        assert_eq!(
            photo.as_rgba8().expect("RGBA").dimensions(),
            (WIDTH, HEIGHT)
        );
        assert_eq!(photo, run);
    }
    // Poses and cameras are the scene's.
    let original = Scene::open(&rig.run().join("scene")).unwrap();
    assert_eq!(scene.model.cameras, original.model.cameras);
    for (view, original) in scene.model.views.iter().zip(&original.model.views) {
        assert_eq!(view.camera_from_world, original.camera_from_world);
        assert_eq!(view.id, original.id);
    }
    // Alpha is the mask, of the view that does not show the object too. A scene's own photos are none.
    let set = MaskSet::find(&out.join("images"), &original, None).unwrap();
    assert_eq!(set.polarity, Polarity::WhiteIsObject);
    for photo in 0..PHOTOS.len() {
        let mask = set.load(photo, WIDTH, HEIGHT).unwrap().expect("a mask");
        for (x, y, pixel) in mask.enumerate_pixels() {
            let wanted = (f64::from(alpha(photo, x, y)) / 257.0).round();
            assert_eq!(f64::from(pixel[0]), wanted, "{photo} {x} {y}");
        }
    }
}

#[test]
fn with_few_points_the_mesh_gives_them() {
    let rig = Rig::new();
    let (out, written) = rig.files(Target::ColmapScene);
    assert!(
        written.notes[0].starts_with("2 of 3 sparse points"),
        "{:?}",
        written.notes
    );
    assert!(
        written.notes[1].contains("6 points of the mesh"),
        "{:?}",
        written.notes
    );
    let scene = Scene::open(&out).unwrap();
    assert_eq!(scene.model.points.len(), 6);
    assert_eq!(scene.model.points[0].colour, [255, 0, 0]);
    assert_eq!(scene.model.points[0].position, crate::rig::corners()[0]);
    let record = fs::read_to_string(out.join("export.txt")).unwrap();
    assert!(record.contains("points of the mesh"));
    assert!(listing(&out).contains(&"sparse/0/points3D.bin".to_owned()));
}
