//! Masks that a run found for its photos, in its folder.

use anyhow::Result;
use image::imageops::{FilterType, resize};

use crate::export::write_found_mask;
use crate::prepare::TrainView;
use crate::prepare::mask::Mask;
use crate::run_folder::RunFolder;

/// Gives the views that have no mask the one that was `found` for each, and writes all at the photos' `sizes`, which masks
/// are compared and read at. What is trained on is what a run that goes on makes of these files.
pub(super) fn keep(
    run: &RunFolder,
    views: &mut [TrainView],
    sizes: &[(u32, u32)],
    found: &[Mask],
) -> Result<()> {
    for ((view, found), &(width, height)) in views.iter_mut().zip(found).zip(sizes) {
        let mask = view.mask.as_ref().unwrap_or(found);
        let picture = resize(&mask.picture(), width, height, FilterType::Nearest);
        write_found_mask(run, &view.name, &picture)?;
        view.mask = Some(view.fitting(&picture)?);
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::DVec3;
    use image::{GrayImage, Luma};

    use super::*;
    use crate::prepare::balls;
    use crate::run_folder::{Existing, view_file};

    #[test]
    fn masks_have_the_size_of_photos_and_come_back_as_they_are_trained_on() {
        let dir = tempfile::tempdir().unwrap();
        let run = RunFolder::create(&dir.path().join("run"), Existing::Keep).unwrap();
        let photo = balls::view(DVec3::new(0.0, 0.0, 3.0), DVec3::NEG_Z);
        let (width, height) = (photo.width(), photo.height());
        for factor in [1, 3] {
            let mut views = [photo.downscaled(factor).unwrap()];
            views[0].mask = None;
            let drawn = GrayImage::from_fn(views[0].width(), views[0].height(), |x, y| {
                let (x, y) = (factor * x, factor * y);
                Luma([if x * x + 30 * y < 900 { 255 } else { 0 }])
            });
            let found = Mask::of_white(&drawn, &views[0].store).unwrap();
            keep(&run, &mut views, &[(width, height)], &[found]).unwrap();
            let file = view_file(&run.found_masks_dir(), &photo.name, "png");
            let read = image::open(file).unwrap().to_luma8();
            assert_eq!(read.dimensions(), (width, height));
            let again = photo.clone().with_mask(&read).unwrap();
            let again = again.downscaled(factor).unwrap();
            let [now, again] = [&views[0], &again].map(|view| view.mask.as_ref().unwrap());
            assert_eq!(now.picture(), again.picture());
            let area = drawn.iter().filter(|value| **value > 0).count();
            assert!(area > 20 && 2 * area < drawn.len());
            assert!(now.area().abs_diff(area) * 10 < area);
        }
    }
}
