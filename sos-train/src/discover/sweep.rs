//! Places that photos agree on, for scenes that come without sparse points.
//!
//! A plane sweep (Collins 1996, "A space-sweep approach to true multi-image matching"): a patch of one photo is looked for
//! in those around it, as it would look there from each of many depths. The depth at which they agree is taken, if they
//! agree at no other nearly as well.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec2, DVec3, Mat2, Vec2};
use image::GrayImage;
use rayon::prelude::*;

use crate::prepare::TrainView;
use crate::prepare::error::PrepareError;
use crate::prepare::outline::bilinear;

/// Pixels along the longer side that photos are made smaller to, or nearly.
const SIDE: u32 = 480;
/// Photos at most whose patches are looked for: to know where the photos look, and to know of places everywhere.
const REFERENCES: usize = 6;
const MOST_REFERENCES: usize = 24;
/// Photos at most in which they are looked for.
const NEIGHBOURS: usize = 8;
/// Those look the same way, by the cosine of the angle between their axes.
const SAME_WAY: f64 = 0.85;
/// Patches along a photo's longer side, likewise.
const CELLS: u32 = 14;
const MOST_CELLS: u32 = 24;
/// Patches along a side of what is near a pixel.
const NEAR_CELLS: i32 = 5;
/// Pixels from a patch's middle to its edge.
const REACH: usize = 4;
const WIDTH: usize = 2 * REACH + 1;
/// Standard deviation of a patch's brightness, 0..1, from which on there is something to be found again.
const CONTRAST: f32 = 0.03;
/// Pixels by which what is seen moves from depth to depth, between the photos that are the farthest apart.
const STEP: f64 = 0.75;
/// How far it moves there at the least depth, over the photo's longer side.
const NEAREST: f64 = 0.4;
/// Correlation from which on photos agree.
const AGREEING: f32 = 0.8;
/// Correlation by which the best depth must be ahead of others.
const AHEAD: f32 = 0.1;
/// Steps from the best depth to what is another one.
const APART: usize = 4;

/// A place on a surface, in the scene's frame, and the views that agree on it.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub(super) position: DVec3,
    pub(super) views: Vec<usize>,
}

/// Places that some of the `views` show, in the scene's frame: of everything, or `near` a pixel of a view, within a
/// radius in pixels.
///
/// # Errors
/// When there is no room for smaller photos.
pub(super) fn places(
    views: &[TrainView],
    near: Option<(usize, DVec2, f64)>,
) -> Result<Vec<DVec3>, PrepareError> {
    let found = match near {
        Some((view, pixel, radius)) => {
            sweep(views, vec![view], |eye| eye.patches_near(pixel, radius))
        }
        None => sweep(views, references(views, REFERENCES), |eye| {
            eye.patches(CELLS)
        }),
    }?;
    Ok(found.into_iter().map(|place| place.position).collect())
}

/// As many places as the `views` show that are worth their time; those found so far when `interrupt` comes up. `progress` is
/// told which of the views is looked through now, from 1 on, of how many.
///
/// # Errors
/// When there is no room for smaller photos.
pub(super) fn everywhere(
    views: &[TrainView],
    interrupt: &AtomicBool,
    mut progress: impl FnMut(u32, u32),
) -> Result<Vec<Place>, PrepareError> {
    let references = references(views, MOST_REFERENCES);
    let (mut done, all) = (0, references.len() as u32);
    sweep(views, references, |eye| {
        if interrupt.load(Ordering::Relaxed) {
            return Vec::new();
        }
        done += 1;
        progress(done, all);
        eye.patches(MOST_CELLS)
    })
}

/// Some of the views, evenly.
fn references(views: &[TrainView], most: usize) -> Vec<usize> {
    let count = views.len().min(most);
    (0..count).map(|i| i * views.len() / count).collect()
}

/// Looks for patches of the `references` in the views around them.
fn sweep(
    views: &[TrainView],
    references: Vec<usize>,
    mut patches: impl FnMut(&Eye) -> Vec<Patch>,
) -> Result<Vec<Place>, PrepareError> {
    let around: Vec<(usize, Vec<usize>)> = references
        .into_iter()
        .map(|reference| (reference, neighbours(views, reference)))
        .collect();
    let needed: BTreeSet<usize> = around
        .iter()
        .flat_map(|(reference, others)| others.iter().chain([reference]).copied())
        .collect();
    let eyes: BTreeMap<usize, Eye> = needed
        .par_iter()
        .map(|&view| Ok((view, Eye::of(&views[view])?)))
        .collect::<Result<_, PrepareError>>()?;
    let mut found = Vec::new();
    for (reference, others) in around {
        let eye = &eyes[&reference];
        let patches = patches(eye);
        let neighbours: Vec<&Eye> = others.iter().map(|view| &eyes[view]).collect();
        found.par_extend(patches.par_iter().filter_map(|patch| {
            let (position, agreeing) = eye.place(patch, &neighbours)?;
            let agreeing = agreeing.into_iter().map(|i| others[i]);
            let views = agreeing.chain([reference]).collect();
            Some(Place { position, views })
        }));
    }
    Ok(found)
}

