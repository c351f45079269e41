//! Folders of alpha mattes against a folder of true ones.

use crate::EvalError;
use crate::holes::fill_holes;
use crate::iou::Overlap;
use crate::matching::{Pictures, left_out, list_pictures, match_views};
use crate::mattes::Mattes;
use crate::picture::{Plane, Sized2d};
use crate::report::{AlphaScore, MASK_THRESHOLD, Report, ViewScore, score_alpha};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Scores every matte of `pred_dir`, and if given every mask of `start_dir`, against `gt_dir`.
///
/// The pictures of `gt_dir`, and of folders in it, define the views. Files belong together by name without extension,
/// else by that whatever folder they are in, else by name up to the zero padding of a trailing number, else by trailing
/// number. A view without a prediction (or start mask) is scored as an empty matte and listed in the report. Sub-folders
/// that cannot be read are noted there, unless a view without a prediction has its place in one, which is an error. So are
/// masks that hold the labels 0 and 1, which are read as black and white, and those in which black seems to be the object.
pub fn compare_folders(
    pred_dir: &Path,
    gt_dir: &Path,
    start_dir: Option<&Path>,
) -> Result<Report, EvalError> {
    compare(pred_dir, gt_dir, start_dir, |matte| matte)
}

/// The same by silhouettes: holes of all mattes, true ones too, are filled first ([`fill_holes`]), which the report notes.
pub fn compare_silhouettes(
    pred_dir: &Path,
    gt_dir: &Path,
    start_dir: Option<&Path>,
) -> Result<Report, EvalError> {
    let mut report = compare(pred_dir, gt_dir, start_dir, |matte| fill_holes(&matte))?;
    report
        .notes
        .push("holes of all mattes, true ones too, were filled first".to_owned());
    Ok(report)
}

/// Scores mattes as `finish` leaves them.
fn compare(
    pred_dir: &Path,
    gt_dir: &Path,
    start_dir: Option<&Path>,
    finish: impl Fn(Plane) -> Plane + Sync,
) -> Result<Report, EvalError> {
    let truth = list_pictures(gt_dir)?;
    let pred = match_views(gt_dir, &truth.pictures, pred_dir)?;
    let start = start_dir
        .map(|dir| match_views(gt_dir, &truth.pictures, dir))
        .transpose()?;
    let true_mattes = Mattes::of(gt_dir, &truth.pictures)?;
    let pred_mattes = Mattes::of(pred_dir, &pred.pictures)?;
    let start_mattes = start_dir
        .zip(start.as_ref())
        .map(|(dir, start)| Mattes::of(dir, &start.pictures))
        .transpose()?;
    let scores = truth
        .pictures
        .par_iter()
        .map(|(name, path)| {
            let alpha = finish(true_mattes.read(path)?);
            let score = |pictures: &Pictures, mattes: &Mattes<'_>| {
                score_file(pictures.get(name), path, &alpha, |path| {
                    mattes.read(path).map(&finish)
                })
            };
            let (of_view, overlap) = score(&pred.pictures, &pred_mattes)?;
            let start = start
                .as_ref()
                .zip(start_mattes.as_ref())
                .map(|(start, mattes)| score(&start.pictures, mattes))
                .transpose()?;
            let view = ViewScore {
                name: name.clone(),
                score: of_view,
            };
            Ok((view, overlap, start))
        })
        .collect::<Result<Vec<_>, EvalError>>()?;
    let mut notes = left_out([&truth, &pred].into_iter().chain(&start));
    notes.extend(true_mattes.note());
    notes.extend(pred_mattes.note());
    notes.extend(pred_mattes.inversion(scores.iter().filter_map(|score| score.1.as_ref())));
    if let Some(mattes) = &start_mattes {
        notes.extend(mattes.note());
        let overlaps = scores
            .iter()
            .filter_map(|score| score.2.as_ref()?.1.as_ref());
        notes.extend(mattes.inversion(overlaps));
    }
    let starts = scores.iter().filter_map(|score| Some(&score.2.as_ref()?.0));
    let start_score = AlphaScore::mean(starts);
    let views: Vec<ViewScore> = scores.into_iter().map(|score| score.0).collect();
    let empty = || EvalError::EmptyFolder {
        path: gt_dir.to_owned(),
    };
    Ok(Report {
        mean: AlphaScore::mean(views.iter().map(|view| &view.score)).ok_or_else(empty)?,
        views,
        start: start_score,
        plate: None,
        clean_plate: None,
        mesh: None,
        missing: unmatched(&truth.pictures, &pred.pictures),
        start_missing: start
            .as_ref()
            .map(|start| unmatched(&truth.pictures, &start.pictures))
            .unwrap_or_default(),
        notes,
    })
}

/// The score of a view's picture, and its overlap with the truth; without a picture that of an empty matte, and none.
fn score_file(
    pred: Option<&PathBuf>,
    truth_path: &Path,
    truth: &Plane,
    read: impl Fn(&Path) -> Result<Plane, EvalError>,
) -> Result<(AlphaScore, Option<Overlap>), EvalError> {
    let Some(path) = pred else {
        let empty = Plane::empty(truth.width, truth.height);
        return Ok((score_alpha(&empty, truth), None));
    };
    let pred = read(path)?;
    check_size(path, &pred, truth_path, truth)?;
    let [mask, true_mask] = [&pred, truth].map(|plane| plane.mask(MASK_THRESHOLD));
    let overlap = Overlap::count(&mask, &true_mask);
    Ok((score_alpha(&pred, truth), Some(overlap)))
}

/// Views of the truth that the other folder lacks.
pub(crate) fn unmatched(truth: &Pictures, matched: &Pictures) -> Vec<String> {
    truth
        .keys()
        .filter(|name| !matched.contains_key(*name))
        .cloned()
        .collect()
}

/// Two pictures read from files must have one size.
pub(crate) fn check_size(
    path: &Path,
    picture: &impl Sized2d,
    truth_path: &Path,
    truth: &impl Sized2d,
) -> Result<(), EvalError> {
    if picture.size() == truth.size() {
        return Ok(());
    }
    Err(EvalError::SizeMismatch {
        path: path.to_owned(),
        size: picture.size(),
        truth: truth_path.to_owned(),
        truth_size: truth.size(),
    })
}
