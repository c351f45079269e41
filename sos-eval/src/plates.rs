//! Background plates: what the run painted where the object was.

use crate::EvalError;
use crate::folders::{check_size, unmatched};
use crate::image_quality::{psnr_of_mse, squared_error, ssim_map, sum_in, whole_mean};
use crate::matching::{left_out, list_pictures, match_views};
use crate::mattes::Mattes;
use crate::picture::{Mask, Plane, RgbPlane, read_counts_at_least, read_rgb};
use crate::report::MASK_THRESHOLD;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Views that must have seen what lies behind the object for a pixel to count as recoverable, unless
/// told otherwise: three, as many as the method wants before it trusts its own evidence.
pub const MIN_SEEN: u8 = 3;

/// PSNR and SSIM over one kind of region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// dB; squared errors pooled over a view's pixels, then mean over views.
    pub psnr: f64,
    /// Mean over a view's pixels, then over views.
    pub ssim: f64,
    /// dB; squared errors pooled over the pixels of all views.
    pub psnr_pooled: f64,
    /// Mean over the pixels of all views.
    pub ssim_pooled: f64,
    /// Views with such pixels.
    pub views: usize,
}

/// Scores of all plates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlateScore {
    /// The headline: inside the removed object (true alpha >= 0.5) where at least `min_seen` views saw
    /// what lies behind. Absent if there is no such pixel.
    #[serde(flatten)]
    pub seen: Option<Quality>,
    /// Inside the removed object, seen or not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<Quality>,
    /// The whole picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub whole: Option<Quality>,
    /// Share of the object's pixels in all views that count as seen.
    pub seen_share: f64,
    /// Views that must have seen a pixel.
    pub min_seen: u8,
    /// Name of the folder with the true plates.
    pub truth: String,
    /// Views with a true plate that were not scored for want of a predicted one, a true alpha, or a
    /// seen map (where there is a folder of them).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// What was there but could not be scored, and why. In a run's report it is among that one's notes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// Compares the plates of `pred_dir` with the true ones of `gt_dir`, view by view, inside the object
/// (`region_alpha_dir`, alpha >= 0.5) where the grey value of `seen_dir`, the number of views that saw
/// the pixel's background, is at least `min_seen`. Without `seen_dir`, all pixels count as seen.
///
/// Files belong together as in [`compare_folders`](crate::compare_folders), and masks that hold the labels 0 and 1 are
/// read as black and white as there, which is noted.
///
/// # Errors
/// When a folder or a picture cannot be read, a folder has no picture or none that belongs to a true plate, it is not
/// clear which do, a region is a photo, or sizes differ.
pub fn compare_plates(
    pred_dir: &Path,
    gt_dir: &Path,
    region_alpha_dir: &Path,
    seen_dir: Option<&Path>,
    min_seen: u8,
) -> Result<PlateScore, EvalError> {
    let truth = list_pictures(gt_dir)?;
    let pred = match_views(gt_dir, &truth.pictures, pred_dir)?;
    let regions = match_views(gt_dir, &truth.pictures, region_alpha_dir)?;
    let seen = seen_dir
        .map(|dir| match_views(gt_dir, &truth.pictures, dir))
        .transpose()?;
    // By all mattes, as for their own scores: those of a few views may all be dark.
    let mattes = Mattes::of(region_alpha_dir, &list_pictures(region_alpha_dir)?.pictures)?;
    let mut notes = left_out([&truth, &pred, &regions].into_iter().chain(&seen));
    notes.extend(mattes.note());
    let [truth, pred, regions] = [truth, pred, regions].map(|listing| listing.pictures);
    let seen = seen.map(|listing| listing.pictures);
    let sums = truth
        .par_iter()
        .filter_map(|(name, path)| {
            let (pred, region) = (pred.get(name)?, regions.get(name)?);
            let seen = match &seen {
                Some(seen) => Some(seen.get(name)?.as_path()),
                None => None,
            };
            Some(score_view(pred, path, (region, &mattes), seen, min_seen))
        })
        .collect::<Result<Vec<_>, EvalError>>()?;
    let mut missing = unmatched(&truth, &pred);
    missing.extend(unmatched(&truth, &regions));
    missing.extend(seen.iter().flat_map(|seen| unmatched(&truth, seen)));
    missing.sort();
    missing.dedup();
    let pixels =
        |region: fn(&[Sums; 3]) -> &Sums| sums.iter().map(|s| region(s).pixels).sum::<usize>();
    let object_pixels = pixels(|s| &s[1]);
    Ok(PlateScore {
        seen: quality(sums.iter().map(|s| &s[0])),
        object: quality(sums.iter().map(|s| &s[1])),
        whole: quality(sums.iter().map(|s| &s[2])),
        seen_share: if object_pixels == 0 {
            1.0
        } else {
            pixels(|s| &s[0]) as f64 / object_pixels as f64
        },
        min_seen,
        truth: gt_dir
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default(),
        missing,
        notes,
    })
}

