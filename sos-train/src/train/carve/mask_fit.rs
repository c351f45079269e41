//! Masks that are too small or too large all around, found out by geometry.
//!
//! Segmenters that work on small pictures, and people in a hurry, leave out a rim of the object or take in
//! a rim of what is around it, the same in every view. Where the object ends before something farther
//! away its outline is known from depths, whatever masks say: the votes of all views place the surface on
//! one side, as it is seen from its front in some of them. Where it touches its ground nothing but masks
//! says where it ends, and all err alike. So the error is measured at the first kind of outline, and taken
//! out all around.

use scene_decomp::probability::ProbabilityMap;

use super::depth::{DepthPicture, depth_picture};
use crate::median::median;
use crate::prepare::error::PrepareError;
use crate::prepare::mask::Mask;
use crate::prepare::mask_shift::outline_distance;
use crate::prepare::{Prepared, TrainView};
use crate::render::rays::FrozenScene;
use crate::train::Trainer;

/// Rays along the masks' outlines whose depths are looked at ([`rays_of`](super::rays_of)).
const RAYS: (usize, usize) = (2_000, 100_000);
/// Half the width of the band that is looked at, as a share of the object's size in the picture (the root
/// of its mask's area).
const BAND: f32 = 0.12;
/// An outline where what is behind is at least this much farther away, in the normalised frame, is an end of
/// geometry.
const STEP: f32 = 0.08;
/// Ends of geometry that a view needs to be heard by itself, and a scene.
const ENOUGH_IN_VIEW: usize = 40;
const ENOUGH: usize = 400;
/// Errors up to this share of the object's size are left to training, which is as exact.
const NEGLIGIBLE: f32 = 0.012;
/// Share of the outline that must err to the same side: masks that err at random are outvoted.
const ALIKE: f32 = 0.75;
/// Rounds: outlines are found more exactly with votes of better masks.
const ROUNDS: usize = 3;

impl Trainer {
    /// Moves outlines of masks that are all too small, or all too large, to where geometry says they are. Returns what
    /// was done, for people; `None` if nothing.
    pub(super) fn fit_masks(
        &mut self,
        scene: &FrozenScene,
        data: &mut Prepared,
    ) -> Result<Option<String>, PrepareError> {
        let config = self.config().clone();
        let before = self.mask_faults.clone();
        let mut map = self.probability(data);
        for _ in 0..ROUNDS {
            let Some(shifts) = errors(scene, data, &map, config.prepare.crop_threshold) else {
                break;
            };
            self.mask_faults.shift_by(&shifts);
            data.correct_masks(&self.mask_faults, &config.prepare, config.loss.ignore_band)?;
            self.vote_anew(scene, data);
            map = self.probability(data);
        }
        let moved =
            (0..data.views.len()).map(|view| self.mask_faults.shift(view) - before.shift(view));
        let mut sizes: Vec<f32> = moved.filter(|by| *by != 0.0).collect();
        let Some(middle) = median(&mut sizes) else {
            return Ok(None);
        };
        Ok(Some(format!(
            "masks are too {} all around, by {:.1} pixels in the middle view, and are moved {}",
            if middle > 0.0 { "small" } else { "large" },
            middle.abs(),
            if middle > 0.0 { "outwards" } else { "inwards" },
        )))
    }
}

/// How far each view's mask is to be moved outwards, in pixels; `None` if masks do not err alike.
fn errors(
    scene: &FrozenScene,
    data: &Prepared,
    map: &ProbabilityMap,
    threshold: f32,
) -> Option<Vec<f32>> {
    let believed = data.views.iter().zip(&data.trust.0);
    let sizes: Vec<f32> = believed
        .map(|(view, trust)| if *trust < 0.5 { 0.0 } else { size(view) })
        .collect();
    // Points in the bands, one to a pixel: an outline is about four sizes long.
    let pixels: f32 = sizes.iter().map(|size| 8.0 * BAND * size * size).sum();
    let stride = (pixels / super::rays_of(data, RAYS) as f32)
        .sqrt()
        .ceil()
        .max(1.0) as u32;
    let views: Vec<Vec<f32>> = data
        .views
        .iter()
        .zip(&sizes)
        .map(|(view, &size)| match &view.mask {
            Some(mask) if size > 0.0 => {
                let reach = BAND * size;
                let distances = outline_distance(mask, reach.ceil() as u32 + 1);
                let width = view.width();
                let off = |picture: &DepthPicture, i: usize| {
                    let pixel = picture.pixel(i).as_uvec2();
                    let x = pixel.x.min(width - 1);
                    let y = pixel.y.min(view.height() - 1);
                    distances[(y * width + x) as usize]
                };
                let raster = DepthPicture {
                    stride,
                    width: width.div_ceil(stride),
                    distances: Vec::new(),
                };
                let near = |i: usize| off(&raster, i).abs() < reach;
                let picture = depth_picture(scene, view, &data.frame, stride, near);
                let ends = ends(&picture, &objects(view, data, &picture, map, threshold));
                ends.into_iter()
                    .map(|(i, j)| 0.5 * (off(&picture, i) + off(&picture, j)) / size)
                    .collect()
            }
            _ => Vec::new(),
        })
        .collect();
    shifts(views, &sizes)
}

