//! Folders of alpha mattes against a folder of true ones.

use crate::EvalError;
use crate::holes::fill_holes;
use crate::matching::{Pictures, left_out, list_pictures, match_views};
use crate::picture::{Plane, Sized2d, read_alpha};
use crate::report::{AlphaScore, Report, ViewScore, score_alpha};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Scores every matte of `pred_dir`, and if given every mask of `start_dir`, against `gt_dir`.
///
/// The pictures of `gt_dir`, and of folders in it, define the views. Files belong together by name without extension,
/// else by that whatever folder they are in, else by name up to the zero padding of a trailing number, else by trailing
/// number. A view without a prediction (or start mask) is scored as an empty matte and listed in the report. Sub-folders
/// that cannot be read are noted there, unless a view without a prediction has its place in one, which is an error.
pub fn compare_folders(
    pred_dir: &Path,
    gt_dir: &Path,
    start_dir: Option<&Path>,
) -> Result<Report, EvalError> {
    compare(pred_dir, gt_dir, start_dir, read_alpha)
}

/// The same by silhouettes: holes of all mattes, true ones too, are filled first ([`fill_holes`]), which the report notes.
pub fn compare_silhouettes(
    pred_dir: &Path,
    gt_dir: &Path,
    start_dir: Option<&Path>,
) -> Result<Report, EvalError> {
    let read = |path: &Path| read_alpha(path).map(|matte| fill_holes(&matte));
    let mut report = compare(pred_dir, gt_dir, start_dir, read)?;
    report
        .notes
        .push("holes of all mattes, true ones too, were filled first".to_owned());
    Ok(report)
}

fn compare(
    pred_dir: &Path,
    gt_dir: &Path,
    start_dir: Option<&Path>,
    read: impl Fn(&Path) -> Result<Plane, EvalError> + Sync,
) -> Result<Report, EvalError> {
    let truth = list_pictures(gt_dir)?;
    let pred = match_views(gt_dir, &truth.pictures, pred_dir)?;
    let start = start_dir
        .map(|dir| match_views(gt_dir, &truth.pictures, dir))
        .transpose()?;
    let scores = truth
        .pictures
        .par_iter()
        .map(|(name, path)| {
            let alpha = read(path)?;
            let view = score_file(pred.pictures.get(name), path, &alpha, &read)?;
            let start = start
                .as_ref()
                .map(|start| score_file(start.pictures.get(name), path, &alpha, &read))
                .transpose()?;
            Ok((
                ViewScore {
                    name: name.clone(),
                    score: view,
                },
                start,
            ))
        })
        .collect::<Result<Vec<_>, EvalError>>()?;
    let (views, starts): (Vec<ViewScore>, Vec<Option<AlphaScore>>) = scores.into_iter().unzip();
    let empty = || EvalError::EmptyFolder {
        path: gt_dir.to_owned(),
    };
    Ok(Report {
        mean: AlphaScore::mean(views.iter().map(|view| &view.score)).ok_or_else(empty)?,
        views,
        start: AlphaScore::mean(starts.iter().flatten()),
        plate: None,
        clean_plate: None,
        mesh: None,
        missing: unmatched(&truth.pictures, &pred.pictures),
        start_missing: start
            .as_ref()
            .map(|start| unmatched(&truth.pictures, &start.pictures))
            .unwrap_or_default(),
        notes: left_out([&truth, &pred].into_iter().chain(&start)),
    })
}

fn score_file(
    pred: Option<&PathBuf>,
    truth_path: &Path,
    truth: &Plane,
    read: impl Fn(&Path) -> Result<Plane, EvalError>,
) -> Result<AlphaScore, EvalError> {
    let Some(path) = pred else {
        return Ok(score_alpha(&Plane::empty(truth.width, truth.height), truth));
    };
    let pred = read(path)?;
    check_size(path, &pred, truth_path, truth)?;
    Ok(score_alpha(&pred, truth))
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