/// Views that look the same way from elsewhere: of the nearest ones every other, for what is next to a camera hardly
/// sees anything move.
fn neighbours(views: &[TrainView], reference: usize) -> Vec<usize> {
    let forward = |view: &TrainView| view.camera_from_world.inverse().transform_vector(DVec3::Z);
    let (own, at) = (
        forward(&views[reference]),
        views[reference].camera_from_world.centre(),
    );
    let mut others: Vec<(f64, usize)> = views
        .iter()
        .enumerate()
        .map(|(i, view)| (view.camera_from_world.centre().distance(at), i))
        .filter(|(apart, i)| *apart > 1e-9 && forward(&views[*i]).dot(own) > SAME_WAY)
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    others.truncate(2 * NEIGHBOURS);
    let stride = others.len().div_ceil(NEIGHBOURS).max(1);
    let from_the_farthest = others.into_iter().rev().step_by(stride);
    from_the_farthest.map(|(_, i)| i).collect()
}

/// A view, made smaller.
struct Eye {
    view: TrainView,
    /// Times that it is smaller.
    factor: u32,
    grey: GrayImage,
}

/// A square of pixels, and how its brightness differs from its mean, of unit length.
struct Patch {
    middle: Vec2,
    profile: Profile,
    /// The standard deviation of its brightness, 0..1.
    contrast: f32,
}

/// Row-major.
type Profile = [f32; WIDTH * WIDTH];

impl Eye {
    fn of(view: &TrainView) -> Result<Self, PrepareError> {
        let factor = (view.width().max(view.height()) / SIDE).max(1);
        let view = TrainView {
            mask: None,
            ..view.clone()
        }
        .downscaled(factor)?;
        let grey = image::imageops::grayscale(&view.photo);
        Ok(Self { view, factor, grey })
    }

    /// What lies around a pixel; `None` where it is all much the same, goes on beyond the photo, or is not to be learnt from.
    fn patch(&self, middle: Vec2) -> Option<Patch> {
        let size = Vec2::new(self.view.width() as f32, self.view.height() as f32);
        let reach = REACH as f32 + 1.0;
        if middle.min_element() < reach || (size - middle).min_element() < reach {
            return None;
        }
        if self.view.ignores(middle.x as u32, middle.y as u32) {
            return None;
        }
        let (profile, contrast) = self.profile(middle, Mat2::IDENTITY);
        (contrast >= CONTRAST).then_some(Patch {
            middle,
            profile,
            contrast,
        })
    }

    /// The brightness around `middle` less its mean, of unit length, and its standard deviation. `axes` are what a step
    /// of a pixel is here.
    fn profile(&self, middle: Vec2, axes: Mat2) -> (Profile, f32) {
        let mut profile: Profile = std::array::from_fn(|i| {
            let offset = Vec2::new((i % WIDTH) as f32, (i / WIDTH) as f32) - REACH as f32;
            let at = middle + axes * offset;
            bilinear(&self.grey, at.x, at.y)
        });
        let count = profile.len() as f32;
        let mean = profile.iter().sum::<f32>() / count;
        profile.iter_mut().for_each(|v| *v -= mean);
        let length = profile.iter().map(|v| v * v).sum::<f32>().sqrt();
        profile.iter_mut().for_each(|v| *v /= length.max(1e-6));
        (profile, length / count.sqrt())
    }

    /// The patch with the most to be found again in each of some cells, `along` the longer side.
    fn patches(&self, along: u32) -> Vec<Patch> {
        let (width, height) = (self.view.width(), self.view.height());
        let cell = (width.max(height) / along).max(1);
        let stride = (cell / 4).max(1) as usize;
        let cells = (0..height / cell).flat_map(|y| (0..width / cell).map(move |x| (x, y)));
        cells
            .filter_map(|(x, y)| {
                (0..cell)
                    .step_by(stride)
                    .flat_map(|dy| (0..cell).step_by(stride).map(move |dx| (dx, dy)))
                    .filter_map(|(dx, dy)| {
                        let (x, y) = (x * cell + dx, y * cell + dy);
                        self.patch(Vec2::new(x as f32 + 0.5, y as f32 + 0.5))
                    })
                    .max_by(|a, b| a.contrast.total_cmp(&b.contrast))
            })
            .collect()
    }