/// Shifts in pixels from the errors measured in each view, as shares of `sizes`; `None` where masks do not
/// err alike, or next to nothing.
fn shifts(views: Vec<Vec<f32>>, sizes: &[f32]) -> Option<Vec<f32>> {
    let mut all: Vec<f32> = views.iter().flatten().copied().collect();
    let middle = median(&mut all)?;
    let alike = all.iter().filter(|error| **error * middle > 0.0).count() as f32;
    if all.len() < ENOUGH || middle.abs() < NEGLIGIBLE || alike < ALIKE * all.len() as f32 {
        return None;
    }
    let shifts = views.into_iter().zip(sizes).map(|(mut own, size)| {
        let enough = own.len() >= ENOUGH_IN_VIEW;
        let own = median(&mut own).filter(|_| enough).unwrap_or(middle);
        // A view's own ends of geometry are few; all of them together are many.
        0.5 * (own + middle) * size
    });
    Some(shifts.collect())
}

/// The root of the mask's area, in pixels.
fn size(view: &TrainView) -> f32 {
    let area = view.mask.as_ref().map_or(0, Mask::area);
    (area as f32).sqrt()
}

/// Whether each point of the raster shows what the votes give to the object; `None` where nobody looked.
fn objects(
    view: &TrainView,
    data: &Prepared,
    picture: &DepthPicture,
    map: &ProbabilityMap,
    threshold: f32,
) -> Vec<Option<bool>> {
    let world_from_camera = view.world_from_camera(&data.frame);
    let distances = picture.distances.iter().enumerate();
    distances
        .map(|(i, &distance)| {
            let pixel = picture.pixel(i);
            if distance.is_nan() || view.ignores(pixel.x as u32, pixel.y as u32) {
                return None;
            }
            let ray = view.ray(&world_from_camera, pixel)?;
            let point = ray.origin + distance * ray.direction;
            Some(distance.is_finite() && map.at(point) >= threshold)
        })
        .collect()
}

/// Pairs of neighbours in the raster between which geometry of the object ends.
fn ends(picture: &DepthPicture, objects: &[Option<bool>]) -> Vec<(usize, usize)> {
    let width = picture.width as usize;
    let mut out = Vec::new();
    for i in 0..objects.len() {
        let right = (i % width + 1 < width).then_some(i + 1);
        let below = (i + width < objects.len()).then_some(i + width);
        for j in [right, below].into_iter().flatten() {
            let (near, far) = match (objects[i], objects[j]) {
                (Some(true), Some(false)) => (i, j),
                (Some(false), Some(true)) => (j, i),
                _ => continue,
            };
            if picture.distances[far] > picture.distances[near] + STEP {
                out.push((i, j));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_that_err_alike_are_shifted_by_what_they_err() {
        let view = |middle: f32| {
            (0..200)
                .map(|i| middle + 0.0001 * (i - 100) as f32)
                .collect()
        };
        let found = shifts(
            vec![view(0.06), view(0.05), view(0.07)],
            &[100.0, 100.0, 200.0],
        );
        let found = found.expect("all are too small");
        for (found, expected) in found.into_iter().zip([6.0, 5.5, 13.0]) {
            assert!((found - expected).abs() < 0.1, "{found} {expected}");
        }
    }

    #[test]
    fn a_view_without_ends_of_geometry_follows_the_others_and_one_without_mask_stays() {
        let found = shifts(
            vec![vec![-0.04; 500], Vec::new(), Vec::new()],
            &[50.0, 100.0, 0.0],
        );
        assert_eq!(found, Some(vec![-2.0, -4.0, 0.0]));
    }

    #[test]
    fn masks_that_err_at_random_or_hardly_are_left_alone() {
        let both = (0..1000).map(|i| if i % 3 == 0 { -0.05 } else { 0.05 });
        assert_eq!(shifts(vec![both.collect()], &[100.0]), None);
        assert_eq!(shifts(vec![vec![0.008; 1000]], &[100.0]), None);
        assert_eq!(shifts(vec![vec![0.05; 100]], &[100.0]), None);
        assert_eq!(shifts(vec![Vec::new()], &[100.0]), None);
    }

    #[test]
    fn geometry_ends_where_what_is_behind_is_farther_away() {
        // Five points in a row: object, object, background far behind it, and then close to an object.
        let picture = DepthPicture {
            stride: 1,
            width: 5,
            distances: vec![1.0, 1.0, 2.0, 2.0, 1.99],
        };
        let row = [true, true, false, false, true].map(Some);
        assert_eq!(ends(&picture, &row), [(1, 2)]);
        let unknown = [Some(true), Some(true), None, Some(false), Some(true)];
        assert_eq!(ends(&picture, &unknown), []);
    }
}
