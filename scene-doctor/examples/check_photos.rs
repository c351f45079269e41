//! Checks the photos of a COLMAP scene, taking the middle of its sparse points for the object:
//! `cargo run --release -p scene-doctor --example check_photos SCENE`.

use glam::DVec3;
use io_colmap::{ColmapError, Scene};
use scene_doctor::{Exam, ExamView, Files, Masks, Subject, examine};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(scene) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: check_photos SCENE");
        return ExitCode::from(2);
    };
    match check(&scene) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn check(folder: &Path) -> Result<(), ColmapError> {
    let scene = Scene::open(folder)?;
    let model = &scene.model;
    let photos: Result<Vec<_>, _> = model.views.iter().map(|v| scene.read_photo(v)).collect();
    let photos: Vec<_> = photos?.into_iter().map(|photo| photo.into_rgb8()).collect();
    // A model may have been made from smaller photos.
    let cameras = model.views.iter().zip(&photos).map(|(view, photo)| {
        let camera = model.cameras.get(&view.camera_id)?;
        Some(camera.scaled_to(photo.width(), photo.height()))
    });
    let cameras: Vec<_> = cameras.collect();
    let views = model.views.iter().zip(&photos).zip(&cameras);
    let views = views.filter_map(|((view, photo), camera)| {
        Some(ExamView {
            name: &view.name,
            id: view.id,
            camera: camera.as_ref()?,
            camera_from_world: view.camera_from_world,
            photo,
            mask: None,
        })
    });
    let points = model.points.iter().map(|point| point.position);
    let centre = points.clone().sum::<DVec3>() / model.points.len().max(1) as f64;
    let mut away: Vec<f64> = points.map(|point| point.distance(centre)).collect();
    away.sort_by(f64::total_cmp);
    let subject = match away.get(away.len() / 2) {
        Some(&half_side) => Subject::Found {
            centre,
            half_side,
            by: "where most sparse points are".to_owned(),
        },
        None => Subject::Unknown {
            why: "the model has no sparse points".to_owned(),
        },
    };
    let exam = Exam::new(views.collect(), &model.points, subject, None);
    let name = folder.display().to_string();
    let masks = Masks::None { offered: None };
    println!("{}", examine(&name, &exam, &Files::default(), &masks));
    Ok(())
}
