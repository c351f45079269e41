//! One run's folder against a scene's ground truth: mattes, and plates and mesh where both have them.

use crate::EvalError;
use crate::comparison::true_mattes;
use crate::folders::compare_folders;
use crate::matching::list_pictures;
use crate::mesh::{MESH_SAMPLES, compare_meshes};
use crate::plates::{MIN_SEEN, compare_plates};
use crate::ply::read_ply;
use crate::report::Report;
use std::collections::HashSet;
use std::path::Path;

/// Seed of the points drawn on the meshes.
const MESH_SEED: u64 = 1;

/// Scores `run_dir` against `gt_dir`.
///
/// `run_dir` holds `alpha/`, and perhaps `background/`, `background_seen/` and `mesh.ply`. `gt_dir` is a
/// scene with a folder `alpha_gt`, or that folder itself, or any folder of true mattes. Beside the
/// mattes may lie `background_shadow_gt/` (the object removed but its shadow kept, as in the pictures
/// the run has seen), `background_gt/` (its shadow removed too) or both, and `mesh_gt.ply`, in the run's
/// coordinates.
/// Mattes are required, whatever else both sides have is scored too; a mesh that cannot be is noted in the report.
pub fn run_eval(run_dir: &Path, gt_dir: &Path, start: Option<&Path>) -> Result<Report, EvalError> {
    let alpha_gt = true_mattes(gt_dir);
    let alpha = run_dir.join("alpha");
    if !alpha.is_dir() && holds_mattes(run_dir) {
        return Err(EvalError::NoRun {
            path: run_dir.to_owned(),
        });
    }
    let mut report = compare_folders(&alpha, &alpha_gt, start)?;

    // `..` and not `parent()`: the latter of "." or a link is not the folder above.
    let scene = alpha_gt.join("..");
    let beside = |name: &str| Some(scene.join(name)).filter(|path| path.exists());
    let plates = run_dir.join("background");
    let seen = Some(run_dir.join("background_seen")).filter(|path| path.is_dir());
    let mut scores = ["background_shadow_gt", "background_gt"]
        .into_iter()
        .filter_map(beside)
        .filter(|_| plates.is_dir())
        .map(|truth| compare_plates(&plates, &truth, &alpha_gt, seen.as_deref(), MIN_SEEN));
    report.plate = scores.next().transpose()?;
    report.clean_plate = scores.next().transpose()?;
    for plate in [&mut report.plate, &mut report.clean_plate]
        .into_iter()
        .flatten()
    {
        report.notes.append(&mut plate.notes);
    }
    // Folders that several scores are of are noted once.
    let mut noted = HashSet::new();
    report.notes.retain(|note| noted.insert(note.clone()));

    let mesh = run_dir.join("mesh.ply");
    if let Some(truth) = beside("mesh_gt.ply")
        && mesh.is_file()
    {
        let scored = read_ply(&mesh).and_then(|surface| {
            compare_meshes(&surface, &read_ply(&truth)?, MESH_SAMPLES, MESH_SEED)
        });
        // An object of which nothing is left, as after a few steps, or a damaged file is no reason to lose the rest.
        match scored {
            Ok(score) => report.mesh = Some(score),
            Err(reason) => report
                .notes
                .push(format!("{}: not scored: {reason}", mesh.display())),
        }
    }
    Ok(report)
}

/// Whether a folder has pictures in it and is no run, which has such too before it has mattes.
fn holds_mattes(folder: &Path) -> bool {
    !folder.join("config.toml").exists() && list_pictures(folder).is_ok()
}
