//! What SPIn-NeRF is given, as its loaders read it.

use crate::photos::halves;
use crate::rig::{HEIGHT, Rig, WIDTH, listing};
use crate::tool_masks::assert_mask;
use glam::DVec3;
use image::{DynamicImage, ImageFormat};
use io_colmap::{Model, Scene};
use scene_export::{MaskTool, Product};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;

const SPIN_NERF: Product = Product::Masks(MaskTool::SpinNerf);

/// What is wrong with a model.
type Change = fn(&mut Model);

/// The rig without sub-folders, with points in all views.
pub(crate) fn flat_rig() -> Rig {
    let rig = Rig::new();
    rig.rename("cam2/b.c.png", "004.x.png");
    rig.remodel(|model| {
        // The third camera looks away from the others' points.
        let mut point = model.points[0].clone();
        point.id = 7;
        point.position = ahead(model, 2);
        point.views = vec![3];
        model.points.push(point);
    });
    rig
}

/// A point in front of a camera.
fn ahead(model: &Model, view: usize) -> DVec3 {
    let camera = model.views[view].camera_from_world.inverse();
    camera.transform_point(DVec3::new(0.0, 0.0, 2.0))
}

#[test]
fn what_is_1_is_taken_out_and_views_without_the_object_have_no_label() {
    let rig = flat_rig();
    let (out, written) = rig.masks(MaskTool::SpinNerf);
    assert_eq!(written.count, 3);
    let says = |text: &str| written.notes.iter().any(|note| note.contains(text));
    assert!(says("--factor 1"), "{:?}", written.notes);
    assert!(says("the object is in 3 of 4 views"), "{:?}", written.notes);
    for (photo, label) in [(0, "000"), (1, "001"), (3, "004")] {
        let path = out.join(format!("images_1/label/{label}.png"));
        assert_mask(&path, photo, 1, 0);
    }
    let files = listing(&out);
    let below = |folder: &str| -> Vec<&str> {
        files
            .iter()
            .filter_map(|file| file.strip_prefix(folder))
            .collect()
    };
    assert_eq!(
        below("images/"),
        ["000.png", "001.jpg", "002.png", "004.x.png"]
    );
    let pngs = ["000.png", "001.png", "002.png", "004.x.png"];
    let labels = ["label/000.png", "label/001.png", "label/004.png"];
    assert_eq!(below("images_1/"), [&pngs[..], &labels].concat());
}

#[test]
fn without_the_object_in_any_view_there_is_nothing_to_take_out() {
    let rig = flat_rig();
    for name in ["000", "001", "004.x"] {
        let alpha = rig.run().join("alpha");
        fs::copy(alpha.join("002.png"), alpha.join(format!("{name}.png"))).unwrap();
    }
    let text = rig.complaint(SPIN_NERF);
    assert!(
        text.contains("the object is in none of the views"),
        "{text}"
    );
}

/// For every point the names of the photos that saw it.
fn seen(model: &Model) -> BTreeMap<u64, BTreeSet<&str>> {
    let name = |id: &u32| {
        let view = model.views.iter().find(|view| view.id == *id).unwrap();
        // Without endings, which change.
        view.name.split('.').next().unwrap()
    };
    let tracks = model
        .points
        .iter()
        .map(|p| (p.id, p.views.iter().map(name).collect()));
    tracks.collect()
}

#[test]
fn views_are_numbered_in_the_order_of_their_names() {
    let rig = flat_rig();
    rig.remodel(|model| {
        let ids = [40, 7, 12, 3];
        for view in &mut model.views {
            view.id = ids[view.id as usize - 1];
        }
        for point in &mut model.points {
            point.views = point.views.iter().map(|id| ids[*id as usize - 1]).collect();
            point.views.sort_unstable();
        }
        // The first camera's focal length is taken, whoever's it is.
        let mut unused = model.cameras[&1].clone();
        unused.params[0] *= 2.0;
        let mut used = model.cameras[&1].clone();
        used.id = 2;
        model.cameras = [(1, unused), (2, used)].into();
        model.views.iter_mut().for_each(|view| view.camera_id = 2);
    });
    let (out, _) = rig.masks(MaskTool::SpinNerf);
    let model = Scene::open(&out).unwrap().model;
    let ids: Vec<(u32, &str)> = model
        .views
        .iter()
        .map(|view| (view.id, &*view.name))
        .collect();
    assert_eq!(
        ids,
        [
            (1, "000.png"),
            (2, "001.jpg"),
            (3, "002.png"),
            (4, "004.x.png")
        ]
    );
    let before = Scene::open(&rig.run().join("scene")).unwrap().model;
    assert_eq!(seen(&model), seen(&before));
    assert_eq!(model.cameras.keys().copied().collect::<Vec<_>>(), [2]);
    for (view, original) in model.views.iter().zip(&before.views) {
        assert_eq!(view.camera_from_world, original.camera_from_world);
    }
}

