//! Real scenes, read where they lie; skipped where they are not.

use glam::{DMat3, DQuat, DVec3};
use io_colmap::{MaskSet, Model, Scene};
use scene_import::{Format, Imported, MaskOptions, detect, read};
use std::path::{Path, PathBuf};

fn scene(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("SOS_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        PathBuf::from,
    );
    let folder = shared.join("scenes").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!(
        "skipped: {} is not there (set SOS_SHARED)",
        folder.display()
    );
    None
}

fn import(folder: &Path, format: Format) -> Imported {
    let imported = read(&detect(folder, Some(format)).unwrap(), None).unwrap();
    println!("{}: {} views", folder.display(), imported.model.views.len());
    for note in imported.notes.iter().chain(&imported.dropped_sentences()) {
        println!("  {note}");
    }
    imported
}

/// What two models of the same photos differ in, after the best similarity between them.
#[derive(Debug, Default)]
struct Difference {
    /// Radians.
    angle: f64,
    /// Of centres, over their spread.
    centre: f64,
    /// Of points before the cameras.
    pixels: f64,
    scale: f64,
}

/// Compares view by view; `similarity` turns and scales `ours` to `theirs` first.
fn compare(ours: &Model, theirs: &Model, similarity: bool) -> Difference {
    assert_eq!(ours.views.len(), theirs.views.len());
    let centres = |model: &Model| -> Vec<DVec3> {
        model
            .views
            .iter()
            .map(|v| v.camera_from_world.centre())
            .collect()
    };
    let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len() as f64;
    let spread = |points: &[DVec3]| {
        let middle = mean(points);
        (points
            .iter()
            .map(|p| p.distance_squared(middle))
            .sum::<f64>()
            / points.len() as f64)
            .sqrt()
    };
    let (a, b) = (centres(ours), centres(theirs));
    let (turn, scale, from, to) = if similarity {
        // All views agree on the turn between the worlds; here, the first says it.
        let turn = theirs.views[0].camera_from_world.rotation.conjugate()
            * ours.views[0].camera_from_world.rotation;
        (turn, spread(&b) / spread(&a), mean(&a), mean(&b))
    } else {
        (DQuat::IDENTITY, 1.0, DVec3::ZERO, DVec3::ZERO)
    };
    let mut worst = Difference {
        scale,
        ..Difference::default()
    };
    let size = spread(&b);
    for (i, (our, their)) in ours.views.iter().zip(&theirs.views).enumerate() {
        assert_eq!(our.name, their.name);
        let turned = our.camera_from_world.rotation * turn.conjugate();
        worst.angle = worst
            .angle
            .max(turned.angle_between(their.camera_from_world.rotation));
        let moved = turn * (a[i] - from) * scale + to;
        worst.centre = worst.centre.max(moved.distance(b[i]) / size);
        let (camera, reference) = (
            &ours.cameras[&our.camera_id],
            &theirs.cameras[&their.camera_id],
        );
        assert_eq!(
            (camera.width, camera.height),
            (reference.width, reference.height)
        );
        for x in 0..4 {
            for y in 0..4 {
                // A point in their world, seen at a grid of pixels at two depths.
                let pixel =
                    glam::DVec2::new(f64::from(reference.width), f64::from(reference.height))
                        * glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
                        / 4.0;
                let depth = size * if (x + y) % 2 == 0 { 1.0 } else { 2.5 };
                let ray = reference.unproject(pixel).unwrap() * depth;
                let world = their.camera_from_world.inverse().transform_point(ray);
                let back = turn.conjugate() * (world - to) / scale + from;
                let seen = camera
                    .project(our.camera_from_world.transform_point(back))
                    .unwrap();
                worst.pixels = worst.pixels.max(seen.distance(pixel));
            }
        }
    }
    worst
}

#[test]
fn transforms_of_a_rendered_scene_are_its_colmap_model() {
    let Some(folder) = scene("toy_plane_orbit") else {
        return;
    };
    let imported = import(&folder, Format::Transforms);
    let reference = Scene::open(&folder).unwrap();
    let difference = compare(&imported.model, &reference.model, false);
    println!("{difference:?}");
    // The text model has twelve decimals, transforms.json has sixteen.
    assert!(
        difference.angle < 1e-6 && difference.centre < 1e-6,
        "{difference:?}"
    );
    assert!(difference.pixels < 1e-3, "{difference:?}");
    for point in &reference.model.points {
        for view in &imported.model.views {
            let p = view.camera_from_world.transform_point(point.position);
            let reference = reference
                .model
                .views
                .iter()
                .find(|v| v.name == view.name)
                .unwrap();
            assert!(p.distance(reference.camera_from_world.transform_point(point.position)) < 1e-6);
        }
    }
}

#[test]
fn neus_matrices_of_a_real_scene_are_its_colmap_model() {
    let Some(folder) = scene("dtu_scan65") else {
        return;
    };
    let imported = import(&folder, Format::Neus);
    assert_eq!(imported.model.views.len(), 49);
    let reference = Scene::open(&folder).unwrap();
    let difference = compare(&imported.model, &reference.model, true);
    println!("{difference:?}");
    // The matrices are in single precision.
    assert!(
        difference.angle < 1e-4 && difference.centre < 1e-4,
        "{difference:?}"
    );
    assert!(difference.pixels < 0.05, "{difference:?}");
    // The model is in the frame of the unit sphere, the matrices in millimetres.
    assert!(
        (1.0 / difference.scale - 164.604).abs() < 0.1,
        "{difference:?}"
    );
}

