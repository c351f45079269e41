//! Against what the scenes' own README states. The scenes are not part of the repository: set
//! `SOS_SHARED` to a folder with `scenes/`, or have it at `../shared` beside the workspace.

use crate::assert_near;
use sos_eval::*;
use std::fs;
use std::path::{Path, PathBuf};

fn scene(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("SOS_SHARED").map(PathBuf::from);
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let places = [
        shared,
        Some(manifest.join("../shared")),
        Some(manifest.join("../../shared")),
    ];
    let found = places
        .into_iter()
        .flatten()
        .map(|shared| shared.join("scenes").join(name))
        .find(|p| p.is_dir());
    if found.is_none() {
        println!("skipped: no scene {name:?} under SOS_SHARED or ../shared");
    }
    found
}

fn coarse_masks_score(name: &str, iou: f64, missing: &[&str]) {
    let Some(scene) = scene(name) else { return };
    let start = std::time::Instant::now();
    let report =
        compare_folders(&scene.join("coarse_masks"), &scene.join("alpha_gt"), None).unwrap();
    println!(
        "{name}: {} views in {:?}\n{report}",
        report.views.len(),
        start.elapsed()
    );
    assert_near(report.mean.iou, iou, 1e-3);
    assert_eq!(report.missing, missing);
}

#[test]
fn toy_plane_orbit_start_masks() {
    coarse_masks_score("toy_plane_orbit", 0.799, &["001", "036"]);
}

#[test]
fn drill_occluded_start_masks() {
    coarse_masks_score("drill_occluded", 0.786, &["011", "016"]);
}

#[test]
fn the_truth_scores_perfectly_as_a_run() {
    let Some(scene) = scene("toy_plane_orbit") else {
        return;
    };
    let run = tempfile::tempdir().unwrap();
    for (from, to) in [("alpha_gt", "alpha"), ("background_gt", "background")] {
        fs::create_dir(run.path().join(to)).unwrap();
        for file in fs::read_dir(scene.join(from)).unwrap() {
            let file = file.unwrap();
            fs::copy(file.path(), run.path().join(to).join(file.file_name())).unwrap();
        }
    }
    fs::copy(scene.join("mesh_gt.ply"), run.path().join("mesh.ply")).unwrap();
    let start = std::time::Instant::now();
    let report = run_eval(
        run.path(),
        &scene.join("alpha_gt"),
        Some(&scene.join("coarse_masks")),
    )
    .unwrap();
    println!("{:?}\n{report}", start.elapsed());
    assert_eq!(
        report.mean.to_array(),
        [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    );
    assert_near(report.start.unwrap().iou, 0.799, 1e-3);
    // Against the plates that keep the plane's dark shadow. The number is numpy's for the same files.
    let plate = report.plate.unwrap();
    assert_eq!(plate.truth, "background_shadow_gt");
    assert_eq!(plate.object.unwrap().views, 6);
    assert_near(plate.object.unwrap().psnr, 15.23, 0.05);
    assert_near(report.mesh.unwrap().relative.chamfer, 0.0, 1e-6);
}