#[test]
fn photos_have_the_endings_that_are_listed() {
    let rig = flat_rig();
    for (old, new, format) in [
        ("000.png", "000.PNG", ImageFormat::Png),
        ("001.JPG", "001.JPEG", ImageFormat::Jpeg),
        ("002.png", "002.webp", ImageFormat::WebP),
        ("004.x.png", "004.x.tif", ImageFormat::Tiff),
    ] {
        rig.rename(old, new);
        let path = rig.run().join("scene/images").join(new);
        let picture = DynamicImage::from(halves(WIDTH, HEIGHT));
        picture.save_with_format(path, format).unwrap();
    }
    let (out, written) = rig.masks(MaskTool::SpinNerf);
    let files = listing(&out);
    for name in ["000.png", "001.jpg", "002.png", "004.x.png"] {
        let file = format!("images/{name}");
        assert!(files.contains(&file), "{files:?}");
        image::open(out.join(file)).unwrap();
    }
    let says = |text: &str| written.notes.iter().any(|note| note.contains(text));
    assert!(says("2 photos are written anew"), "{:?}", written.notes);
    assert!(says("2 photos have another ending"), "{:?}", written.notes);
    Scene::open(&out).unwrap();
}

#[test]
fn names_that_would_be_mixed_up_are_refused() {
    let text = Rig::new().complaint(SPIN_NERF);
    assert!(text.contains("sub-folder"), "{text}");
    for (name, says) in [
        ("000.x.png", "the same for \"000.png\""),
        ("my_cutout.png", "no label of photos with \"cutout\""),
        ("pseudo1.png", "no label of photos with \"pseudo\""),
    ] {
        let rig = flat_rig();
        rig.rename("004.x.png", name);
        let text = rig.complaint(SPIN_NERF);
        assert!(
            text.contains(says) && text.contains("; rename it"),
            "{text}"
        );
    }
}

#[test]
fn cameras_that_it_does_not_have_are_refused() {
    let cases: [(Change, &str); 4] = [
        (
            |model| {
                let camera = model.cameras.get_mut(&1).unwrap();
                camera.model = io_colmap::CameraModel::SimpleRadial;
                camera.params = vec![50.0, 20.0, 15.0, 0.1];
            },
            "SPIn-NeRF knows pinhole cameras only, and this one is SIMPLE_RADIAL; undistort",
        ),
        (
            |model| model.cameras.get_mut(&1).unwrap().params[2] = 22.0,
            "up to 2.0 pixels off; have COLMAP make the scene with one camera",
        ),
        (
            |model| model.cameras.get_mut(&1).unwrap().params[1] = 60.0,
            "000.png: SPIn-NeRF has one focal length for all photos and the axis in the middle, here 50.0",
        ),
        (
            |model| {
                let mut other = model.cameras[&1].clone();
                other.id = 2;
                other.params[0] = 56.0;
                other.params[1] = 56.0;
                model.cameras.insert(2, other);
                model.views[1].camera_id = 2;
            },
            "001.JPG: SPIn-NeRF has one focal length",
        ),
    ];
    for (change, says) in cases {
        let rig = flat_rig();
        rig.remodel(change);
        let text = rig.complaint(SPIN_NERF);
        assert!(text.contains(says), "{text}");
    }
}

#[test]
fn views_that_saw_no_point_are_refused() {
    let cases: [(Change, &str); 3] = [
        (
            |model| model.points.clear(),
            "does not say which photos see its 0 sparse points",
        ),
        (
            |model| {
                model
                    .points
                    .iter_mut()
                    .for_each(|point| point.views.clear())
            },
            "does not say which photos see its 4 sparse points",
        ),
        (
            |model| model.points.retain(|point| point.id != 7),
            "002.png: no sparse point of the model is seen in 1 of 4 photos",
        ),
    ];
    for (change, says) in cases {
        let rig = flat_rig();
        rig.remodel(change);
        let text = rig.complaint(SPIN_NERF);
        assert!(
            text.contains(says) && text.contains("point_triangulator"),
            "{text}"
        );
    }
}
