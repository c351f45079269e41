//! A run as training would leave it, without training.

use demo_scene::{DemoConfig, DemoScene, generate};
use glam::Vec3;
use ply_mesh::Mesh;
use sos_train::config::{InputRecord, RunRecord, TrainConfig};
use sos_train::export::{LogRecord, TrainLog, ViewRender, write_mesh, write_view};
use sos_train::run_folder::{Existing, RunFolder};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

/// Six small views; two have no mask.
pub(crate) static SCENE: LazyLock<DemoScene> = LazyLock::new(|| {
    generate(&DemoConfig {
        views: 6,
        mesh_cell: 0.004,
        ..DemoConfig::tiny()
    })
});

/// The miniature demo, and results that are the truth itself.
pub(crate) fn run(dir: &Path, demo: bool) -> (&'static DemoScene, RunFolder) {
    let run = RunFolder::create(&dir.join("run"), Existing::Keep).unwrap();
    let scene: &DemoScene = &SCENE;
    let scene_dir = if demo {
        run.scene_dir()
    } else {
        dir.join("cat & <dog>")
    };
    scene.write(&scene_dir).unwrap();
    let input = InputRecord {
        scene: scene_dir.clone(),
        masks: Some(scene_dir.join("coarse_masks")),
        polarity: None,
        ignore: None,
        out: run.root().to_path_buf(),
        demo,
        imported_from: None,
        photos: None,
        click: None,
        object_box: None,
    };
    run.set_config(
        RunRecord::new(TrainConfig::default(), input)
            .to_toml()
            .unwrap(),
    );
    for view in &scene.views {
        write_view(&run, &render(view)).unwrap();
    }
    let mut log = TrainLog::create(&run).unwrap();
    log.event(0, "start", [("device", "cpu (test)".into())])
        .unwrap();
    log.note(0, "a note with <b>markup</b>").unwrap();
    for step in (50..=3000).step_by(50) {
        let t = step as f32 / 3000.0;
        log.record(&LogRecord {
            step,
            seconds: f64::from(step) * 0.1,
            psnr: 12.0 + 16.0 * t.sqrt(),
            sharpness: 20.0 * (4.0 * t).exp(),
            samples_per_second: 1.1e6 + 1e5 * (step as f32 * 0.01).sin(),
            levels: 4 + step / 300,
            alpha_change: Some(0.02 * (1.0 - t) + 1e-4),
            losses: BTreeMap::from([
                ("total".to_owned(), 0.1 * (-3.0 * t).exp()),
                ("colour".to_owned(), 0.07 * (-3.5 * t).exp()),
                ("eikonal".to_owned(), 0.02 * (-2.0 * t).exp()),
            ]),
            ..LogRecord::default()
        })
        .unwrap();
    }
    log.event(3000, "end", [("seconds", 312.5.into())]).unwrap();
    write_mesh(&run, &mesh(scene)).unwrap();
    (scene, run)
}

pub(crate) fn render(view: &demo_scene::DemoView) -> ViewRender {
    let (width, height) = view.photo.dimensions();
    let colours = |picture: &image::RgbImage| -> Vec<[f32; 3]> {
        picture
            .pixels()
            .map(|p| p.0.map(|c| f32::from(c) / 255.0))
            .collect()
    };
    let pixels = (width * height) as usize;
    let alpha: Vec<f32> = view
        .alpha
        .pixels()
        .map(|p| f32::from(p.0[0]) / 255.0)
        .collect();
    ViewRender {
        name: view.name.clone(),
        width,
        height,
        foreground: colours(&view.photo),
        background: colours(&view.background_shadow),
        seen: (0..pixels).map(|i| (i % 29) as u8).collect(),
        normal: alpha
            .iter()
            .map(|a| if *a > 0.0 { [0.0, 0.6, -0.8] } else { [0.0; 3] })
            .collect(),
        depth: alpha.iter().map(|a| 1.25 * a).collect(),
        alpha,
    }
}

fn mesh(scene: &DemoScene) -> Mesh {
    let vertices = scene.mesh.positions.len();
    Mesh {
        normals: vec![Vec3::Z; vertices],
        colours: vec![[200, 80, 10]; vertices],
        ..scene.mesh.clone()
    }
}
