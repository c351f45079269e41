//! Which pixels a step looks at.

use glam::{Affine3A, Vec2, Vec3};
use neus_render::rays::Ray;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::agreement::tile_of;
use crate::prepare::outline::Outline;
use crate::prepare::{Label, Prepared, Shown, Vote};

/// Rays of one step with what is known about their pixels; all lists `[rays]`.
#[derive(Clone, Debug, Default)]
pub struct RayBatch {
    /// In the normalised frame.
    pub rays: Vec<Ray>,
    /// The photo's colour in `[0, 1]`, `[rays * 3]`.
    pub colours: Vec<f32>,
    /// The view that each ray belongs to.
    pub views: Vec<u32>,
    /// The [tile](super::agreement::tile_of) of the view.
    pub tiles: Vec<u32>,
    /// What the pixel is taken for.
    pub labels: Vec<Label>,
    /// What the view's own mask says, where it is believed.
    pub votes: Vec<Option<Vote>>,
    /// What says that the object is to be seen there.
    pub shown: Vec<Shown>,
    /// Whether the view's own mask, as it was given, takes the pixel for the object.
    pub masks: Vec<Option<bool>>,
    /// Where each ray is known to end, in the normalised frame, if anything is known.
    pub ends: Vec<Option<Vec3>>,
}

/// Draws rays; the same seed and step give the same batch.
#[derive(Debug)]
pub struct Sampler {
    seed: u64,
    object_share: f32,
    /// Share of the rays that go to places their view is known to see, and the step from which on none do.
    sights: (f32, u32),
    poses: Vec<Affine3A>,
    /// Views in which the object can be seen.
    with_object: Vec<usize>,
    /// Per view the rectangle `[x0, y0, x1, y1]` of what surrounds the object.
    surroundings: Vec<[u32; 4]>,
}

/// A view's number and a pixel of it.
type Pixel = (usize, u32, u32);

/// Of the rays that are not drawn where the object can be, how many fall into its surroundings:
/// what lies there is what plates show behind the object.
const NEARBY_SHARE: f32 = 0.6;

/// How many times as often pixels are drawn that show the object by their colours, where something hid it: hardly any of
/// a photo's pixels has its turn before the next look otherwise, and what is to be cleared away is there alone.
const ALIKE_TIMES: f32 = 32.0;
/// The most rays of all that are drawn for it.
const ALIKE_SHARE: f32 = 0.05;

/// How many times as many pixels are tried as rays are wanted that a mask has to agree to.
const TRIES: usize = 4;
/// Pixels that one task looks up.
const CHUNK: usize = 64;

impl Sampler {
    /// For the views of `scene`; `object_share` of the rays go where the object can be.
    #[must_use]
    pub fn new(scene: &Prepared, seed: u64, object_share: f32) -> Self {
        Self {
            seed,
            object_share,
            sights: (0.0, 0),
            poses: scene
                .views
                .iter()
                .map(|v| v.world_from_camera(&scene.frame))
                .collect(),
            with_object: (0..scene.views.len())
                .filter(|&i| !scene.outlines[i].candidates.is_empty())
                .collect(),
            surroundings: (0..scene.views.len())
                .map(|i| surroundings(scene, i))
                .collect(),
        }
    }

    /// The same with a `share` of the rays of the steps before `end` going to places that their view is known to see, if there
    /// are any.
    #[must_use]
    pub fn with_sights(self, share: f32, end: u32) -> Self {
        let sights = (share, end);
        Self { sights, ..self }
    }

    /// Takes the cameras to be where they are now.
    pub fn look_from(&mut self, scene: &Prepared) {
        let views = scene.views.iter();
        self.poses = views.map(|v| v.world_from_camera(&scene.frame)).collect();
    }

    /// The batch of `step`.
    #[must_use]
    pub fn draw(&self, scene: &Prepared, step: u32, rays: usize) -> RayBatch {
        let mut random = step_random(self.seed, step);
        let alike = Alike::of(scene, self.object_share);
        let aims: Vec<(Pixel, Option<Vec3>)> = (0..rays)
            .map(|_| {
                if let Some((pixel, end)) = self.sight(scene, step, &mut random) {
                    return (pixel, Some(end));
                }
                let pixel = match alike.pixel(scene, &mut random) {
                    Some(pixel) => pixel,
                    None => self.pixel(scene, &mut random),
                };
                (pixel, None)
            })
            .collect();
        // Looking things up takes most of the time: each pixel is somewhere else in memory.
        let drawn: Vec<_> = aims
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter_map(|((number, x, y), end)| {
                let view = &scene.views[number];
                if view.ignores(x, y) {
                    return None;
                }
                let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                // A pixel that a lens can't unproject (its far corner, say) teaches nothing.
                let ray = view.ray(&self.poses[number], pixel)?;
                let outline = &scene.outlines[number];
                Some((
                    ray,
                    number as u32,
                    tile_of((view.width(), view.height()), x, y),
                    view.photo.get_pixel(x, y).0,
                    outline.label(x, y),
                    outline.vote(x, y),
                    outline.shown(x, y),
                    view.mask.as_ref().map(|m| m.contains(x, y)),
                    end,
                ))
            })
            .collect();
        let mut batch = RayBatch::default();
        for (ray, view, tile, colour, label, vote, shown, mask, end) in drawn {
            batch.rays.push(ray);
            batch.views.push(view);
            batch.tiles.push(tile);
            batch.colours.extend(colour.map(|c| f32::from(c) / 255.0));
            batch.labels.push(label);
            batch.votes.push(vote);
            batch.shown.push(shown);
            batch.masks.push(mask);
            batch.ends.push(end);
        }
        batch
    }