    /// Patches within a radius of a pixel, both in pixels of the photo as it was.
    fn patches_near(&self, pixel: DVec2, radius: f64) -> Vec<Patch> {
        let part = 1.0 / self.factor as f32;
        let (middle, radius) = (pixel.as_vec2() * part, radius as f32 * part);
        let half = NEAR_CELLS / 2;
        let steps = (-half..=half).flat_map(|y| (-half..=half).map(move |x| (x, y)));
        steps
            .map(|(x, y)| Vec2::new(x as f32, y as f32) / half as f32)
            .filter(|offset| offset.length() <= 1.0)
            .filter_map(|offset| self.patch(middle + radius * offset))
            .collect()
    }

    /// What a pixel shows at a depth, in the scene's frame.
    fn unproject(&self, pixel: Vec2, depth: f64) -> Option<DVec3> {
        let direction = self.view.lens.0.unproject(pixel.as_dvec2())?;
        let in_camera = direction * (depth / direction.z.max(1e-6));
        let world_from_camera = self.view.camera_from_world.inverse();
        Some(world_from_camera.transform_point(in_camera))
    }

    /// Where a patch is, by what `others` show, and which of them show it, by number; `None` where they do not tell.
    fn place(&self, patch: &Patch, others: &[&Self]) -> Option<(DVec3, Vec<usize>)> {
        let centre = self.view.camera_from_world.centre();
        let apart = others
            .iter()
            .map(|other| other.view.camera_from_world.centre().distance(centre))
            .fold(0.0, f64::max);
        let (fx, fy) = self.view.lens.0.focal();
        let side = f64::from(self.view.width().max(self.view.height()));
        let steps = (NEAREST * side / STEP) as usize;
        let depth = |step: usize| (fx * fy).sqrt() * apart / (step as f64 * STEP);
        let scores: Vec<f32> = (1..=steps)
            .map(|step| self.agreement(patch, depth(step), others))
            .collect();
        let best = (0..steps).max_by(|&a, &b| scores[a].total_cmp(&scores[b]))?;
        let second = (0..steps)
            .filter(|step| step.abs_diff(best) > APART)
            .map(|step| scores[step])
            .fold(0.0, f32::max);
        // At the first and the last the truth may lie beyond.
        let told = best > 0 && best + 1 < steps;
        if !told || scores[best] < AGREEING || scores[best] < second + AHEAD {
            return None;
        }
        let depth = depth(best + 1);
        let position = self.unproject(patch.middle, depth)?;
        let agreeing = self.correlations(patch, depth, others);
        let agreeing = agreeing.into_iter().filter(|(_, c)| *c >= AGREEING);
        Some((position, agreeing.map(|(i, _)| i).collect()))
    }

    /// How well each of `others` that has the patch in its picture shows it where it would be at a depth.
    fn correlations(&self, patch: &Patch, depth: f64, others: &[&Self]) -> Vec<(usize, f32)> {
        let [middle, right, down] = [Vec2::ZERO, Vec2::X, Vec2::Y]
            .map(|offset| self.unproject(patch.middle + offset, depth));
        let (Some(middle), Some(right), Some(down)) = (middle, right, down) else {
            return Vec::new();
        };
        let correlation = |other: &Self| -> Option<f32> {
            let at = |world: DVec3| Some(other.view.project(world)?.0);
            let (middle, right, down) = (at(middle)?, at(right)?, at(down)?);
            let axes = Mat2::from_cols(right - middle, down - middle);
            let (profile, _) = other.profile(middle, axes);
            Some(profile.iter().zip(&patch.profile).map(|(a, b)| a * b).sum())
        };
        let all = others.iter().enumerate();
        all.filter_map(|(i, other)| Some((i, correlation(other)?)))
            .collect()
    }

    /// How well `others` show the patch where it would be at a depth: the mean correlation of the better half of them,
    /// for in some it is hidden. 0 where less than half of them have it in the picture.
    fn agreement(&self, patch: &Patch, depth: f64, others: &[&Self]) -> f32 {
        let correlations = self.correlations(patch, depth, others);
        let mut correlations: Vec<f32> = correlations.into_iter().map(|(_, c)| c).collect();
        if correlations.len() < 2 || 2 * correlations.len() < others.len() {
            return 0.0;
        }
        correlations.sort_by(|a, b| b.total_cmp(a));
        let better = correlations.len().div_ceil(2);
        correlations[..better].iter().sum::<f32>() / better as f32
    }
}

#[cfg(test)]
pub(super) mod tests {
    #![allow(clippy::unwrap_used)]

    use image::{Rgb, RgbImage};
    use io_colmap::{Camera, CameraModel, Pose};

    use super::*;
    use crate::discover::Hint;
    use crate::prepare::pixels::PixelStore;
    use crate::prepare::view::Lens;

