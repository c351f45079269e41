//! What SPIn-NeRF's loaders take for granted, and what of it a scene can be given.
//!
//! * They list one folder, and take a photo's name up to the first dot for its label's. Photos named `cutout` or
//!   `pseudo` have no label there, which moves those of all that follow.
//! * One focal length, the first number of the first camera in the file, is that of all photos, with the axis in
//!   the middle.
//! * Photo `i` of the model, in the order of the names, has the number `i`, from 1 on.
//! * A label is divided by its largest value; a photo without one counts as not labelled.
//! * Near and far of a view are those of the sparse points that it saw: one without any stops `imgs2poses.py`.

use crate::error::ExportError;
use crate::pinhole;
use crate::run::{Posed, Run};
use io_colmap::{Camera, Model, Scene};
use std::collections::{BTreeMap, HashMap, HashSet};

const NAME: &str = "SPIn-NeRF";
const RENAME: &str = "rename it in the photo folder and the model, and make the run again";

/// By how much a photo's pixels may be off where its camera is another one than SPIn-NeRF has, in pixels. Its rays
/// go through pixels' corners, so that half a pixel is nothing to it.
const MOST_OFF: f64 = 1.0;
/// The same as a share of the longer side: COLMAP's focal lengths of one camera per photo differ by about as much.
const MOST_OFF_SHARE: f64 = 0.002;

/// What photos' names must not contain.
const SKIPPED: [&str; 2] = ["cutout", "pseudo"];

/// The names of photos' labels, without ending.
pub(crate) fn labels<'a>(scene: &Scene, names: &'a [String]) -> Result<Vec<&'a str>, ExportError> {
    let mut taken: BTreeMap<&str, &str> = BTreeMap::new();
    names
        .iter()
        .map(|name| {
            let label = name.split('.').next().unwrap_or_default();
            let other = taken.insert(label, name);
            let skipped = SKIPPED.iter().find(|word| name.contains(**word));
            let what = if name.contains('/') {
                format!("the photo is in a sub-folder, and {NAME} knows none")
            } else if label.is_empty() {
                format!("the photo's name begins with a dot, and {NAME} takes what comes before")
            } else if let Some(word) = skipped {
                format!("{NAME} looks for no label of photos with {word:?} in their names")
            } else if let Some(other) = other {
                format!(
                    "{NAME} takes photos' names up to the first dot, which is the same for {other:?}"
                )
            } else {
                return Ok(label);
            };
            Err(ExportError::bad(&scene.image_dir.join(name), what, RENAME))
        })
        .collect()
}

/// Refuses cameras that are not one pinhole with its axis in the middle.
pub(crate) fn check_cameras(scene: &Scene, posed: &[Posed<'_>]) -> Result<(), ExportError> {
    pinhole::check(NAME, scene, posed)?;
    let first = posed.iter().min_by_key(|posed| posed.camera.id);
    let focal = first.map_or(1.0, |posed| posed.camera.focal().0);
    for one in posed {
        let off = pixels_off(one.camera, focal);
        let longer = f64::from(one.camera.width.max(one.camera.height));
        if off > f64::max(MOST_OFF, MOST_OFF_SHARE * longer) {
            return Err(ExportError::bad(
                &scene.image_path(one.view),
                format!(
                    "{NAME} has one focal length for all photos and the axis in the middle, here {focal:.1}, which puts \
                     what is seen in this one up to {off:.1} pixels off"
                ),
                "have COLMAP make the scene with one camera for all photos, whose principal point stays in the middle \
                 (--ImageReader.single_camera 1), and train on that",
            ));
        }
    }
    Ok(())
}

/// How far a pinhole's pixels are at most from where one of that focal length with the axis in the middle has them.
fn pixels_off(camera: &Camera, focal: f64) -> f64 {
    let ((fx, fy), (cx, cy)) = (camera.focal(), camera.principal_point());
    let along = |size: u32, own: f64, centre: f64| {
        let size = f64::from(size);
        // Off by a linear function of the place: most at one of the edges.
        [0.0, size]
            .map(|at| (focal * (at - centre) / own + size / 2.0 - at).abs())
            .into_iter()
            .fold(0.0, f64::max)
    };
    along(camera.width, fx, cx).max(along(camera.height, fy, cy))
}

/// Numbers views from 1 in the order in which they stand, in the tracks too, and leaves out cameras that no view has.
pub(crate) fn numbered(mut model: Model) -> Model {
    let numbers: HashMap<u32, u32> = model.views.iter().map(|view| view.id).zip(1..).collect();
    for (view, number) in model.views.iter_mut().zip(1..) {
        view.id = number;
    }
    for point in &mut model.points {
        point.views = point
            .views
            .iter()
            .filter_map(|id| numbers.get(id).copied())
            .collect();
        point.views.sort_unstable();
    }
    let used: HashSet<u32> = model.views.iter().map(|view| view.camera_id).collect();
    model.cameras.retain(|id, _| used.contains(id));
    model
}

/// Refuses views that saw no sparse point.
pub(crate) fn check_points(scene: &Scene, posed: &[Posed<'_>]) -> Result<(), ExportError> {
    let by_id: HashMap<u32, Posed<'_>> = posed.iter().map(|one| (one.view.id, *one)).collect();
    let mut seeing: HashSet<u32> = HashSet::new();
    for point in &scene.model.points {
        seeing.extend(point.views.iter().filter(|id| {
            // Only what projects is written into a track.
            by_id.get(id).is_some_and(|Posed { view, camera, .. }| {
                let seen = view.camera_from_world.transform_point(point.position);
                camera.project(seen).is_some()
            })
        }));
    }
    let blind = posed.iter().filter(|one| !seeing.contains(&one.view.id));
    let count = blind.clone().count();
    let Some(first) = blind.min_by_key(|one| &one.view.name) else {
        return Ok(());
    };
    let what = match posed.len() {
        all if all == count => format!(
            "the model does not say which photos see its {} sparse points",
            scene.model.points.len()
        ),
        all => format!(
            "no sparse point of the model is seen in {count} of {all} photos, of which this is one"
        ),
    };
    Err(ExportError::bad(
        &scene.image_path(first.view),
        format!("{what}, and {NAME} takes every view's near and far from those"),
        "have COLMAP make the scene, or its points with colmap point_triangulator, and train on that",
    ))
}

/// A sentence about views without a label; refused where none has one.
pub(crate) fn unlabelled(
    run: &Run,
    labelled: usize,
    views: usize,
) -> Result<Option<String>, ExportError> {
    if labelled == 0 {
        return Err(ExportError::bad(
            &run.root.join("alpha"),
            format!("the object is in none of the views: {NAME} would have nothing to take out"),
            "train for longer, or with masks that show the object",
        ));
    }
    Ok((labelled < views).then(|| {
        format!(
            "the object is in {labelled} of {views} views; the others have no label, for {NAME} cannot use one that is \
             0 everywhere"
        )
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use io_colmap::CameraModel;

    #[test]
    fn pixels_are_off_by_focal_length_and_centre() {
        let camera = |params: [f64; 4]| Camera {
            id: 1,
            model: CameraModel::Pinhole,
            width: 100,
            height: 50,
            params: params.to_vec(),
        };
        let off = |params| pixels_off(&camera(params), 200.0);
        assert_eq!(off([200.0, 200.0, 50.0, 25.0]), 0.0);
        assert_eq!(off([200.0, 200.0, 53.0, 23.0]), 3.0);
        // A tenth of half a height.
        assert!((off([200.0, 200.0 / 1.1, 50.0, 25.0]) - 2.5).abs() < 1e-9);
    }
}