/// The point nearest to the rays through the middles of the masks, as most of them agree, and the
/// share of masks that have it inside.
///
/// Masks of less than half the usual area are left out: these show something else, or a piece.
fn object(imported: &Imported, masks: &str) -> (DVec3, f64) {
    let out = tempfile::tempdir().unwrap();
    let dir = out.path().join("scene");
    imported.write(&dir, &MaskOptions::default()).unwrap();
    let scene = Scene::open(&dir).unwrap();
    let set = MaskSet::find(&imported.root.join(masks), &scene, None).unwrap();
    let area = |mask: &image::GrayImage| mask.iter().filter(|v| **v >= 128).count();
    let mut areas = Vec::new();
    for (i, view) in scene.model.views.iter().enumerate() {
        let camera = &scene.model.cameras[&view.camera_id];
        if let Some(mask) = set.load(i, camera.width, camera.height).unwrap() {
            areas.push(area(&mask));
        }
    }
    areas.sort_unstable();
    let usual = areas[areas.len() / 2];
    let mut rays = Vec::new();
    let mut pictures = Vec::new();
    for (i, view) in scene.model.views.iter().enumerate() {
        let camera = &scene.model.cameras[&view.camera_id];
        let Some(mask) = set.load(i, camera.width, camera.height).unwrap() else {
            continue;
        };
        if 2 * area(&mask) < usual {
            continue;
        }
        let (mut n, mut sum) = (0.0, glam::DVec2::ZERO);
        for (x, y, _) in mask.enumerate_pixels().filter(|(_, _, p)| p.0[0] >= 128) {
            n += 1.0;
            sum += glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        }
        let world = view.camera_from_world.inverse();
        let direction = world
            .transform_vector(camera.unproject(sum / n).unwrap())
            .normalize();
        rays.push((world.translation, direction));
        pictures.push((view, camera, mask));
    }
    let (mut weights, mut point) = (vec![1.0; rays.len()], DVec3::ZERO);
    for _ in 0..30 {
        let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
        for ((o, d), w) in rays.iter().zip(&weights) {
            let across = DMat3::IDENTITY - DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
            a += across * *w;
            b += across * *o * *w;
        }
        point = a.inverse() * b;
        for ((o, d), w) in rays.iter().zip(&mut weights) {
            let to = point - *o;
            *w = 1.0 / ((to - to.dot(*d) * *d).length() / to.length()).max(0.01);
        }
    }
    let hits = pictures
        .iter()
        .filter(|(view, camera, mask)| {
            camera
                .project(view.camera_from_world.transform_point(point))
                .is_some_and(|p| {
                    p.min_element() >= 0.0
                        && p.x < f64::from(mask.width())
                        && p.y < f64::from(mask.height())
                        && mask.get_pixel(p.x as u32, p.y as u32).0[0] >= 128
                })
        })
        .count();
    (point, hits as f64 / pictures.len() as f64)
}

#[test]
fn a_phone_capture_with_missing_photos_and_a_distorted_lens() {
    let Some(folder) = scene("fox") else { return };
    let imported = import(&folder, Format::Transforms);
    assert_eq!(
        (imported.model.views.len(), imported.dropped.len()),
        (50, 17)
    );
    let camera = &imported.model.cameras[&1];
    assert_eq!(
        (camera.model.name(), camera.width, camera.height),
        ("OPENCV", 540, 960)
    );
    assert_eq!(
        camera.params[4..],
        [0.0578421, -0.0805099, -0.000980296, 0.00015575]
    );
    // One place in space is inside nearly all masks: only right poses, axes and lens do that.
    let (point, share) = object(&imported, "coarse_masks");
    println!("the object is about {point}, inside {share:.2} of the masks");
    assert!(share > 0.9, "{share}");
}

#[test]
fn a_forward_facing_capture_stated_for_larger_photos() {
    let Some(folder) = scene("llff_flower") else {
        return;
    };
    let imported = import(&folder, Format::Llff);
    assert_eq!(
        (imported.model.views.len(), imported.dropped.len()),
        (34, 0)
    );
    let camera = &imported.model.cameras[&1];
    assert_eq!((camera.width, camera.height), (1008, 756));
    assert_eq!(camera.params[2..], [504.0, 378.0]);
    assert!(
        (camera.params[0] - 3575.058 / 4.0).abs() < 1e-3,
        "{:?}",
        camera.params
    );
    let (point, share) = object(&imported, "coarse_masks");
    println!("the object is about {point}, inside {share:.2} of the masks");
    assert!(share > 0.9, "{share}");
    // The stated depths bracket it.
    let depth = imported.model.views[0]
        .camera_from_world
        .transform_point(point)
        .z;
    assert!((22.0..158.0).contains(&depth), "{depth}");
}
