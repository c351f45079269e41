//! A coarse look at every view, to know which views saw what lies behind the object.

use crate::prepare::pixels::Photo;
use glam::{Affine3A, Vec2, Vec3};
use neus_render::rays::Ray;
use rayon::prelude::*;

use super::rays::FrozenScene;
use crate::cells::{around, grown};
use crate::median::median;
use crate::prepare::{Prepared, TrainView, outline};

/// Pixels between the rays of the survey.
const STRIDE: u32 = 4;
/// How much further than the survey's depth a point may lie and still count as seen.
const DEPTH_TOLERANCE: f32 = 0.03;
/// A matte above this hides what is behind.
const HIDDEN: f32 = 0.2;
/// How far, as a root mean square over the channels, a photo's colour may be from the plate's where
/// it shows the same place: highlights move, but what looks quite different is something else.
const COLOUR_TOLERANCE: f32 = 0.12;

/// How far around a point's pixel the raster is drawn, in its cells: the neighbourhood that counts,
/// and as much again for points between those that asked.
const AROUND: usize = 3;

/// The cells of a view's coarse raster.
#[derive(Clone, Copy, Debug)]
struct Cells {
    width: usize,
    height: usize,
}

/// One view's matte and background depth on a coarse raster.
#[derive(Clone, Debug)]
struct CoarseView {
    world_from_camera: Affine3A,
    cells: Cells,
    matte: Vec<f32>,
    /// Distance along the ray, normalised frame; 0 where nothing was met or nobody looked.
    distance: Vec<f32>,
    /// Whether a cell's ray has been drawn.
    drawn: Vec<bool>,
    /// Cells whose photo is not to be learned from, and not to be shown in plates either.
    ignored: Vec<bool>,
}

/// How far one view looks.
#[derive(Clone, Debug)]
struct Sight {
    /// Of the camera, normalised frame.
    centre: Vec3,
    cells: Cells,
    /// For each cell the distance from which on a point is hidden; below zero where the object or what nobody looked at is
    /// next to it.
    farthest: Vec<f32>,
}

/// What all views saw.
#[derive(Clone, Debug)]
pub struct Survey {
    views: Vec<Sight>,
}

impl Survey {
    /// Renders the coarse raster of every view of `data`: first where the object can be, or the photo is not to be
    /// shown, to see what lies behind, then wherever a view might show that.
    #[must_use]
    pub fn new(scene: &FrozenScene, data: &Prepared, mut done: impl FnMut()) -> Self {
        let mut views: Vec<CoarseView> = data
            .views
            .iter()
            .map(|view| CoarseView::new(view, data))
            .collect();
        let mut behind = Vec::new();
        for (coarse, view) in views.iter_mut().zip(&data.views) {
            let silhouette = outline::silhouette(view, &data.frame, &scene.map, STRIDE);
            let threshold = (255.0 * scene.config.prepare.hull_threshold) as u8;
            let likely =
                |cell: &usize| coarse.ignored[*cell] || silhouette.as_raw()[*cell] >= threshold;
            let cells = coarse.undrawn_around((0..coarse.cells.count()).filter(likely));
            coarse.render(scene, view, &cells);
            behind.extend(coarse.behind_the_object(view));
        }
        for (coarse, view) in views.iter_mut().zip(&data.views) {
            let pixels: Vec<Vec2> = behind
                .par_iter()
                .filter_map(|point| {
                    let world = data.frame.world_from_normalised(*point);
                    view.project(world).map(|(pixel, _)| pixel)
                })
                .collect();
            let grid = coarse.cells;
            let seen = pixels.into_iter().map(|pixel| grid.at(pixel));
            let cells = coarse.undrawn_around(seen);
            coarse.render(scene, view, &cells);
            done();
        }
        Self {
            views: views.iter().map(CoarseView::sight).collect(),
        }
    }

    /// How many views saw the point that `ray` meets at `distance`, with the object not before it, in
    /// about the `colour` that the plate gives it.
    #[must_use]
    pub fn seen(&self, data: &Prepared, ray: &Ray, distance: f32, colour: Vec3) -> u8 {
        if distance <= 0.0 {
            return 0;
        }
        let point = ray.at(distance);
        let world = data.frame.world_from_normalised(point);
        let count = data
            .views
            .iter()
            .zip(&self.views)
            .filter(|(view, sight)| {
                view.project(world).is_some_and(|(pixel, _)| {
                    sight.reaches(point, pixel)
                        && !view.ignores(pixel.x as u32, pixel.y as u32)
                        && agrees(&view.photo, pixel, colour)
                })
            })
            .count();
        count.min(255) as u8
    }
}

/// For each cell whether a pixel in it is ignored.
fn ignored_cells(view: &TrainView, cells: Cells) -> Vec<bool> {
    let mut ignored = vec![false; cells.count()];
    if view.ignored.is_some() {
        for (y, x) in (0..view.height()).flat_map(|y| (0..view.width()).map(move |x| (y, x))) {
            let cell = (y / STRIDE) as usize * cells.width + (x / STRIDE) as usize;
            ignored[cell] |= view.ignores(x, y);
        }
    }
    ignored
}

