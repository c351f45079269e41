//! Photos that show the object, as its colours say.
//!
//! BaCo may explain some photos by a flake before their cameras, painted like the object, and no other view contradicts it: where few
//! photos were taken, or where most of a room contradicts itself, as behind a turntable. Colours do: what FoCoR has behind the flake is
//! what the photo shows. What does stand before the object has other colours, unless all is dark: so they have to be the object's rather
//! than what is around it, and other views have to show that very place of FoCoR. A skirt of it below a table is hidden from nearly all.

use glam::{Affine3A, Vec2, Vec3};
use neus_render::rays::Ray;
use rayon::prelude::*;

use super::Trainer;
use crate::cells::{opened, well_inside};
use crate::likelihood::Colours;
use crate::prepare::outline::Outline;
use crate::prepare::spans::PixelSpans;
use crate::prepare::{Prepared, TrainView};
use crate::render::rays::{FrozenScene, RenderedRay};
use crate::squares::Squares;

/// Looks are this share of the run apart.
const EVERY: f32 = 0.1;
/// Rays that are looked along each time, at most, to find where FoCoR is hidden, in all views together.
const RAYS: f32 = 20_000.0;
/// How many times as close they are where it is.
const CLOSER: u32 = 4;
/// Less than this is seen of it there.
const HIDDEN: f32 = 0.5;
/// How opaque FoCoR has to be by itself.
const FILLED: f32 = 0.95;
/// Views that are asked whether they show a place, and the fewest that have to.
const WITNESSES: usize = 16;
const LEAST_WITNESSES: usize = 2;
/// How far what a witness shows may be from the place, in the normalised frame.
const SAME_PLACE: f32 = 0.03;
/// Colours that differ by less are alike: root mean square over the channels, sRGB.
const ALIKE: f32 = 0.1;
/// How likely a colour has to be the object's rather than of what is around it.
const TELLING: f32 = 0.5;

impl Trainer {
    /// Now and then notes which pixels have the object's colours: there nothing is to hide it.
    pub fn find_alike(&mut self, data: &mut Prepared) {
        let period = (EVERY * self.config().steps as f32) as u32;
        if !self.may_clear() || !self.step.is_multiple_of(period.max(1)) {
            return;
        }
        let pixels: usize = data.outlines.iter().map(|o| o.candidates.len()).sum();
        let stride = (pixels as f32 / RAYS).sqrt().ceil() as u32;
        let scene = self.freeze();
        let views = (0..data.views.len()).into_par_iter();
        let glances: Vec<Glance> = (views.clone())
            .map(|view| Glance::at(&Viewpoint::at(data, view), &scene, stride))
            .collect();
        let colours = Colours::new(glances.iter().flat_map(|glance| &glance.known).copied());
        let found: Vec<PixelSpans> = (views.zip(&glances))
            .map(|(view, glance)| {
                let shown = |places: &[Vec3]| are_shown(&scene, data, view, places);
                hidden_alike(&scene, data, view, glance, &colours, shown)
            })
            .collect();
        if found.iter().all(PixelSpans::is_empty) {
            return;
        }
        self.note_alike(data, &found);
        // Batches that were gathered before know nothing of it.
        self.ahead.forget();
    }

    /// Marks pixels of each view as the object's by their colours, and keeps them for a run that goes on.
    fn note_alike(&mut self, data: &mut Prepared, found: &[PixelSpans]) {
        let alike = &mut self.mask_faults.alike;
        alike.resize(found.len(), PixelSpans::default());
        let views = data.outlines.par_iter_mut().zip(alike).zip(found);
        views.for_each(|((outline, alike), found)| {
            outline.mark_alike(found);
            alike.clone_from(&outline.alike);
        });
    }
}

/// A view, and what is asked of it.
struct Viewpoint<'a> {
    view: &'a TrainView,
    outline: &'a Outline,
    world_from_camera: Affine3A,
}

