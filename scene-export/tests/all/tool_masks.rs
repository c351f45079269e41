//! Each tool's masks: where they lie, what their values mean, and what lies beside them.

use crate::rig::{HEIGHT, PHOTOS, Rig, WIDTH, alpha, axes, key, listing, model};
use glam::{DVec2, DVec3};
use io_colmap::{CameraModel, MaskSet, Polarity, Scene};
use scene_export::MaskTool;
use scene_import::{Format, MaskOptions, detect, read};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Asserts that a mask is 8-bit grey, with these values on the object and off it.
pub(crate) fn assert_mask(path: &Path, photo: usize, object: u8, rest: u8) {
    let picture = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let grey = picture.as_luma8().expect("8-bit grey");
    assert_eq!(grey.dimensions(), (WIDTH, HEIGHT));
    for (x, y, pixel) in grey.enumerate_pixels() {
        let wanted = if alpha(photo, x, y) >= 32768 {
            object
        } else {
            rest
        };
        assert_eq!(pixel[0], wanted, "{} {x} {y}", path.display());
    }
}

#[test]
fn colmap_ignores_black_and_adds_an_ending() {
    let (out, _) = {
        let rig = Rig::new();
        let (out, written) = rig.masks(MaskTool::Colmap);
        assert_eq!(
            listing(&out),
            [
                "export.txt",
                "masks/000.png.png",
                "masks/001.JPG.png",
                "masks/002.png.png",
                "masks/cam2/b.c.png.png"
            ]
        );
        for (photo, name) in PHOTOS.iter().enumerate() {
            assert_mask(&out.join(format!("masks/{name}.png")), photo, 255, 0);
        }
        // io-colmap finds them all, and the right way round.
        let scene = Scene::open(&rig.run().join("scene")).unwrap();
        let set = MaskSet::find(&out.join("masks"), &scene, None).unwrap();
        assert_eq!(set.paths.iter().flatten().count(), 4);
        assert_eq!(set.polarity, Polarity::WhiteIsObject);
        (out, written)
    };
    drop(out);
}

#[test]
fn nerfstudio_names_masks_in_transforms() {
    let rig = Rig::new();
    let (out, _) = rig.masks(MaskTool::Nerfstudio);
    for (photo, name) in PHOTOS.iter().enumerate() {
        assert_mask(&out.join(format!("masks/{}.png", key(name))), photo, 255, 0);
        let copied = fs::read(out.join("images").join(name)).unwrap();
        assert_eq!(
            copied,
            fs::read(rig.run().join("scene/images").join(name)).unwrap()
        );
    }
    let text = fs::read(out.join("transforms.json")).unwrap();
    let file: Value = serde_json::from_slice(&text).unwrap();
    assert_eq!(
        (&file["camera_model"], &file["fl_y"]),
        (&"OPENCV".into(), &51.0.into())
    );
    assert_eq!(file["frames"][3]["mask_path"], "masks/cam2/b.c.png");
    assert_same_scene(&out, Format::Transforms, 4);
}

/// What was written imports as the scene it came from: poses, pixels, photos, masks.
fn assert_same_scene(out: &Path, format: Format, masks: usize) {
    let detected = detect(out, None).unwrap();
    assert_eq!(detected.format, format);
    let imported = read(&detected, None).unwrap();
    assert_eq!(imported.model.views.len(), PHOTOS.len());
    let original = model();
    for (found, wanted) in imported.model.views.iter().zip(&original.views) {
        let (a, b) = (&found.camera_from_world, &wanted.camera_from_world);
        assert!((a.centre() - b.centre()).length() < 1e-9);
        for point in [DVec3::ZERO, DVec3::new(0.3, -0.2, 0.5)] {
            let found = imported.model.cameras[&found.camera_id].project(a.transform_point(point));
            let wanted = original.cameras[&1].project(b.transform_point(point));
            match (found, wanted) {
                (Some(found), Some(wanted)) => assert!((found - wanted).length() < 1e-6),
                (found, wanted) => assert_eq!(found, wanted),
            }
        }
    }
    let again = tempfile::tempdir().unwrap();
    let scene = again.path().join("scene");
    let written = imported.write(&scene, &MaskOptions::default()).unwrap();
    assert_eq!(written.masks, masks);
}

#[test]
fn brush_gets_photos_model_and_masks() {
    let rig = Rig::new();
    let (out, _) = rig.masks(MaskTool::Brush);
    for (photo, name) in PHOTOS.iter().enumerate() {
        assert_mask(&out.join(format!("masks/{}.png", key(name))), photo, 255, 0);
    }
    let scene = Scene::open(&out).unwrap();
    assert_eq!(
        scene.model,
        Scene::open(&rig.run().join("scene")).unwrap().model
    );
    let set = MaskSet::find(&out.join("masks"), &scene, None).unwrap();
    assert_eq!(set.paths.iter().flatten().count(), 4);
}