    /// Up to `count` rays of a view's pixels whose mask says "object", away from its outline.
    #[must_use]
    pub fn object_rays(&self, scene: &Prepared, view: u32, step: u32, count: usize) -> Vec<Ray> {
        let mut random = step_random(self.seed ^ u64::from(view).rotate_left(32), step);
        let view = view as usize;
        let (outline, seen) = (&scene.outlines[view], &scene.views[view]);
        let candidates = &outline.candidates;
        if candidates.is_empty() {
            return Vec::new();
        }
        (0..TRIES * count)
            .filter_map(|_| {
                let pixel = candidates.nth(random.random_range(0..candidates.len()));
                let (x, y) = (pixel % seen.width(), pixel / seen.width());
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                (outline.shown(x, y) != Shown::No && !seen.ignores(x, y))
                    .then(|| seen.ray(&self.poses[view], centre))?
            })
            .take(count)
            .collect()
    }

    /// The pixel of a place that its view is known to see, and the place, if it is the turn of one and its view has it.
    fn sight(&self, scene: &Prepared, step: u32, random: &mut impl Rng) -> Option<(Pixel, Vec3)> {
        let (sights, (share, end)) = (scene.sights.as_slice(), self.sights);
        if sights.is_empty() || step >= end || random.random::<f32>() >= share {
            return None;
        }
        let (number, place) = sights[random.random_range(0..sights.len())];
        let view = scene.views.get(number as usize)?;
        let (pixel, _) = view.project(place)?;
        let pixel = (number as usize, pixel.x as u32, pixel.y as u32);
        Some((pixel, scene.frame.normalised_from_world(place)))
    }

    fn pixel(&self, scene: &Prepared, random: &mut impl Rng) -> Pixel {
        if !self.with_object.is_empty() && random.random::<f32>() < self.object_share {
            let view = self.with_object[random.random_range(0..self.with_object.len())];
            let candidates = &scene.outlines[view].candidates;
            if candidates.is_empty() {
                // Its mask had next to nothing in it, and has lost that since.
                return self.anywhere(scene, view, random);
            }
            let pixel = candidates.nth(random.random_range(0..candidates.len()));
            let width = scene.views[view].width();
            return (view, pixel % width, pixel / width);
        }
        let view = random.random_range(0..scene.views.len());
        self.anywhere(scene, view, random)
    }

    /// A pixel of a view, wherever the object is.
    fn anywhere(&self, scene: &Prepared, view: usize, random: &mut impl Rng) -> Pixel {
        let photo = &scene.views[view].photo;
        if random.random::<f32>() < NEARBY_SHARE {
            let [x0, y0, x1, y1] = self.surroundings[view];
            return (
                view,
                random.random_range(x0..x1),
                random.random_range(y0..y1),
            );
        }
        (
            view,
            random.random_range(0..photo.width()),
            random.random_range(0..photo.height()),
        )
    }
}

/// The pixels of all views that show the object by their colours.
struct Alike {
    pixels: usize,
    /// Of all rays.
    share: f32,
}

impl Alike {
    fn of(scene: &Prepared, object_share: f32) -> Self {
        let count = |pixels: fn(&Outline) -> usize| scene.outlines.iter().map(pixels).sum();
        let pixels: usize = count(|outline| outline.alike.len());
        let all: usize = count(|outline| outline.candidates.len());
        let often = ALIKE_TIMES * object_share * pixels as f32 / all.max(1) as f32;
        Self {
            pixels,
            share: often.min(ALIKE_SHARE),
        }
    }

    /// One of them, if it is their turn.
    fn pixel(&self, scene: &Prepared, random: &mut impl Rng) -> Option<Pixel> {
        if self.pixels == 0 || random.random::<f32>() >= self.share {
            return None;
        }
        let mut number = random.random_range(0..self.pixels);
        let view = scene.outlines.iter().position(|outline| {
            let here = number < outline.alike.len();
            if !here {
                number -= outline.alike.len();
            }
            here
        })?;
        let pixel = scene.outlines[view].alike.nth(number);
        let width = scene.views[view].width();
        Some((view, pixel % width, pixel / width))
    }
}

