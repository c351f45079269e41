//! `sos hull`: the classical answer, to be measured against.

use super::HullArgs;
use super::answer::Voice;
use super::input::{NO_MASKS, check_free};
use crate::config::{MaskPolarity, Preset, TrainConfig};
use crate::error::InputError;
use crate::export::check_names;
use crate::prepare::view::load_views;
use crate::prepare::{outline, prepare};
use crate::run_folder::{RunError, view_file, write_folder};
use image::GrayImage;
use io_colmap::{ColmapError, MaskSet, Scene, write_png};
use rayon::prelude::*;
use serde_json::json;
use std::fs;
use std::path::Path;

/// Share of masks at which the matte is 0.5, and the span over which it rises from 0 to 1. Nearly all
/// must agree: a hull of half of them is fat.
const MIDDLE: f32 = 0.85;
const SOFTNESS: f32 = 0.2;

/// Writes mattes of what all masks agree on: the largest share of them that takes a point of the
/// pixel's ray for the object's, as a soft step.
///
/// Masks that contradict the others are left out, as in training.
pub(super) fn write(args: &HullArgs) -> anyhow::Result<()> {
    check_free(&args.out)?;
    if args.masks.as_os_str() == NO_MASKS {
        let remedy = "give the folder of rough masks with --masks";
        return Err(InputError::new(&args.scene, "a hull is made of masks", remedy).into());
    }
    let views = write_hull(&args.scene, &args.masks, args.polarity, &args.out)?;
    let result = json!({ "folder": args.out, "mattes": views });
    let sentence = format!(
        "{}: the masks' visual hull, seen from {views} views",
        args.out.display(),
    );
    Voice::of(args.json, false).answer(&result, &sentence)
}

/// Writes the mattes into `out`, which does not exist yet or is empty, and says how many.
pub(super) fn write_hull(
    scene: &Path,
    masks: &Path,
    polarity: Option<MaskPolarity>,
    out: &Path,
) -> anyhow::Result<usize> {
    let scene = Scene::open(scene)?;
    let names = scene.model.views.iter().map(|view| view.name.as_str());
    check_names(&scene.root, names)?;
    let masks = MaskSet::find(masks, &scene, polarity.map(Into::into))?;
    let config = TrainConfig::preset(Preset::Default);
    let views = load_views(&scene, Some(&masks))?;
    let data = prepare(
        views,
        &scene.model.points,
        &config.prepare,
        config.loss.ignore_band,
    )?;
    write_mattes(out, data.views.len(), |index| {
        let view = &data.views[index];
        let mut hull = outline::silhouette(view, &data.frame, &data.map, 1);
        for pixel in hull.pixels_mut() {
            let share = f32::from(pixel.0[0]) / 255.0;
            let matte = ((share - MIDDLE) / SOFTNESS + 0.5).clamp(0.0, 1.0);
            pixel.0[0] = (255.0 * matte).round() as u8;
        }
        Some((view.name.as_str(), hull))
    })
}

/// Writes masks as they were given, white for the object, as mattes into `out`, which does not exist
/// yet or is empty; photos without one have none. Says how many.
pub(super) fn write_masks(
    scene: &Path,
    masks: &Path,
    polarity: Option<MaskPolarity>,
    out: &Path,
) -> anyhow::Result<usize> {
    let scene = Scene::open(scene)?;
    let names = scene.model.views.iter().map(|view| view.name.as_str());
    check_names(&scene.root, names)?;
    let masks = MaskSet::find(masks, &scene, polarity.map(Into::into))?;
    let views = &scene.model.views;
    let pictures = views.par_iter().enumerate().map(|(i, view)| {
        let photo = scene.read_photo(view)?;
        masks.load(i, photo.width(), photo.height())
    });
    let pictures = pictures.collect::<Result<Vec<_>, ColmapError>>()?;
    write_mattes(out, views.len(), |index| {
        Some((views[index].name.as_str(), pictures[index].clone()?))
    })
}

/// Writes those of `count` mattes that there are, each with its photo's name.
fn write_mattes<'a>(
    out: &Path,
    count: usize,
    matte: impl Fn(usize) -> Option<(&'a str, GrayImage)> + Sync,
) -> anyhow::Result<usize> {
    let write_one = |fresh: &Path, index: usize| {
        let Some((name, picture)) = matte(index) else {
            return Ok(0);
        };
        let path = view_file(fresh, name, "png");
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| RunError::outside("create", folder, e))?;
        }
        write_png(&picture, &path)?;
        Ok(1)
    };
    write_folder(out, |fresh| {
        let indices = (0..count).into_par_iter();
        indices.map(|index| write_one(fresh, index)).sum()
    })
}
