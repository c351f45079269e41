//! The pictures of every view.

use super::thumbnail::{self, Thumbnail};
use super::{ReportError, ReportInputs};
use crate::run_folder::{RunFolder, view_file};
use image::{DynamicImage, GrayImage};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Pixels of one thumbnail, at most and at least: shared out among the views, so that the page of a
/// hundred views is not ten times as heavy as that of ten.
const ROOM: std::ops::RangeInclusive<usize> = 16_000..=150_000;
/// Pixels of the thumbnails of one column together.
const ROOM_IN_ALL: usize = 6_000_000;
/// Views whose start mask is shown beside what became of it.
const AUDITED: usize = 12;
/// From this overlap on, mask and matte differ by their edges alone, which needs no picture.
const SAME: f64 = 0.97;

/// A row of the page.
#[derive(Debug)]
pub(super) struct Row {
    /// The photo's name.
    pub(super) name: String,
    /// The name scores go by.
    pub(super) stem: String,
    /// In the order of the columns; `None` where there is no picture.
    pub(super) cells: Vec<Option<Cell>>,
    /// What the run changed about the start mask, for the views in which that is most.
    pub(super) change: Option<Thumbnail>,
}

/// A picture of a row.
#[derive(Debug)]
pub(super) struct Cell {
    pub(super) picture: Thumbnail,
    /// The file at full size, relative to the page.
    pub(super) file: Option<String>,
}

/// Captions of the columns.
pub(super) fn columns(inputs: &ReportInputs) -> Vec<&'static str> {
    let mut columns = vec!["photo"];
    if inputs.masks.is_some() {
        columns.push("coarse mask");
    }
    columns.push("alpha");
    if inputs.reference.is_some() {
        columns.push("reference alpha");
    }
    columns.extend(["cut-out", "plate"]);
    if inputs.audit.is_some() {
        columns.push("uncertainty");
    }
    columns
}

/// Numbers of the views whose matte differs most from the start mask, worst first.
pub(super) fn most_changed(inputs: &ReportInputs) -> Vec<usize> {
    let Some(audit) = &inputs.audit else {
        return Vec::new();
    };
    let views = &inputs.scene.model.views;
    let mut ranked: Vec<(usize, f64)> = views
        .iter()
        .enumerate()
        .filter_map(|(i, view)| Some((i, audit.view(&view.name)?.mask_iou?)))
        .filter(|(_, iou)| *iou < SAME)
        .collect();
    ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
    ranked.truncate(AUDITED);
    ranked.into_iter().map(|(i, _)| i).collect()
}

/// Makes all thumbnails.
pub(super) fn rows(run: &RunFolder, inputs: &ReportInputs) -> Result<Vec<Row>, ReportError> {
    let count = inputs.scene.model.views.len();
    let room = (ROOM_IN_ALL / count.max(1)).clamp(*ROOM.start(), *ROOM.end()) as u32;
    let changed = most_changed(inputs);
    (0..count)
        .into_par_iter()
        .map(|index| row(run, inputs, index, room, changed.contains(&index)))
        .collect()
}

fn row(
    run: &RunFolder,
    inputs: &ReportInputs,
    index: usize,
    room: u32,
    changed: bool,
) -> Result<Row, ReportError> {
    let view = &inputs.scene.model.views[index];
    let photo = inputs.scene.read_photo(view)?;
    let (w, h) = (photo.width(), photo.height());
    let own = |dir: PathBuf, small: fn(&DynamicImage, u32) -> Thumbnail| {
        own_picture(run, &dir, &view.name, |picture| small(picture, room))
    };
    let grey: fn(&DynamicImage, u32) -> Thumbnail =
        |picture, room| thumbnail::matte(&picture.to_luma8(), room);

    let mut cells = vec![Some(Cell {
        picture: thumbnail::photo(&photo, room),
        file: below(run, &inputs.scene.image_path(view)),
    })];
    let mut change = None;
    if let Some(masks) = &inputs.masks {
        let mask: Option<GrayImage> = masks.load(index, w, h)?;
        if let (true, Some(mask)) = (changed, &mask) {
            let matte = thumbnail::open(&view_file(&run.alpha_dir(), &view.name, "png"))?;
            let (photo, matte) = (photo.to_rgb8(), matte.to_luma8());
            change = Some(thumbnail::change(&photo, mask, &matte, room));
        }
        cells.push(mask.map(|mask| Cell {
            picture: thumbnail::matte(&mask, room),
            file: None,
        }));
    }
    drop(photo);
    cells.push(own(run.alpha_dir(), grey)?);
    if let Some(dir) = &inputs.reference {
        cells.push(match reference(dir, &view.name) {
            Some(path) => Some(Cell {
                picture: thumbnail::matte(&matte_of(&thumbnail::open(&path)?), room),
                file: None,
            }),
            None => None,
        });
    }
    cells.push(own(run.foreground_dir(), thumbnail::cut_out)?);
    cells.push(own(run.background_dir(), thumbnail::photo)?);
    if inputs.audit.is_some() {
        cells.push(own(run.uncertainty_dir(), |picture, room| {
            thumbnail::heat(&picture.to_luma8(), room)
        })?);
    }
    Ok(Row {
        name: view.name.clone(),
        stem: view_file(Path::new(""), &view.name, "png")
            .with_extension("")
            .display()
            .to_string(),
        cells,
        change,
    })
}

/// A picture that the run wrote; `None` if it did not.
fn own_picture(
    run: &RunFolder,
    dir: &Path,
    photo: &str,
    small: impl FnOnce(&DynamicImage) -> Thumbnail,
) -> Result<Option<Cell>, ReportError> {
    let path = view_file(dir, photo, "png");
    if !path.is_file() {
        return Ok(None);
    }
    Ok(Some(Cell {
        picture: small(&thumbnail::open(&path)?),
        file: below(run, &path),
    }))
}

/// A file's path as seen from the page; `None` if it does not lie in the run's folder.
fn below(run: &RunFolder, path: &Path) -> Option<String> {
    let below = path.strip_prefix(run.root()).ok()?;
    let parts = below.components();
    let parts = parts.map(|part| part.as_os_str().to_string_lossy().into_owned());
    Some(parts.collect::<Vec<_>>().join("/"))
}

/// A reference has the photo's stem, with or without its sub-folders, and one of the usual endings.
fn reference(dir: &Path, photo: &str) -> Option<PathBuf> {
    let base = photo.rsplit(['/', '\\']).next().unwrap_or(photo);
    [photo, base]
        .into_iter()
        .flat_map(|name| ["png", "jpg", "jpeg"].map(|ending| view_file(dir, name, ending)))
        .find(|path| path.is_file())
}

/// Reference mattes come as grey pictures, or as the alpha of a cut-out.
fn matte_of(picture: &DynamicImage) -> GrayImage {
    if !picture.color().has_alpha() {
        return picture.to_luma8();
    }
    let rgba = picture.to_rgba8();
    GrayImage::from_fn(rgba.width(), rgba.height(), |x, y| {
        image::Luma([rgba.get_pixel(x, y).0[3]])
    })
}