/// The candidates' bounding rectangle, grown by half its size on every side.
fn surroundings(scene: &Prepared, view: usize) -> [u32; 4] {
    let (width, height) = (scene.views[view].width(), scene.views[view].height());
    // A run that goes on into the next row holds its row's last column and the next one's first.
    let rectangle = scene.outlines[view].candidates.runs().map(|(a, b)| {
        let whole = a / width != b / width;
        let (left, right) = if whole {
            (0, width - 1)
        } else {
            (a % width, b % width)
        };
        [left, a / width, right, b / width]
    });
    let Some([x0, y0, x1, y1]) = rectangle.reduce(|a, b| {
        [
            a[0].min(b[0]),
            a[1].min(b[1]),
            a[2].max(b[2]),
            a[3].max(b[3]),
        ]
    }) else {
        return [0, 0, width, height];
    };
    let (grow_x, grow_y) = ((x1 - x0) / 2 + 8, (y1 - y0) / 2 + 8);
    [
        x0.saturating_sub(grow_x),
        y0.saturating_sub(grow_y),
        (x1 + grow_x + 1).min(width),
        (y1 + grow_y + 1).min(height),
    ]
}

/// Random numbers of one step: a stream of its own, so that a run resumes without stored state.
#[must_use]
pub fn step_random(seed: u64, step: u32) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed ^ u64::from(step).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::prepare::Sights;
    use crate::prepare::spans::PixelSpans;
    use crate::train::tiny;

    #[test]
    fn some_rays_go_to_places_that_their_view_is_known_to_see() {
        let config = tiny::config();
        let mut data = tiny::prepared(&config, &[]);
        let share = |data: &Prepared, step: u32| {
            let sampler = Sampler::new(data, 5, config.sampling.object_share);
            let batch = sampler.with_sights(0.25, 8).draw(data, step, 4000);
            let ends = batch.rays.iter().zip(&batch.ends);
            let sights = ends.filter_map(|(ray, end)| end.map(|end| (ray, end)));
            for (ray, end) in sights.clone() {
                let t = ray.direction.dot(end - ray.origin);
                // Half a pixel of 48 or so, at the most.
                let off = (ray.origin + t * ray.direction).distance(end);
                assert!(t > 0.0 && off < 0.03 * t, "{off} at {t}");
            }
            (sights.count() as f32 / 4000.0, batch)
        };
        let without = Sampler::new(&data, 5, config.sampling.object_share).draw(&data, 7, 4000);
        let (none, batch) = share(&data, 7);
        assert_eq!((none, &batch.colours), (0.0, &without.colours));
        let frame = data.frame;
        let places = (0..100).map(|i| frame.world_from_normalised(Vec3::X * 0.003 * i as f32));
        let views: Vec<u32> = (0..data.views.len() as u32).collect();
        data.sights = Sights::new(places.map(|place| (place, views.clone())));
        let (some, _) = share(&data, 7);
        assert!((0.22..0.28).contains(&some), "{some}");
        // Later than that none are drawn.
        assert_eq!(share(&data, 8).0, 0.0);
        // What lies behind a camera is not in its picture.
        let from_camera = data.views[0].camera_from_world.inverse();
        let behind = from_camera.transform_point(-DVec3::Z);
        data.sights = Sights::new((0..100).map(|_| (behind, vec![0; 3])));
        assert_eq!(share(&data, 7).0, 0.0);
    }

    #[test]
    fn what_colours_show_is_drawn_more_often_but_not_from_all_else() {
        let config = tiny::config();
        let mut data = tiny::prepared(&config, &[]);
        let sampler = Sampler::new(&data, 5, config.sampling.object_share);
        let by_colour = |data: &Prepared| {
            let batch = sampler.draw(data, 7, 20_000);
            let shown = batch.shown.iter().zip(&batch.views);
            let shown = shown.filter(|(shown, _)| **shown == Shown::ByColour);
            let views: Vec<u32> = shown.map(|(_, view)| *view).collect();
            (views.len() as f32 / 20_000.0, views)
        };
        assert_eq!(by_colour(&data).0, 0.0);
        let mark = |data: &mut Prepared, view: usize, count: usize, skipped: usize| {
            let outline = &data.outlines[view];
            let width = data.views[view].width();
            let expected = |i: &u32| outline.is_expected(i % width, i / width);
            let all = outline.candidates.iter().filter(expected);
            let mut pixels = PixelSpans::default();
            all.skip(skipped).take(count).for_each(|i| pixels.push(i));
            assert_eq!(pixels.len(), count);
            data.outlines[view].mark_alike(&pixels);
            by_colour(data)
        };
        let all: usize = data.outlines.iter().map(|o| o.candidates.len()).sum();
        let evenly = 10.0 * config.sampling.object_share / all as f32;
        let (few, views) = mark(&mut data, 2, 10, 0);
        let often = few / evenly;
        assert!(
            (0.7..1.4).contains(&(often / ALIKE_TIMES)),
            "{often} times as often"
        );
        assert!(views.iter().all(|view| *view == 2));
        mark(&mut data, 2, 80, 10);
        let (many, views) = mark(&mut data, 4, 80, 0);
        assert!(many > ALIKE_SHARE && many < 2.0 * ALIKE_SHARE, "{many}");
        assert!(views.contains(&2) && views.contains(&4));
    }
}
