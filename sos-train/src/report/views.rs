//! The pictures of every view.

use super::thumbnail::{self, Thumbnail};
use super::{ReportError, ReportInputs};
use crate::run_folder::{RunFolder, view_file};
use image::{DynamicImage, GrayImage};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Widths of thumbnails in pixels: for few views, and for so many that the page would be heavy.
const WIDE: u32 = 480;
const NARROW: u32 = 360;
const MANY_VIEWS: usize = 40;

/// A row of the page.
#[derive(Debug)]
pub(super) struct Row {
    /// The photo's name.
    pub(super) name: String,
    /// The name scores go by.
    pub(super) stem: String,
    /// In the order of the columns; `None` where there is no picture.
    pub(super) cells: Vec<Option<Cell>>,
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
    let mut columns = vec!["photo", "coarse mask", "alpha", "cut-out", "plate"];
    if inputs.masks.is_none() {
        columns.remove(1);
    }
    if inputs.reference.is_some() {
        columns.insert(columns.len() - 2, "reference alpha");
    }
    columns
}

/// Makes all thumbnails.
pub(super) fn rows(run: &RunFolder, inputs: &ReportInputs) -> Result<Vec<Row>, ReportError> {
    let views = &inputs.scene.model.views;
    let width = if views.len() > MANY_VIEWS {
        NARROW
    } else {
        WIDE
    };
    (0..views.len())
        .into_par_iter()
        .map(|index| row(run, inputs, index, width))
        .collect()
}

fn row(
    run: &RunFolder,
    inputs: &ReportInputs,
    index: usize,
    width: u32,
) -> Result<Row, ReportError> {
    let view = &inputs.scene.model.views[index];
    let photo = inputs.scene.read_photo(view)?;
    let (w, h) = (photo.width(), photo.height());
    let own = |dir: PathBuf, small: fn(&DynamicImage, u32) -> Thumbnail| {
        own_picture(run, &dir, &view.name, |picture| small(picture, width))
    };
    let grey: fn(&DynamicImage, u32) -> Thumbnail =
        |picture, width| thumbnail::matte(&picture.to_luma8(), width);

    let mut cells = vec![Some(Cell {
        picture: thumbnail::photo(&photo, width),
        file: None,
    })];
    drop(photo);
    if let Some(masks) = &inputs.masks {
        let mask: Option<GrayImage> = masks.load(index, w, h)?;
        cells.push(mask.map(|mask| Cell {
            picture: thumbnail::matte(&mask, width),
            file: None,
        }));
    }
    cells.push(own(run.alpha_dir(), grey)?);
    if let Some(dir) = &inputs.reference {
        cells.push(match reference(dir, &view.name) {
            Some(path) => Some(Cell {
                picture: thumbnail::matte(&matte_of(&thumbnail::open(&path)?), width),
                file: None,
            }),
            None => None,
        });
    }
    cells.push(own(run.foreground_dir(), thumbnail::cut_out)?);
    cells.push(own(run.background_dir(), thumbnail::photo)?);
    Ok(Row {
        name: view.name.clone(),
        stem: view_file(Path::new(""), &view.name, "png")
            .with_extension("")
            .display()
            .to_string(),
        cells,
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
    let file = path.strip_prefix(run.root()).ok().map(|below| {
        below
            .components()
            .map(|part| part.as_os_str().to_string_lossy().into_owned())
            .collect::<Vec<_>>()
            .join("/")
    });
    Ok(Some(Cell {
        picture: small(&thumbnail::open(&path)?),
        file,
    }))
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
pub(super) fn matte_of(picture: &DynamicImage) -> GrayImage {
    if !picture.color().has_alpha() {
        return picture.to_luma8();
    }
    let rgba = picture.to_rgba8();
    GrayImage::from_fn(rgba.width(), rgba.height(), |x, y| {
        image::Luma([rgba.get_pixel(x, y).0[3]])
    })
}
