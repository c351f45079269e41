//! Prints, for every photo of a COLMAP scene, how many of its sparse points fall into the picture:
//! `cargo run -p io-colmap --example where_points_fall SCENE`.

use io_colmap::{ColmapError, Scene};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(scene) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: where_points_fall SCENE");
        return ExitCode::from(2);
    };
    match print(&scene) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn print(folder: &Path) -> Result<(), ColmapError> {
    let scene = Scene::open(folder)?;
    for note in &scene.notes {
        println!("{note}");
    }
    let model = &scene.model;
    for view in &model.views {
        let Some(camera) = model.cameras.get(&view.camera_id) else {
            continue;
        };
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        // Camera space has z forward; `project` goes through the lens, distortion included.
        let inside = model
            .points
            .iter()
            .filter_map(|point| {
                let in_camera = view.camera_from_world.transform_point(point.position);
                camera.project(in_camera).filter(|_| in_camera.z > 0.0)
            })
            .filter(|pixel| (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y))
            .count();
        println!("{}: {inside} of {} points", view.name, model.points.len());
    }
    Ok(())
}
