//! The object alone as a COLMAP scene: cut-outs as RGBA photos, and the model with the points that lie
//! on it. Brush and nerfstudio train on that as it is: alpha is part of what they fit.

use crate::brush_names;
use crate::draft::Draft;
use crate::error::ExportError;
use crate::mesh::mesh_of_run;
use crate::photos::renamed;
use crate::picture::Silhouette;
use crate::run::{Posed, Run};
use image::{ColorType, ImageDecoder as _, ImageReader};
use io_colmap::{Model, Scene, SparsePoint};
use ply_mesh::Mesh;
use rayon::prelude::*;
use std::collections::HashMap;

/// With fewer sparse points on the object than this, points of the mesh are better to start from.
const ENOUGH_POINTS: usize = 100;

/// As many points are taken of a mesh.
const MESH_POINTS: usize = 20_000;

/// Writes `images/` and `sparse/0/`; returns how many photos.
pub(crate) fn write(
    run: &Run,
    scene: &Scene,
    posed: &[Posed<'_>],
    draft: &Draft,
    notes: &mut Vec<String>,
) -> Result<usize, ExportError> {
    let silhouettes: Vec<Silhouette> = posed
        .par_iter()
        .map(|posed| Ok(run.matte_of(*posed)?.silhouette()))
        .collect::<Result<_, ExportError>>()?;
    posed
        .par_iter()
        .try_for_each(|posed| copy_cutout(run, *posed, draft))?;

    let names = photo_names(posed);
    let mut model = renamed(&scene.model, posed, &names);
    let all = model.points.len();
    model.points = on_object(&scene.model, posed, &silhouettes);
    let kept = model.points.len();
    notes.push(format!(
        "{kept} of {all} sparse points lie on the object in most of the views that see them"
    ));
    if kept < ENOUGH_POINTS {
        match mesh_of_run(&run.root) {
            Ok(mesh) => {
                model.points = of_mesh(&mesh);
                notes.push(format!(
                    "that is few to start from: {} points of the mesh take their place",
                    model.points.len()
                ));
            }
            Err(error) => notes.push(format!(
                "that is few to start from, and the mesh gives none instead ({error})"
            )),
        }
    }
    // Others than Brush read such names well.
    if let Some(mixed) = brush_names::mixed(&names, false) {
        notes.push(format!(
            "for Brush, rename {:?} in the images and the model: {}",
            names[mixed.photo()],
            mixed.what(&names)
        ));
    }
    draft.write_model(&model, "sparse/0")?;
    Ok(posed.len())
}

fn photo_names(posed: &[Posed<'_>]) -> Vec<String> {
    posed
        .iter()
        .map(|posed| format!("{}.png", posed.key))
        .collect()
}

/// The run's cut-out is such a photo already: RGBA, straight, sRGB.
fn copy_cutout(run: &Run, posed: Posed<'_>, draft: &Draft) -> Result<(), ExportError> {
    let from = run.picture_path("foreground", posed.key, "png");
    let reader = ImageReader::open(&from)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|e| ExportError::io("read", &from, e))?;
    let damaged = |what: String| run.damaged(&from, what);
    let decoder = reader
        .into_decoder()
        .map_err(|e| damaged(format!("the picture cannot be read ({e})")))?;
    if decoder.color_type() != ColorType::Rgba8 {
        return Err(damaged("this is no 8-bit RGBA picture".to_owned()));
    }
    let camera = (posed.camera.width, posed.camera.height);
    run.check_size(&from, decoder.dimensions(), camera)?;
    draft.copy(&from, &format!("images/{}.png", posed.key))
}

/// The points whose projections lie on the object in more than half of the views that saw them, or,
/// where the model does not say which those are, of the views that could.
fn on_object(model: &Model, posed: &[Posed<'_>], silhouettes: &[Silhouette]) -> Vec<SparsePoint> {
    let by_id: HashMap<u32, usize> = posed
        .iter()
        .enumerate()
        .map(|(i, posed)| (posed.view.id, i))
        .collect();
    let lies_on = |point: &&SparsePoint| {
        let votes = |i: usize| {
            let Posed { view, camera, .. } = posed[i];
            let seen = view.camera_from_world.transform_point(point.position);
            let pixel = camera.project(seen)?;
            silhouettes[i].holds(pixel.x, pixel.y)
        };
        let track = point.views.iter().filter_map(|id| by_id.get(id).copied());
        let cast: Vec<bool> = if point.views.is_empty() {
            (0..posed.len()).filter_map(votes).collect()
        } else {
            track.filter_map(votes).collect()
        };
        2 * cast.iter().filter(|vote| **vote).count() > cast.len()
    };
    model.points.par_iter().filter(lies_on).cloned().collect()
}

/// Evenly numbered vertices, with their colours.
fn of_mesh(mesh: &Mesh) -> Vec<SparsePoint> {
    let step = mesh.positions.len().div_ceil(MESH_POINTS).max(1);
    let vertices = mesh.positions.iter().zip(&mesh.colours).step_by(step);
    (1..)
        .zip(vertices)
        .map(|(id, (position, colour))| SparsePoint {
            id,
            position: *position,
            colour: *colour,
            error: 0.0,
            views: Vec::new(),
        })
        .collect()
}