impl<'a> Viewpoint<'a> {
    fn at(data: &'a Prepared, number: usize) -> Self {
        let view = &data.views[number];
        Self {
            view,
            outline: &data.outlines[number],
            world_from_camera: view.world_from_camera(&data.frame),
        }
    }

    fn squares(&self, side: u32) -> Squares {
        Squares::of_side(self.view.width(), self.view.height(), side)
    }

    /// In `[0, 1]`.
    fn colour(&self, (x, y): (u32, u32)) -> Vec3 {
        let colour = self.view.photo.get_pixel(x, y).0;
        Vec3::from(colour.map(|value| f32::from(value) / 255.0))
    }

    fn is_expected(&self, (x, y): (u32, u32)) -> bool {
        self.outline.is_expected(x, y)
    }

    /// The numbers of squares whose middles are `among` those asked for, with the rays through them.
    fn rays(
        &self,
        squares: &Squares,
        among: impl Fn((u32, u32)) -> bool,
    ) -> (Vec<usize>, Vec<Ray>) {
        let rays = (0..squares.len()).filter_map(|i| {
            let (x, y) = squares.middle(i);
            if self.view.ignores(x, y) || !among((x, y)) {
                return None;
            }
            let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            Some((i, self.view.ray(&self.world_from_camera, centre)?))
        });
        rays.unzip()
    }

    /// Those of some places that lie within the picture, with the rays to them.
    fn rays_to(&self, places: &[Vec3], data: &Prepared) -> (Vec<usize>, Vec<Ray>) {
        let within = places.iter().enumerate().filter_map(|(i, place)| {
            let world = data.frame.world_from_normalised(*place);
            let (pixel, _) = self.view.project(world)?;
            Some((i, self.view.ray(&self.world_from_camera, pixel)?))
        });
        within.unzip()
    }
}

/// What is to be seen of FoCoR in a view, here and there.
struct Glance {
    squares: Squares,
    /// The squares where it is seen, or is not expected.
    clear: Vec<bool>,
    /// Colours of the photo, with how much of each is around the object, and its own.
    known: Vec<(Vec3, [f32; 2])>,
}

impl Glance {
    fn at(viewpoint: &Viewpoint<'_>, scene: &FrozenScene, stride: u32) -> Self {
        let squares = viewpoint.squares(stride);
        let (numbers, rays) = viewpoint.rays(&squares, |_| true);
        let mut clear = vec![true; squares.len()];
        let mut known = Vec::with_capacity(numbers.len());
        for (i, matte) in numbers.into_iter().zip(scene.mattes(&rays)) {
            let pixel = squares.middle(i);
            clear[i] = matte >= HIDDEN || !viewpoint.is_expected(pixel);
            known.push((viewpoint.colour(pixel), [1.0 - matte, matte]));
        }
        Self {
            squares,
            clear,
            known,
        }
    }
}

/// The pixels of a view on which FoCoR is hidden though the photo has its colours, all around as well, where it is `shown` by others.
fn hidden_alike(
    scene: &FrozenScene,
    data: &Prepared,
    number: usize,
    glance: &Glance,
    colours: &Colours,
    shown: impl Fn(&[Vec3]) -> Vec<bool>,
) -> PixelSpans {
    if !glance.clear.contains(&false) {
        return PixelSpans::default();
    }
    let viewpoint = Viewpoint::at(data, number);
    let clear = well_inside(&glance.clear, glance.squares.columns as usize);
    let squares = glance.squares.closer(CLOSER);
    let (numbers, rays) = viewpoint.rays(&squares, |(x, y)| {
        viewpoint.is_expected((x, y)) && !clear[glance.squares.of(x, y)]
    });
    // By itself, as behind what hides it nobody asks for it.
    let objects = scene.objects(&rays);
    let mut alike = vec![false; squares.len()];
    for (&i, object) in numbers.iter().zip(&objects) {
        let colour = viewpoint.colour(squares.middle(i));
        alike[i] = is_alike(object, colour) && colours.object(colour).0 >= TELLING;
    }
    let alike = opened(&alike, squares.columns as usize);
    let (mut places, mut hidden) = (Vec::new(), Vec::new());
    let met = rays.iter().zip(&objects).zip(scene.mattes(&rays));
    for (&i, ((ray, object), matte)) in numbers.iter().zip(met) {
        if alike[i] && matte < HIDDEN {
            places.push(ray.at(object.object_distance));
            hidden.push(i);
        }
    }
    let mut found = vec![false; squares.len()];
    for (i, shown) in hidden.into_iter().zip(shown(&places)) {
        found[i] = shown;
    }
    squares.pixels(&found)
}

