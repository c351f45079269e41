//! Photos that show the object, though no mask of theirs says so.
//!
//! Where few photos were taken, BaCo explains one of them by a flake before its camera, painted like the object, and no other view
//! contradicts it. A mask would. Where none is believed colours do: what FoCoR has behind the flake, as other photos show it, is what this photo
//! shows. What does stand before the object has other colours.

use glam::Vec2;
use neus_render::rays::Ray;
use rayon::prelude::*;

use super::Trainer;
use super::carve::openings::neighbours;
use crate::prepare::spans::PixelSpans;
use crate::prepare::{Label, Prepared};
use crate::render::rays::{FrozenScene, RenderedRay};

/// Looks are this share of the run apart.
const EVERY: f32 = 0.1;
/// Rays that are looked along each time, in all views together.
const RAYS: f32 = 20_000.0;
/// How opaque FoCoR has to be.
const FILLED: f32 = 0.95;
/// Colours that differ by less are alike: root mean square over the channels, sRGB.
const ALIKE: f32 = 0.1;

impl Trainer {
    /// Now and then notes, in views without a mask that is believed, which pixels have the object's colours: there nothing is to hide
    /// it.
    pub fn find_alike(&mut self, data: &mut Prepared) {
        let period = (EVERY * self.config().steps as f32) as u32;
        if !self.may_clear() || !self.step.is_multiple_of(period.max(1)) {
            return;
        }
        let all = 0..data.outlines.len();
        let unmasked: Vec<usize> = all
            .filter(|&view| !data.outlines[view].is_masked())
            .collect();
        let pixels = |view: &usize| data.outlines[*view].candidates.len();
        let pixels: usize = unmasked.iter().map(pixels).sum();
        if pixels == 0 {
            return;
        }
        let stride = (pixels as f32 / RAYS).sqrt().ceil().max(1.0) as u32;
        let scene = self.freeze();
        let mut found = vec![PixelSpans::default(); data.outlines.len()];
        for view in unmasked {
            found[view] = alike_in(&scene, data, view, stride);
        }
        let alike = &mut self.mask_faults.alike;
        alike.resize(found.len(), PixelSpans::default());
        let views = data.outlines.par_iter_mut().zip(&mut *alike).zip(&found);
        views.for_each(|((outline, alike), found)| {
            outline.mark_alike(found);
            *alike = alike.united(found);
        });
        // Batches that were gathered before know nothing of it.
        self.ahead.forget();
    }
}

/// The pixels of a view that have the object's colours, as have those around them, on a raster `stride` pixels apart.
fn alike_in(scene: &FrozenScene, data: &Prepared, number: usize, stride: u32) -> PixelSpans {
    let (view, outline) = (&data.views[number], &data.outlines[number]);
    let (width, height) = (view.width(), view.height());
    let (columns, rows) = (width.div_ceil(stride), height.div_ceil(stride));
    let world_from_camera = view.world_from_camera(&data.frame);
    let middle = |i: u32, size: u32| (i * stride + stride / 2).min(size - 1);
    let asked: Vec<(usize, [u8; 3], Ray)> = (0..columns * rows)
        .filter_map(|i| {
            let (x, y) = (middle(i % columns, width), middle(i / columns, height));
            if outline.label(x, y) != Label::DoubtfulObject || view.ignores(x, y) {
                return None;
            }
            let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let ray = view.ray(&world_from_camera, centre)?;
            Some((i as usize, view.photo.get_pixel(x, y).0, ray))
        })
        .collect();
    let rays: Vec<Ray> = asked.iter().map(|(_, _, ray)| *ray).collect();
    let mut alike = vec![false; (columns * rows) as usize];
    for ((i, colour, _), met) in asked.iter().zip(scene.objects(&rays)) {
        alike[*i] = is_alike(&met, *colour);
    }
    let well_inside: Vec<bool> = (0..alike.len())
        .map(|i| {
            let mut around = neighbours(i, columns as usize, alike.len());
            alike[i] && around.all(|j| j.is_none_or(|j| alike[j]))
        })
        .collect();
    let mut pixels = PixelSpans::default();
    for pixel in 0..width * height {
        let (x, y) = (pixel % width / stride, pixel / width / stride);
        if well_inside[(y * columns + x) as usize] {
            pixels.push(pixel);
        }
    }
    pixels
}

/// Whether a photo's colour is the one that a ray met of the object, and it met it.
fn is_alike(met: &RenderedRay, colour: [u8; 3]) -> bool {
    let photo = glam::Vec3::from(colour.map(|value| f32::from(value) / 255.0));
    let off = (met.object - photo).length() / 3.0_f32.sqrt();
    met.matte >= FILLED && off < ALIKE
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::prepare::Shown;
    use crate::train::tiny;

    #[test]
    fn a_photo_without_a_mask_shows_the_object_where_it_has_its_colours() {
        let config = tiny::config();
        let mut data = tiny::prepared(&config, &[0]);
        let mut trainer = Trainer::new(&config, &data).unwrap();
        // The photo is what FoCoR looks like, its right half in other colours.
        let view = &data.views[0];
        let (width, height) = (view.width(), view.height());
        let pose = view.world_from_camera(&data.frame);
        let scene = trainer.freeze();
        let photo = RgbImage::from_fn(width, height, |x, y| {
            let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let met = scene.objects(&[view.ray(&pose, centre).unwrap()])[0];
            let other = if x < width / 2 { 0.0 } else { 0.3 };
            Rgb(met
                .object
                .to_array()
                .map(|v| (255.0 * (v - other).abs()) as u8))
        });
        data.views[0].photo = view.store.keep_photo(photo).unwrap();
        trainer.find_alike(&mut data);
        let shown = |data: &Prepared| -> Vec<u32> {
            let pixels = 0..width * height;
            let by_colour = |i: &u32| {
                let shown = data.outlines[0].shown(i % width, i / width);
                shown == Shown::ByColour
            };
            pixels.filter(by_colour).collect()
        };
        let found = shown(&data);
        assert!(found.len() > 20, "{} pixels", found.len());
        assert!(found.iter().all(|i| i % width < width / 2), "{found:?}");

        // A run that goes on knows them.
        let mut again = tiny::prepared(&config, &[0]);
        assert!(shown(&again).is_empty());
        let (faults, band) = (trainer.mask_faults(), config.loss.ignore_band);
        again.correct_masks(faults, &config.prepare, band).unwrap();
        assert_eq!(shown(&again), found);
    }
}