#[test]
fn instant_ngp_ignores_white_beside_the_photo() {
    let rig = Rig::new();
    let (out, _) = rig.masks(MaskTool::InstantNgp);
    for (photo, name) in ["000", "001", "002", "cam2/b.c"].iter().enumerate() {
        let path = match name.rsplit_once('/') {
            Some((folder, stem)) => format!("images/{folder}/dynamic_mask_{stem}.png"),
            None => format!("images/dynamic_mask_{name}.png"),
        };
        assert_mask(&out.join(path), photo, 0, 255);
    }
    let text = fs::read(out.join("transforms.json")).unwrap();
    let file: Value = serde_json::from_slice(&text).unwrap();
    assert!(file["frames"][0].get("mask_path").is_none());
    // The octahedron's box of side 1, with a margin, is the unit cube.
    let scale = file["scale"].as_f64().unwrap();
    assert!((scale - 1.0 / 1.1).abs() < 1e-12);
    assert_eq!(file["offset"], serde_json::json!([0.5, 0.5, 0.5]));
    assert_same_scene(&out, Format::Transforms, 0);
}

#[test]
fn every_lens_that_transforms_can_say_is_said() {
    for (kind, extra, names) in [
        (
            CameraModel::SimpleRadial,
            vec![0.1],
            vec![("k1", 0.1), ("p1", 0.0)],
        ),
        (
            CameraModel::OpenCv,
            vec![0.1, 0.2, 0.3, 0.4],
            vec![("k2", 0.2), ("p2", 0.4)],
        ),
        (
            CameraModel::OpenCvFisheye,
            vec![0.1, 0.2, 0.3, 0.4],
            vec![("k1", 0.1), ("k4", 0.4)],
        ),
        (
            CameraModel::RadialFisheye,
            vec![0.1, 0.2],
            vec![("k2", 0.2), ("k3", 0.0)],
        ),
    ] {
        let rig = Rig::new();
        rig.remodel(|model| {
            let camera = model.cameras.get_mut(&1).unwrap();
            camera.model = kind;
            let shared = camera.model.param_count() == 3 + extra.len();
            camera.params = if shared {
                vec![50.0, 20.0, 15.0]
            } else {
                vec![50.0, 51.0, 20.0, 15.0]
            };
            camera.params.extend(&extra);
        });
        let (out, _) = rig.masks(MaskTool::Nerfstudio);
        let text = fs::read(out.join("transforms.json")).unwrap();
        let file: Value = serde_json::from_slice(&text).unwrap();
        for (name, value) in names {
            assert_eq!(file[name], value, "{kind} {name}");
        }
        let fisheye = file["camera_model"] == "OPENCV_FISHEYE";
        assert_eq!(fisheye, file.get("is_fisheye").is_some());
        assert_eq!(fisheye, file.get("p1").is_none());
    }
}

#[test]
fn neus_gets_numbered_files_and_projections() {
    let rig = Rig::new();
    let (out, written) = rig.masks(MaskTool::Neus);
    assert!(
        written.notes[0].contains("\"000.png\""),
        "{:?}",
        written.notes
    );
    for photo in 0..PHOTOS.len() {
        assert_mask(&out.join(format!("mask/{photo:03}.png")), photo, 255, 0);
        image::open(out.join(format!("image/{photo:03}.png"))).unwrap();
    }
    let detected = detect(&out, None).unwrap();
    assert_eq!(detected.format, Format::Neus);
    let imported = read(&detected, None).unwrap();
    let original = model();
    for (found, wanted) in imported.model.views.iter().zip(&original.views) {
        let (a, b) = (&found.camera_from_world, &wanted.camera_from_world);
        assert!((a.centre() - b.centre()).length() < 1e-9);
        assert!((axes(a).z_axis - axes(b).z_axis).length() < 1e-9);
        let camera = &imported.model.cameras[&found.camera_id];
        assert!((DVec2::from(camera.focal()) - DVec2::new(50.0, 51.0)).length() < 1e-9);
        // NeuS's first pixel is at 0.
        assert!((DVec2::from(camera.principal_point()) - DVec2::new(20.0, 15.0)).length() < 1e-9);
    }
    // Half the octahedron's diagonal with a margin is the sphere's radius.
    let says = imported
        .notes
        .iter()
        .any(|note| note.contains("within 0.55"));
    assert!(says, "{:?}", imported.notes);
}
