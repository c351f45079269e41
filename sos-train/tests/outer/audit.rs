//! The audit of mattes that are the truth, and of one that is not.

use crate::fabricated;
use glam::DVec3;
use io_colmap::{MaskSet, Scene};
use sos_train::audit::{RunAudit, audit};
use sos_train::export::write_view;
use sos_train::run_folder::RunFolder;
use std::path::Path;

/// A run of the truth with depths from the true mesh, view `broken` losing the right half of its
/// matte.
fn audited(dir: &Path, broken: Option<usize>) -> (RunFolder, RunAudit) {
    let (truth, run) = fabricated::run(dir, true);
    let scene = Scene::open(&run.scene_dir()).unwrap();
    for (i, view) in truth.views.iter().enumerate() {
        let mut render = fabricated::render(view);
        let posed = scene
            .model
            .views
            .iter()
            .find(|v| v.name == view.name)
            .unwrap();
        let camera = &scene.model.cameras[&posed.camera_id];
        let (w, h) = (render.width as i32, render.height as i32);
        let mut nearest = vec![f32::INFINITY; render.depth.len()];
        for vertex in &truth.mesh.positions {
            let point = DVec3::from_array(vertex.to_array());
            let seen = posed.camera_from_world.transform_point(point);
            let Some(pixel) = camera.project(seen) else {
                continue;
            };
            let (x, y) = (pixel.x as i32, pixel.y as i32);
            for (x, y) in [(x, y), (x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)] {
                if x >= 0 && y >= 0 && x < w && y < h {
                    let slot = &mut nearest[(y * w + x) as usize];
                    *slot = slot.min(seen.z as f32);
                }
            }
        }
        for (p, near) in nearest.into_iter().enumerate() {
            if Some(i) == broken && p as i32 % w > w / 2 {
                render.alpha[p] = 0.0;
            }
            let shown = near.is_finite() && render.alpha[p] > 0.05;
            render.depth[p] = if shown { near } else { 0.0 };
        }
        write_view(&run, &render).unwrap();
    }
    let masks = MaskSet::find(&run.scene_dir().join("coarse_masks"), &scene, None).unwrap();
    let found = audit(&run, &scene, Some(&masks)).unwrap();
    (run, found)
}

#[test]
fn true_mattes_agree_and_start_masks_do_not() {
    let dir = tempfile::tempdir().unwrap();
    let (run, found) = audited(dir.path(), None);
    let consistency = found.consistency.unwrap();
    let started = found.mask_consistency.unwrap();
    assert!(consistency > 0.98, "{consistency}");
    // The pictures are so small that the tolerance of one cell forgives much.
    assert!(started < consistency - 0.005, "{started} {consistency}");
    let overlap = found.mask_iou.unwrap();
    assert!(overlap < 0.97, "{overlap}");
    assert_eq!(
        found
            .views
            .iter()
            .filter(|view| view.mask_iou.is_none())
            .count(),
        1
    );
    for view in &fabricated::SCENE.views {
        let path = run.uncertainty_dir().join(&view.name).with_extension("png");
        let picture = image::open(&path).unwrap();
        assert_eq!(picture.color(), image::ColorType::L8);
        assert_eq!(picture.to_luma8().dimensions(), view.photo.dimensions());
    }
}

#[test]
fn a_wrong_matte_stands_out() {
    let dir = tempfile::tempdir().unwrap();
    let (_, good) = audited(&dir.path().join("good"), None);
    let (_, bad) = audited(&dir.path().join("bad"), Some(2));
    let lowest = bad
        .views
        .iter()
        .min_by(|a, b| a.consistency.unwrap().total_cmp(&b.consistency.unwrap()))
        .unwrap();
    assert_eq!(lowest.name, fabricated::SCENE.views[2].name);
    assert!(lowest.consistency.unwrap() < 0.9, "{lowest:?}");
    assert!(bad.views[2].uncertainty > good.views[2].uncertainty + 0.05);
    assert!(bad.views[2].mask_iou < good.views[2].mask_iou);
}