/// Whether a photo has this colour at a pixel or next to it.
fn agrees(photo: &Photo, pixel: Vec2, colour: Vec3) -> bool {
    let (x, y) = (pixel.x as u32, pixel.y as u32);
    (y.saturating_sub(1)..(y + 2).min(photo.height())).any(|y| {
        (x.saturating_sub(1)..(x + 2).min(photo.width())).any(|x| {
            let there = Vec3::from(photo.get_pixel(x, y).0.map(f32::from)) / 255.0;
            there.distance_squared(colour) <= 3.0 * COLOUR_TOLERANCE * COLOUR_TOLERANCE
        })
    })
}

impl Cells {
    fn of(view: &TrainView) -> Self {
        Self {
            width: view.width().div_ceil(STRIDE) as usize,
            height: view.height().div_ceil(STRIDE) as usize,
        }
    }

    fn count(self) -> usize {
        self.width * self.height
    }

    fn at(self, pixel: Vec2) -> usize {
        let x = ((pixel.x / STRIDE as f32) as usize).min(self.width - 1);
        let y = ((pixel.y / STRIDE as f32) as usize).min(self.height - 1);
        y * self.width + x
    }

    /// A cell and those next to it.
    fn around(self, cell: usize) -> impl Iterator<Item = usize> {
        around(cell, self.width, self.count())
    }
}

impl Sight {
    /// Whether the view shows `point`, which is at `pixel` of it.
    fn reaches(&self, point: Vec3, pixel: Vec2) -> bool {
        point.distance(self.centre) <= self.farthest[self.cells.at(pixel)]
    }
}

impl CoarseView {
    /// Nothing drawn yet.
    fn new(view: &TrainView, data: &Prepared) -> Self {
        let cells = Cells::of(view);
        Self {
            world_from_camera: view.world_from_camera(&data.frame),
            cells,
            matte: vec![1.0; cells.count()],
            distance: vec![0.0; cells.count()],
            drawn: vec![false; cells.count()],
            ignored: ignored_cells(view, cells),
        }
    }

    /// The ray through a cell's middle.
    fn ray(&self, view: &TrainView, cell: usize) -> Option<Ray> {
        let (x, y) = (cell % self.cells.width, cell / self.cells.width);
        let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * STRIDE as f32;
        view.ray(&self.world_from_camera, pixel)
    }

    /// The cells around `cells`, which may be named more than once, that are not drawn yet.
    fn undrawn_around(&self, cells: impl Iterator<Item = usize>) -> Vec<usize> {
        // Of 200 large photos there are tens of millions, a thousand for each cell.
        let mut asked = vec![false; self.cells.count()];
        cells.for_each(|cell| asked[cell] = true);
        let near = grown(&asked, self.cells.width, AROUND);
        (0..self.cells.count())
            .filter(|&cell| near[cell] && !self.drawn[cell])
            .collect()
    }

    fn render(&mut self, scene: &FrozenScene, view: &TrainView, cells: &[usize]) {
        let (mut rays, mut at) = (Vec::new(), Vec::new());
        for &cell in cells {
            self.drawn[cell] = true;
            if let Some(ray) = self.ray(view, cell) {
                rays.push(ray);
                at.push(cell);
            }
        }
        for (cell, glance) in at.into_iter().zip(scene.glances(&rays)) {
            self.matte[cell] = glance.matte;
            self.distance[cell] = glance.background_distance;
        }
    }

    /// What of the background lies behind the object and close by its outline, or where the photo is not to be shown.
    fn behind_the_object(&self, view: &TrainView) -> Vec<Vec3> {
        let object = |i: usize| self.ignored[i] || (self.drawn[i] && self.matte[i] > 0.0);
        let object: Vec<bool> = (0..self.cells.count()).map(object).collect();
        let near = grown(&object, self.cells.width, 1);
        (0..self.cells.count())
            .filter(|&cell| near[cell] && self.distance[cell] > 0.0)
            .filter_map(|cell| Some(self.ray(view, cell)?.at(self.distance[cell])))
            .collect()
    }

    /// How far it looks, once all is drawn that is asked for.
    fn sight(&self) -> Sight {
        let farthest = |cell: usize| {
            // So close to the outline the raster can't tell which side.
            if self.cells.around(cell).any(|i| self.matte[i] > HIDDEN) {
                return f32::NEG_INFINITY;
            }
            // The neighbourhood's median depth: single rays slip through a porous surface.
            let mut depths: Vec<f32> = self.cells.around(cell).map(|i| self.distance[i]).collect();
            median(&mut depths).unwrap_or(0.0) * (1.0 + DEPTH_TOLERANCE)
        };
        let cells = (0..self.cells.count()).into_par_iter();
        Sight {
            centre: self.world_from_camera.translation.into(),
            cells: self.cells,
            farthest: cells.map(farthest).collect(),
        }
    }
}
