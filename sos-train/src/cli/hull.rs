//! `sos hull`: the classical answer, to be measured against.

use super::{HullArgs, answer};
use crate::config::{Preset, TrainConfig};
use crate::error::InputError;
use crate::export::check_names;
use crate::prepare::view::load_views;
use crate::prepare::{outline, prepare};
use crate::run_folder::{RunError, view_file};
use io_colmap::{MaskSet, Scene};
use rayon::prelude::*;
use std::fs;

/// Share of masks at which the matte is 0.5, and the span over which it rises from 0 to 1. Nearly all
/// must agree: a hull of half of them is fat.
const MIDDLE: f32 = 0.85;
const SOFTNESS: f32 = 0.2;

/// Writes mattes of what all masks agree on: the largest share of them that takes a point of the
/// pixel's ray for the object's, as a soft step.
///
/// Masks that contradict the others are left out, as in training.
pub(super) fn write(args: &HullArgs) -> anyhow::Result<()> {
    if args.out.exists() {
        return Err(InputError::new(&args.out, "it exists already", "choose another --out").into());
    }
    let scene = Scene::open(&args.scene)?;
    check_names(scene.model.views.iter().map(|view| view.name.as_str()))?;
    let masks = MaskSet::find(&args.masks, &scene, args.polarity.map(Into::into))?;
    let config = TrainConfig::preset(Preset::Default);
    let views = load_views(&scene, Some(&masks))?;
    let data = prepare(
        views,
        &scene.model.points,
        &config.prepare,
        config.loss.ignore_band,
    )?;
    // Beside its place first: no half of it is ever taken for the whole.
    let fresh = args.out.with_extension("part");
    let failed = |action, path: &std::path::Path, source| RunError::Io {
        action,
        path: path.to_path_buf(),
        source,
    };
    fs::create_dir_all(&fresh).map_err(|e| failed("create", &fresh, e))?;
    data.views.par_iter().try_for_each(|view| {
        let path = view_file(&fresh, &view.name, "png");
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| failed("create", folder, e))?;
        }
        let mut hull = outline::silhouette(view, &data.frame, &data.map, 1);
        for pixel in hull.pixels_mut() {
            let share = f32::from(pixel.0[0]) / 255.0;
            let matte = ((share - MIDDLE) / SOFTNESS + 0.5).clamp(0.0, 1.0);
            pixel.0[0] = (255.0 * matte).round() as u8;
        }
        let written = hull.save(&path).map_err(std::io::Error::other);
        written.map_err(|e| failed("write", &path, e))
    })?;
    fs::rename(&fresh, &args.out).map_err(|e| failed("write", &args.out, e))?;
    answer(&format!(
        "{}: the masks' visual hull, seen from {} views",
        args.out.display(),
        data.views.len()
    ));
    Ok(())
}
