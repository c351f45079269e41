//! Writes a COLMAP model with cameras that are off, for tests of what puts them right, and says by how much they contradict each other:
//! `cargo run --release -p io-colmap --example move_cameras MODEL OUT DEGREES SHARE SEED`.
//!
//! Each camera is turned by `DEGREES` about each of its axes and moved by `SHARE` of its distance from the middle of the points, normally distributed.
//! With no more than `MODEL OUT`, nothing is moved, and `OUT` is measured instead (such as a run's `cameras/`).

use glam::{DMat3, DQuat, DVec3, EulerRot};
use io_colmap::{ColmapError, Model, Pose, View};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let done = match words[..] {
        [model, out] => Model::read(Path::new(model)).and_then(|model| {
            let moved = Model::read(Path::new(out))?;
            println!("{out}: {}", Contradiction::between(&moved, &model));
            Ok(())
        }),
        [model, out, degrees, share, seed] => {
            let (Ok(degrees), Ok(share), Ok(seed)) = (degrees.parse(), share.parse(), seed.parse())
            else {
                return usage();
            };
            move_cameras(Path::new(model), Path::new(out), degrees, share, seed)
        }
        _ => return usage(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: move_cameras MODEL OUT [DEGREES SHARE SEED], such as scene/sparse/0 moved/sparse/0 0.15 0.003 1"
    );
    ExitCode::from(2)
}

fn move_cameras(
    model: &Path,
    out: &Path,
    degrees: f64,
    share: f64,
    seed: u64,
) -> Result<(), ColmapError> {
    let model = Model::read(model)?;
    let middle = model
        .points
        .iter()
        .map(|point| point.position)
        .sum::<DVec3>()
        / model.points.len().max(1) as f64;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    // By Box and Muller; `1 - u` is never zero.
    let mut normal = || {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
    };
    let mut three = || DVec3::new(normal(), normal(), normal());
    let mut moved = model.clone();
    for view in &mut moved.views {
        let pose = view.camera_from_world;
        let turn = three() * degrees.to_radians();
        let turn = DQuat::from_euler(EulerRot::XYZ, turn.x, turn.y, turn.z);
        // Along each axis as much as gives `share` in all.
        let shift = three() * (share / 3.0_f64.sqrt() * pose.centre().distance(middle));
        view.camera_from_world = Pose {
            rotation: turn * pose.rotation,
            translation: turn * (pose.translation + shift),
        };
    }
    moved.write_binary(out)?;
    println!(
        "{}: {}",
        out.display(),
        Contradiction::between(&moved, &model)
    );
    Ok(())
}

/// By how much cameras contradict each other: how far from where the true cameras see a point the others do, in pixels, after the point has been moved to where
/// their own rays for it meet best. What moves, turns or scales the whole world is no contradiction.
struct Contradiction {
    pixels: Vec<f64>,
}

impl Contradiction {
    fn between(moved: &Model, true_model: &Model) -> Self {
        let moved_views: HashMap<&str, &View> = (moved.views.iter())
            .map(|view| (view.name.as_str(), view))
            .collect();
        let true_views: HashMap<u32, &View> = (true_model.views.iter())
            .map(|view| (view.id, view))
            .collect();
        let mut pixels = Vec::new();
        for point in &true_model.points {
            let seen: Vec<_> = (point.views.iter())
                .filter_map(|id| {
                    let view = true_views.get(id)?;
                    let moved = moved_views.get(view.name.as_str())?;
                    let camera = true_model.cameras.get(&view.camera_id)?;
                    let pixel =
                        camera.project(view.camera_from_world.transform_point(point.position))?;
                    Some((camera, moved.camera_from_world, pixel))
                })
                .collect();
            // The nearest place to all rays: the projections beside each ray, summed, times the place are those of the rays' origins.
            let (mut sum, mut of_origins) = (DMat3::ZERO, DVec3::ZERO);
            for (camera, pose, pixel) in &seen {
                let Some(ray) = camera.unproject(*pixel) else {
                    continue;
                };
                let along = pose.inverse().transform_vector(ray).normalize();
                let beside = DMat3::IDENTITY
                    - DMat3::from_cols(along * along.x, along * along.y, along * along.z);
                sum += beside;
                of_origins += beside * pose.centre();
            }
            if seen.len() < 2 || sum.determinant().abs() < 1e-9 {
                continue;
            }
            let place = sum.inverse() * of_origins;
            pixels.extend(seen.iter().filter_map(|(camera, pose, pixel)| {
                Some(
                    camera
                        .project(pose.transform_point(place))?
                        .distance(*pixel),
                )
            }));
        }
        pixels.sort_by(f64::total_cmp);
        Self { pixels }
    }
}

impl std::fmt::Display for Contradiction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let count = self.pixels.len();
        let Some(median) = self.pixels.get(count / 2) else {
            return write!(f, "no point is seen by two of the cameras");
        };
        let mean = self.pixels.iter().sum::<f64>() / count as f64;
        write!(
            f,
            "cameras contradict each other by {mean:.2} pixels on average, {median:.2} in the median, of {count} observations"
        )
    }
}