    /// Where a wall is, and a board before its middle.
    const WALL: f64 = 6.0;
    pub(in crate::discover) const BOARD: f64 = 2.0;
    const HALF_BOARD: f64 = 0.4;

    /// Brightness of squares that are all different, `0.07` wide.
    fn squares(x: f64, y: f64) -> u8 {
        let (i, j) = ((x / 0.07).floor() as i64, (y / 0.07).floor() as i64);
        let mixed = ((i * 73_856_093) ^ (j * 19_349_663)).wrapping_mul(0x9E37_79B9);
        (mixed >> 13) as u8
    }

    /// A camera that looks along z, `right` of the middle.
    fn camera(right: f64, shows: impl Fn(DVec3, DVec3) -> u8) -> TrainView {
        let store = PixelStore::new(&std::env::temp_dir());
        let lens = Camera {
            id: 1,
            model: CameraModel::Pinhole,
            width: 160,
            height: 120,
            params: vec![140.0, 140.0, 80.0, 60.0],
        };
        let centre = DVec3::X * right;
        let photo = RgbImage::from_fn(160, 120, |x, y| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            Rgb([shows(centre, lens.unproject(pixel).unwrap()); 3])
        });
        TrainView {
            name: format!("{right}"),
            lens: Lens(lens),
            camera_from_world: Pose {
                rotation: glam::DQuat::IDENTITY,
                translation: -centre,
            },
            photo: store.keep_photo(photo).unwrap(),
            mask: None,
            ignored: None,
            store,
        }
    }

    pub(in crate::discover) fn board_before_wall() -> Vec<TrainView> {
        let shows = |centre: DVec3, direction: DVec3| {
            let at = |depth: f64| centre + direction * (depth / direction.z);
            let board = at(BOARD);
            if board.x.abs().max(board.y.abs()) < HALF_BOARD {
                return squares(board.x, board.y);
            }
            let wall = at(WALL);
            squares(wall.x / 3.0 + 7.0, wall.y / 3.0)
        };
        let places = (-3..=3).map(|i| 0.06 * f64::from(i));
        places.map(|right| camera(right, shows)).collect()
    }

    #[test]
    fn what_photos_show_is_placed_at_its_depth() {
        let found = places(&board_before_wall(), None).unwrap();
        let near = |depth: f64| {
            let close = |place: &&DVec3| (place.z / depth - 1.0).abs() < 0.15;
            found.iter().filter(close).count()
        };
        let (board, wall) = (near(BOARD), near(WALL));
        assert!(board > 30 && wall > 30, "{board} and {wall} places");
        assert!(10 * (board + wall) > 9 * found.len(), "of {}", found.len());
    }

    #[test]
    fn views_that_agree_on_a_place_show_it() {
        let views = board_before_wall();
        let mut told = Vec::new();
        let tell = |done, all| told.push((done, all));
        let found = everywhere(&views, &AtomicBool::new(false), tell).unwrap();
        let all = views.len().min(MOST_REFERENCES) as u32;
        assert!(told.into_iter().eq((1..=all).map(|done| (done, all))));
        let few = places(&views, None).unwrap();
        assert!(
            found.len() > 2 * few.len(),
            "{} and {}",
            found.len(),
            few.len()
        );
        let (mut shown, mut hidden) = (0, 0);
        for place in &found {
            for &view in &place.views {
                let centre = views[view].camera_from_world.centre();
                let direction = place.position - centre;
                let at_board = centre + direction * (BOARD / direction.z);
                let behind_it = at_board.x.abs().max(at_board.y.abs()) < HALF_BOARD;
                let behind_it = behind_it && place.position.z > 1.2 * BOARD;
                (shown, hidden) = (
                    shown + usize::from(!behind_it),
                    hidden + usize::from(behind_it),
                );
            }
        }
        assert!(shown > 1000 && 50 * hidden < shown, "{hidden} of {shown}");
    }

    #[test]
    fn nothing_is_placed_where_there_is_nothing_to_be_found_again() {
        let views: Vec<TrainView> = (0..5)
            .map(|i| camera(0.1 * f64::from(i), |_, _| 128))
            .collect();
        assert_eq!(places(&views, None).unwrap(), []);
        assert_eq!(places(&views[..1], None).unwrap(), []);
    }

    #[test]
    fn cameras_that_face_one_way_find_what_stands_before_them_without_sparse_points() {
        let views = board_before_wall();
        let region = Hint::Nothing.region(&views, &[]).unwrap();
        assert!((region.centre.z - BOARD).abs() < 0.4, "{region:?}");
        let click = Hint::Click("0.06:80,60".parse().unwrap());
        let region = click.region(&views, &[]).unwrap();
        assert!((region.centre.z - BOARD).abs() < 0.4, "{region:?}");
    }
}