/// What one region of one view adds.
struct Sums {
    squared: f64,
    /// Mean SSIM of the region.
    ssim: f64,
    pixels: usize,
}

/// Sums over the seen part of the object, the object, and the picture.
fn score_view(
    pred: &Path,
    truth: &Path,
    (region, mattes): (&Path, &Mattes<'_>),
    seen: Option<&Path>,
    min_seen: u8,
) -> Result<[Sums; 3], EvalError> {
    let (plate, true_plate, alpha) = (read_rgb(pred)?, read_rgb(truth)?, mattes.read(region)?);
    check_size(pred, &plate, truth, &true_plate)?;
    check_size(region, &alpha, truth, &true_plate)?;
    let object = alpha.mask(MASK_THRESHOLD);
    let mut recoverable = object.clone();
    if let Some(path) = seen {
        let seen = read_counts_at_least(path, min_seen)?;
        check_size(path, &seen, truth, &true_plate)?;
        recoverable
            .inside
            .iter_mut()
            .zip(&seen.inside)
            .for_each(|(inside, seen)| *inside &= seen);
    }
    let ssim = ssim_map(&plate, &true_plate);
    let (squared, pixels) = squared_error(&plate, &true_plate, None);
    Ok([
        sums_in(&plate, &true_plate, &ssim, &recoverable),
        sums_in(&plate, &true_plate, &ssim, &object),
        Sums {
            squared,
            ssim: whole_mean(&ssim),
            pixels,
        },
    ])
}

fn sums_in(plate: &RgbPlane, truth: &RgbPlane, ssim: &Plane, region: &Mask) -> Sums {
    let (squared, pixels) = squared_error(plate, truth, Some(region));
    let (ssim, _) = sum_in(ssim, region);
    Sums {
        squared,
        ssim: ssim / pixels.max(1) as f64,
        pixels,
    }
}

fn quality<'a>(views: impl Iterator<Item = &'a Sums>) -> Option<Quality> {
    let mse = |squared: f64, pixels: usize| squared / (3 * pixels) as f64;
    let (mut psnr, mut ssim, mut ssim_pooled, mut squared) = (0.0, 0.0, 0.0, 0.0);
    let (mut n, mut pixels) = (0_usize, 0_usize);
    for view in views.filter(|view| view.pixels > 0) {
        psnr += psnr_of_mse(mse(view.squared, view.pixels));
        ssim += view.ssim;
        ssim_pooled += view.ssim * view.pixels as f64;
        squared += view.squared;
        pixels += view.pixels;
        n += 1;
    }
    (n > 0).then(|| Quality {
        psnr: psnr / n as f64,
        ssim: ssim / n as f64,
        psnr_pooled: psnr_of_mse(mse(squared, pixels)),
        ssim_pooled: ssim_pooled / pixels as f64,
        views: n,
    })
}
