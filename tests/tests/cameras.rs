//! Cameras that are a little off are put right while the fields learn.
#![allow(clippy::unwrap_used)]

use demo_scene::DemoConfig;
use glam::{DQuat, DVec3};
use io_colmap::{MaskSet, Pose, Scene};
use sos_train::config::{Preset, TrainConfig};
use sos_train::prepare::view::load_views;
use sos_train::prepare::{Prepared, TrainView, prepare};
use sos_train::run_folder::{Existing, RunFolder};
use sos_train::train::Trainer;

fn config(refinement: &str, steps: u32) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.steps = steps;
    for setting in [
        "model.levels=8",
        "model.log2_table_size=13",
        "sampling.target_samples=8192",
        "sampling.occupancy_resolution=32",
        "schedule.warmup_steps=10",
        &format!("prepare.refine_cameras={refinement}"),
    ] {
        config.apply_override(setting).unwrap();
    }
    config.validate().unwrap();
    config
}

/// The small demo scene, prepared with each camera turned by `degrees` about an axis of its own, and its true poses.
fn scene_with_errors(config: &TrainConfig, degrees: f64) -> (Prepared, Vec<Pose>) {
    let folder = tempfile::tempdir().unwrap();
    let sized = DemoConfig {
        views: 16,
        width: 160,
        height: 120,
        ..DemoConfig::tiny()
    };
    demo_scene::generate(&sized).write(folder.path()).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let masks = MaskSet::find(&folder.path().join("coarse_masks"), &scene, None).unwrap();
    let mut views = load_views(&scene, Some(&masks)).unwrap();
    let pose = |view: &TrainView| view.camera_from_world;
    let truth = views.iter().map(pose).collect();
    for (i, view) in views.iter_mut().enumerate() {
        let (sine, cosine) = (2.4 * i as f64).sin_cos();
        let axis = DVec3::new(cosine, sine, 0.0);
        let turn = DQuat::from_axis_angle(axis, degrees.to_radians());
        let old = view.camera_from_world;
        view.camera_from_world = Pose {
            rotation: turn * old.rotation,
            translation: turn * old.translation,
        };
    }
    let points = &scene.model.points;
    let data = prepare(views, points, &config.prepare, config.loss.ignore_band).unwrap();
    (data, truth)
}

/// By how many pixels the box's centre is seen elsewhere than it should be: the mean.
fn error(data: &Prepared, truth: &[Pose]) -> f64 {
    let errors = data.views.iter().zip(truth).map(|(view, truth)| {
        let (seen, _) = view.project(data.frame.centre).unwrap();
        let place = truth.transform_point(data.frame.centre);
        let right = view.lens.0.project(place).unwrap();
        seen.as_dvec2().distance(right)
    });
    errors.sum::<f64>() / truth.len() as f64
}

#[test]
fn cameras_that_are_off_are_put_right_and_a_checkpoint_knows_where() {
    let config = config("always", 1000);
    let (mut data, truth) = scene_with_errors(&config, 0.6);
    let before = error(&data, &truth);
    let mut trainer = Trainer::new(&config, &data).unwrap();
    let mut notes = Vec::new();
    while trainer.step_number() < 360 {
        notes.extend(trainer.refine_cameras(&mut data).unwrap());
        trainer.step(&data);
    }
    let after = error(&data, &truth);
    println!("{before:.2} pixels before, {after:.2} after; {notes:?}");
    assert!(after < 0.6 * before, "{before} {after}");
    assert!(notes.len() == 1 && notes[0].contains("off by"), "{notes:?}");

    let folder = tempfile::tempdir().unwrap();
    let run = RunFolder::create(&folder.path().join("run"), Existing::Keep).unwrap();
    trainer.save(&run, 0.0).unwrap();
    let (mut anew, _) = scene_with_errors(&config, 0.6);
    let mut resumed = Trainer::new(&config, &anew).unwrap();
    resumed.load(&run).unwrap();
    resumed.place_cameras(&mut anew);
    for (anew, view) in anew.views.iter().zip(&data.views) {
        let [a, b] = [anew, view].map(|view| view.camera_from_world);
        // Written in decimals.
        let apart = a.translation.distance(b.translation) + a.rotation.angle_between(b.rotation);
        assert!(apart < 1e-6, "{apart}");
    }
}

#[test]
fn cameras_that_are_right_stay_where_they_are() {
    let config = config("auto", 400);
    let (mut data, truth) = scene_with_errors(&config, 0.0);
    let mut trainer = Trainer::new(&config, &data).unwrap();
    while trainer.step_number() < 110 {
        assert_eq!(trainer.refine_cameras(&mut data).unwrap(), None);
        trainer.step(&data);
    }
    assert!(!trainer.has_moved_cameras());
    assert!(error(&data, &truth) < 1e-3);
}