/// Whether some of the views other than `number` show FoCoR at each of these places.
fn are_shown(scene: &FrozenScene, data: &Prepared, number: usize, places: &[Vec3]) -> Vec<bool> {
    let all = data.views.len();
    let asked = WITNESSES.min(all - 1);
    let mut shown = vec![0; places.len()];
    for view in (0..asked).map(|k| (number + 1 + k * (all - 1) / asked) % all) {
        let witness = Viewpoint::at(data, view);
        let (asked, rays) = witness.rays_to(places, data);
        let met = scene.objects(&rays);
        for (((&i, ray), met), matte) in asked.iter().zip(&rays).zip(met).zip(scene.mattes(&rays)) {
            let off = (ray.at(met.object_distance) - places[i]).length();
            if met.matte >= HIDDEN && matte >= HIDDEN && off < SAME_PLACE {
                shown[i] += 1;
            }
        }
    }
    let shown = shown.into_iter();
    shown.map(|count| count >= LEAST_WITNESSES).collect()
}

/// Whether a photo's colour is the one that a ray met of the object, and it met it.
fn is_alike(met: &RenderedRay, photo: Vec3) -> bool {
    let off = (met.object - photo).length() / 3.0_f32.sqrt();
    met.matte >= FILLED && off < ALIKE
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use burn::Tensor;
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::config::TrainConfig;
    use crate::prepare::Shown;
    use crate::train::tiny;

    /// View 0 is what FoCoR looks like, its right half in other colours.
    fn paint(data: &mut Prepared, scene: &FrozenScene) {
        let view = &data.views[0];
        let (width, height) = (view.width(), view.height());
        let pose = view.world_from_camera(&data.frame);
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
    }

    /// The pixels of view 0 that show the object by their colours.
    fn shown(data: &Prepared) -> Vec<u32> {
        let (width, height) = (data.views[0].width(), data.views[0].height());
        let by_colour = |i: &u32| {
            let shown = data.outlines[0].shown(i % width, i / width);
            shown == Shown::ByColour
        };
        (0..width * height).filter(by_colour).collect()
    }

    /// FoCoR is a ball, and BaCo a haze, as at every start, or a fog that hides the ball from everybody.
    fn trainer(config: &TrainConfig, data: &Prepared, fog: bool) -> Trainer {
        let mut trainer = Trainer::new(config, data).unwrap();
        if fog {
            let last = &mut trainer.scene.background.sdf[1];
            let thicker = |bias: Tensor<1>| (bias - 4.0).detach().require_grad();
            last.bias = last.bias.clone().map(thicker);
        }
        trainer
    }

    #[test]
    fn colours_show_the_object_where_something_hides_it() {
        let config = tiny::config();
        for unmasked in [vec![0], vec![]] {
            let mut data = tiny::prepared(&config, &unmasked);
            let foggy = trainer(&config, &data, true).freeze();
            paint(&mut data, &foggy);
            let find = |scene: &FrozenScene, witness: bool, telling: bool| {
                let viewpoint = Viewpoint::at(&data, 0);
                let mut glance = Glance::at(&viewpoint, scene, 1);
                // All that the photo shows is of the object alone, or of what is around it alone.
                let known = if telling { [0.0, 1.0] } else { [1.0, 0.0] };
                glance.known.iter_mut().for_each(|colour| colour.1 = known);
                let colours = Colours::new(glance.known.iter().copied());
                let shown = |places: &[Vec3]| vec![witness; places.len()];
                hidden_alike(scene, &data, 0, &glance, &colours, shown)
            };
            let found = find(&foggy, true, true);
            let width = data.views[0].width();
            assert!(found.len() > 20, "{} pixels", found.len());
            assert!(found.iter().all(|i| i % width < width / 2), "{found:?}");
            // Not where others do not show it or colours say nothing, nor where it is seen.
            assert!(find(&foggy, false, true).is_empty());
            assert!(find(&foggy, true, false).is_empty());
            let clear = trainer(&config, &data, false).freeze();
            assert!(find(&clear, true, true).is_empty());

            // What else is known of them is as it was.
            let before = data.outlines[0].clone();
            assert!(shown(&data).is_empty());
            let mut trainer = trainer(&config, &data, true);
            trainer.note_alike(&mut data, std::slice::from_ref(&found));
            let found: Vec<u32> = found.iter().collect();
            assert_eq!(shown(&data), found);
            for (x, y) in found.iter().map(|i| (i % width, i / width)) {
                assert_eq!(data.outlines[0].label(x, y), before.label(x, y));
                assert_eq!(data.outlines[0].vote(x, y), before.vote(x, y));
            }
            // A run that goes on knows them.
            let mut again = tiny::prepared(&config, &unmasked);
            let (faults, band) = (trainer.mask_faults(), config.loss.ignore_band);
            again.correct_masks(faults, &config.prepare, band).unwrap();
            assert_eq!(shown(&again), found);
        }
    }

    #[test]
    fn what_is_opaque_gives_way_where_colours_show_the_object() {
        let config = tiny::config();
        let seen_after = |by_colour: bool| {
            let mut data = tiny::prepared(&config, &[]);
            let mut trainer = trainer(&config, &data, true);
            if by_colour {
                for outline in &mut data.outlines {
                    let pixels = outline.candidates.clone();
                    outline.mark_alike(&pixels);
                }
            }
            for _ in 0..40 {
                trainer.step(&data);
            }
            let viewpoint = Viewpoint::at(&data, 0);
            let squares = viewpoint.squares(2);
            let (_, rays) = viewpoint.rays(&squares, |pixel| viewpoint.is_expected(pixel));
            let scene = trainer.freeze();
            scene.mattes(&rays).iter().sum::<f32>() / rays.len() as f32
        };
        let (shown, not) = (seen_after(true), seen_after(false));
        // So opaque that nothing of the object was to be seen.
        assert!(not < 1e-4 && shown > 100.0 * not, "{shown}, {not}");
    }

    #[test]
    fn other_views_show_a_place_unless_it_is_hidden_from_all() {
        let config = tiny::config();
        let data = tiny::prepared(&config, &[]);
        for fog in [false, true] {
            let scene = trainer(&config, &data, fog).freeze();
            let viewpoint = Viewpoint::at(&data, 3);
            let squares = viewpoint.squares(2);
            let (_, rays) = viewpoint.rays(&squares, |pixel| viewpoint.is_expected(pixel));
            let met = rays.iter().zip(scene.objects(&rays));
            let met = met.filter(|(_, met)| met.matte >= FILLED);
            let places: Vec<Vec3> = met.map(|(ray, met)| ray.at(met.object_distance)).collect();
            let shown = are_shown(&scene, &data, 3, &places);
            let share = shown.iter().filter(|shown| **shown).count() as f32 / places.len() as f32;
            assert!(places.len() > 50, "{} places", places.len());
            assert!(if fog { share == 0.0 } else { share > 0.5 }, "{share}");
            // Nothing is shown where there is nothing.
            let beside: Vec<Vec3> = places.iter().map(|place| 2.0 * *place).collect();
            assert!(!are_shown(&scene, &data, 3, &beside).contains(&true));
        }
    }
}
