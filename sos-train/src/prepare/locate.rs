//! Where the object is: the box, from the masks of all views together.

use super::clearance::clear_of_cameras;
use super::depth_range::DepthRange;
use super::error::PrepareError;
use super::frame::Frame;
use super::view::TrainView;
use super::votes::{Electorate, Quorum, ViewTrust, vote_grid};
use crate::config::PrepareConfig;
use crate::median::median;
use crate::voxels::{components, faces};
use glam::{DMat3, DVec2, DVec3};
use io_colmap::SparsePoint;
use scene_decomp::probability::ProbabilityMap;

/// Voxels per axis of the search grid.
const SEARCH_RESOLUTION: usize = 64;
/// Half the search cube's side over the object's median apparent radius.
const SEARCH_RADII: f64 = 3.5;
/// Share of a mask's pixels that its far ends are beyond of; the rest may be specks.
const FAR_END: f64 = 0.98;
/// What masks agree on in one place is a crumb below this share of what they agree on in the largest.
const CRUMB: f32 = 0.03;

/// Axes that miss the place where they meet by less than this share of how far cameras stand apart do meet there: 0.001 to
/// 0.22 in captures of an object, 0.37 where axes point 4 degrees off at random, 0.67 and more where they are as good as parallel.
const CONVERGED: f64 = 0.55;

/// The box, from masks. `points` are the model's sparse points, and may be none; `quorum` says which places are heard.
///
/// The centre is the point closest to the rays through the masks' centroids; the size comes from
/// their areas; then every voxel of a cube around it collects the masks' votes, and the box is
/// where the votes agree, with a margin. Where all views are from much the same side, votes agree
/// along a cone that is far deeper than any object: `DepthRange` cuts it. Cameras stay outside
/// (`clear_of_cameras`).
///
/// # Errors
/// When no three masks agree on a place, or of two not both.
pub fn box_from_masks(
    views: &[TrainView],
    points: &[SparsePoint],
    config: &PrepareConfig,
    quorum: Quorum,
) -> Result<Frame, PrepareError> {
    let outlines: Vec<Outline> = views.iter().filter_map(Outline::of).collect();
    if outlines.len() < 2 {
        return Err(PrepareError::Scene(format!(
            "only {} of {} views have a mask with something in it, and the object is found by 2 or \
             more; mark it in another one, or add --masks none to have it looked for",
            outlines.len(),
            views.len()
        )));
    }
    let centre = closest_to_rays(&outlines)?;
    let mut radii: Vec<f64> = outlines
        .iter()
        .map(|o| o.angular_radius * (centre - o.origin).dot(o.forward))
        .filter(|r| *r > 0.0)
        .collect();
    let Some(radius) = median(&mut radii) else {
        return Err(PrepareError::Scene(
            "the masks' rays meet behind the cameras; check the poses and the masks' polarity"
                .into(),
        ));
    };
    let trust = ViewTrust::all(views);
    let cameras: Vec<DVec3> = views
        .iter()
        .map(|view| view.camera_from_world.centre())
        .collect();
    let mut frame = Frame {
        centre,
        half_side: SEARCH_RADII * radius,
    };
    let electorate = Electorate::new(views, &frame, &trust, quorum);
    let depth = DepthRange::of(&outlines, centre, &electorate, points);
    // Twice: the second time around what the first found, so that the grid is fine enough.
    for _ in 0..2 {
        let mut votes = vote_grid(views, &frame, SEARCH_RESOLUTION, &trust, quorum);
        if let Some(depth) = &depth {
            for (cell, vote) in votes.iter_mut().enumerate() {
                let at = ProbabilityMap::centre(SEARCH_RESOLUTION, cell);
                if !depth.contains(frame.world_from_normalised(at)) {
                    *vote = 0.0;
                }
            }
        }
        let Some((low, high)) = extent(&votes, config.object_threshold) else {
            return Err(PrepareError::Scene(
                "the masks do not agree on any place in space; check that they show the same \
                 object and that their polarity is right (--polarity)"
                    .into(),
            ));
        };
        // What the votes enclose, and a voxel around it.
        let voxel = 2.0 / SEARCH_RESOLUTION as f64;
        let corner = |at: DVec3| frame.centre + at * frame.half_side;
        let (low, high) = (corner(low - voxel), corner(high + voxel));
        frame = clear_of_cameras(low, high, config.box_margin.into(), &cameras);
    }
    Ok(frame)
}

/// The box when there is no mask: where the optical axes meet, as wide as the views have in common.
///
/// # Errors
/// When the cameras' axes are parallel, or do not meet in front of them: a capture that faces one way
/// does not tell by itself what the object is.
pub fn box_from_cameras(views: &[TrainView]) -> Result<Frame, PrepareError> {
    let outlines: Vec<Outline> = views.iter().filter_map(Outline::of_axis).collect();
    let centre = closest_to_rays(&outlines)?;
    let in_front = |o: &&Outline| (centre - o.origin).dot(o.forward) > 0.0;
    let ahead = outlines.iter().filter(in_front).count();
    if 4 * ahead < 3 * outlines.len() {
        return Err(PrepareError::Scene(format!(
            "without masks the object is where the cameras look, but the axes of {} of {} cameras \
             do not meet in front of them; show it with the mask of a photo or more (--masks), with \
             --click VIEW:X,Y or with --box",
            outlines.len() - ahead,
            outlines.len()
        )));
    }
    if !converge(&outlines, centre) {
        return Err(PrepareError::Scene(
            "without masks the object is where the cameras look, but their axes run side by side and meet \
             nowhere; show it with the mask of a photo or more (--masks), with --click VIEW:X,Y or with --box"
                .into(),
        ));
    }
    let mut distances: Vec<f64> = outlines
        .iter()
        .map(|o| (centre - o.origin).length() * o.angular_radius)
        .collect();
    let half_side = median(&mut distances).unwrap_or(1.0);
    Ok(Frame { centre, half_side })
}

/// Whether the optical axes come closer together at `centre` than the cameras stand apart, seen along the mean axis. There is
/// such a point for axes that are all but parallel, too, at a distance that is left to chance.
fn converge(outlines: &[Outline], centre: DVec3) -> bool {
    let mean = |vector: fn(&Outline) -> DVec3| {
        outlines.iter().map(vector).sum::<DVec3>() / outlines.len() as f64
    };
    let (origin, axis) = (mean(|o| o.origin), mean(|o| o.forward));
    // Shorter than one where cameras face each other, and nothing is taken out of what lies between them then.
    let apart = |o: &Outline| {
        let from = o.origin - origin;
        (from - axis * from.dot(axis)).length()
    };
    let missed = |o: &Outline| {
        let to = centre - o.origin;
        (to - o.direction * to.dot(o.direction)).length()
    };
    let middle = |length: &dyn Fn(&Outline) -> f64| {
        let mut lengths: Vec<f64> = outlines.iter().map(length).collect();
        median(&mut lengths).unwrap_or(0.0)
    };
    // From a tripod all axes meet in the camera, and nothing lies between cameras.
    middle(&missed) < CONVERGED * middle(&apart)
}

/// How far along a ray, in its direction's lengths, it comes nearest to where the cameras look.
///
/// # Errors
/// When that is nowhere.
pub fn closest_to_ray(
    views: &[TrainView],
    origin: DVec3,
    direction: DVec3,
) -> Result<f64, PrepareError> {
    let outlines: Vec<Outline> = views.iter().filter_map(Outline::of_axis).collect();
    let centre = closest_to_rays(&outlines)?;
    let along = (centre - origin).dot(direction) / direction.length_squared();
    if along > 0.0 {
        Ok(along)
    } else {
        Err(PrepareError::Scene(
            "nothing tells how far away the object is: the cameras' axes meet behind the one that \
             shows it, and no sparse point is near; give masks for more photos, or --box"
                .into(),
        ))
    }
}

/// What one mask says about direction and size.
pub(super) struct Outline {
    /// The camera's place.
    pub(super) origin: DVec3,
    /// Through the middle of the mask, of unit length.
    direction: DVec3,
    /// The optical axis, of unit length.
    pub(super) forward: DVec3,
    /// Of the disc of the mask's area, over the depth.
    angular_radius: f64,
    /// From the middle to the mask's far ends, over the depth.
    pub(super) angular_reach: f64,
}

impl Outline {
    fn of(view: &TrainView) -> Option<Self> {
        let mask = view.mask.as_ref()?;
        let inside: Vec<DVec2> = mask
            .pixels()
            .map(|(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
            .collect();
        if inside.len() < 16 {
            return None;
        }
        let n = inside.len() as f64;
        let middle = inside.iter().sum::<DVec2>() / n;
        let mut off: Vec<f64> = inside.iter().map(|at| at.distance(middle)).collect();
        let far = (FAR_END * (n - 1.0)) as usize;
        let (_, reach, _) = off.select_nth_unstable_by(far, f64::total_cmp);
        Self::through(view, middle, (n / std::f64::consts::PI).sqrt(), *reach)
    }

    fn of_axis(view: &TrainView) -> Option<Self> {
        let (w, h) = (f64::from(view.width()), f64::from(view.height()));
        let radius = 0.3 * w.min(h);
        Self::through(view, DVec2::new(0.5 * w, 0.5 * h), radius, radius)
    }

    /// Around a pixel; `radius` and `reach` in pixels.
    fn through(view: &TrainView, pixel: DVec2, radius: f64, reach: f64) -> Option<Self> {
        let world_from_camera = view.camera_from_world.inverse();
        let direction = view.lens.0.unproject(pixel)?;
        let (fx, fy) = view.lens.0.focal();
        let focal = (fx * fy).sqrt();
        Some(Self {
            origin: view.camera_from_world.centre(),
            direction: world_from_camera.transform_vector(direction).normalize(),
            forward: world_from_camera.transform_vector(DVec3::Z),
            angular_radius: radius / focal,
            angular_reach: reach / focal,
        })
    }
}

/// The point with the least sum of distances to all rays, by reweighted least squares: a few views
/// whose mask shows something else hardly move it.
fn closest_to_rays(outlines: &[Outline]) -> Result<DVec3, PrepareError> {
    let mut weights = vec![1.0; outlines.len()];
    let mut point = DVec3::ZERO;
    for _ in 0..20 {
        let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
        for (o, weight) in outlines.iter().zip(&weights) {
            let d = o.direction;
            let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
            a += across * *weight;
            b += across * o.origin * *weight;
        }
        // Parallel rays leave the matrix singular: nothing says how far away the object is.
        let total: f64 = weights.iter().sum();
        if a.determinant().abs() < 1e-9 * total.powi(3) {
            return Err(PrepareError::Scene(
                "all cameras look the same way from the same line: their rays do not meet. Take \
                 photos from different sides"
                    .into(),
            ));
        }
        point = a.inverse() * b;
        for (o, weight) in outlines.iter().zip(&mut weights) {
            let to = point - o.origin;
            let along = to.dot(o.direction);
            let off = (to - along * o.direction).length() / along.abs().max(1e-12);
            let behind = if along < 0.0 { 0.01 } else { 1.0 };
            *weight = behind / off.max(0.01);
        }
    }
    Ok(point)
}

/// A connected set of voxels: the sum of its votes, and its bounds, the upper ones included.
#[derive(Clone, Copy, Debug)]
struct Set {
    mass: f32,
    low: [usize; 3],
    high: [usize; 3],
}

/// Bounds, in `[-1, 1]`, of the voxels whose vote reaches `threshold`: of the largest connected
/// set, and of all that end within and are not crumbs beside it, for an object may come in several pieces.
fn extent(votes: &[f32], threshold: f32) -> Option<(DVec3, DVec3)> {
    let n = SEARCH_RESOLUTION;
    let sets = connected(votes, threshold);
    let largest = sets.iter().map(|set| set.mass).fold(0.0, f32::max);
    // What few masks agree on by chance, far out, goes on beyond the cube.
    let ends = |set: &Set| set.low.iter().all(|at| *at > 0) && set.high.iter().all(|at| at + 1 < n);
    let is_piece = |set: &&Set| set.mass >= largest || set.mass > CRUMB * largest && ends(set);
    let pieces = sets.iter().filter(is_piece);
    let (low, high) =
        pieces
            .map(|set| (set.low, set.high))
            .reduce(|(low, high), (other_low, other_high)| {
                let least = |axis: usize| low[axis].min(other_low[axis]);
                let most = |axis: usize| high[axis].max(other_high[axis]);
                (std::array::from_fn(least), std::array::from_fn(most))
            })?;
    let at = |i: usize| 2.0 * i as f64 / n as f64 - 1.0;
    Some((
        DVec3::from(low.map(at)),
        DVec3::from(high.map(|i| at(i + 1))),
    ))
}

/// The sets of voxels whose vote reaches `threshold` that hang together by their faces.
fn connected(votes: &[f32], threshold: f32) -> Vec<Set> {
    let n = SEARCH_RESOLUTION;
    let reaches: Vec<bool> = votes.iter().map(|vote| *vote >= threshold).collect();
    let (labels, count) = components(&reaches, |cell| faces(cell, n));
    let nothing = Set {
        mass: 0.0,
        low: [n; 3],
        high: [0; 3],
    };
    let mut sets = vec![nothing; count as usize];
    for (cell, label) in labels.iter().enumerate().filter(|(_, label)| **label != 0) {
        let set = &mut sets[*label as usize - 1];
        set.mass += votes[cell];
        let at = [cell % n, cell / n % n, cell / (n * n)];
        for (axis, place) in at.into_iter().enumerate() {
            set.low[axis] = set.low[axis].min(place);
            set.high[axis] = set.high[axis].max(place);
        }
    }
    sets
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::balls::{view, with_balls};
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn cameras_around_a_place_find_it_and_cameras_that_spread_say_so() {
        let place = DVec3::new(1.0, 2.0, 3.0);
        let around: Vec<TrainView> = (0..8)
            .map(|i| {
                let angle = f64::from(i) * 0.7;
                let from = DVec3::new(angle.cos(), angle.sin(), 0.4) * 5.0;
                view(place + from, -from)
            })
            .collect();
        let frame = box_from_cameras(&around).unwrap();
        assert!(frame.centre.distance(place) < 1e-6, "{frame:?}");
        assert!((0.5..3.0).contains(&frame.half_side), "{frame:?}");

        // Side by side, each turned a little outward: the axes meet behind.
        let spread: Vec<TrainView> = (-4..=4)
            .map(|i| {
                let x = f64::from(i);
                view(DVec3::new(x, 0.1 * x, 0.0), DVec3::new(0.05 * x, 0.0, 1.0))
            })
            .collect();
        let error = box_from_cameras(&spread).unwrap_err().to_string();
        assert!(error.contains("--masks"), "{error}");
    }

    #[test]
    fn axes_that_are_all_but_parallel_or_turn_on_a_tripod_meet_nowhere() {
        // A grid of cameras that face one way, each a degree or two off.
        let off = |i: i32| f64::from(i * 7919 % 13 - 6) * 0.005;
        let grid = |apart: f64| -> Vec<TrainView> {
            let camera = |i: i32| {
                let place = DVec3::new(f64::from(i % 5), f64::from(i / 5), 0.0);
                view(place * apart, DVec3::new(off(i), off(3 * i + 1), 1.0))
            };
            (0..20).map(camera).collect()
        };
        for apart in [1.0, 0.0] {
            let error = box_from_cameras(&grid(apart)).unwrap_err().to_string();
            assert!(error.contains("--masks"), "{apart}: {error}");
        }
        // The same places, and all look at one.
        let target = DVec3::new(2.0, 1.5, 8.0);
        let camera = |view: TrainView| {
            let place = view.camera_from_world.centre();
            self::view(place, target - place)
        };
        let towards: Vec<TrainView> = grid(1.0).into_iter().map(camera).collect();
        assert!(box_from_cameras(&towards).unwrap().centre.distance(target) < 1e-6);
    }

    #[test]
    fn an_object_of_two_pieces_is_whole_in_the_box() {
        let pieces = [(DVec3::ZERO, 0.5), (DVec3::new(0.0, 0.0, 0.9), 0.25)];
        let views: Vec<TrainView> = (0..10)
            .map(|i| {
                let angle = f64::from(i) * 0.63;
                let from = DVec3::new(angle.cos(), angle.sin(), 0.3) * 5.0;
                with_balls(view(from, -from), &pieces)
            })
            .collect();
        let config = crate::config::TrainConfig::default().prepare;
        let frame = box_from_masks(&views, &[], &config, Quorum::OfAll).unwrap();
        for (centre, radius) in pieces {
            let off = (frame.centre - centre).abs().max_element();
            assert!(off + radius < frame.half_side, "{frame:?}");
        }
        assert!(frame.half_side < 1.3, "{frame:?}");
    }

    #[test]
    fn from_one_side_the_box_is_about_as_deep_as_wide_and_holds_no_camera() {
        let (ball, radius) = (DVec3::new(0.2, -0.1, 5.0), 1.0);
        // Side by side within a tenth of the distance, all facing one way, obliquely to the axes.
        let tilt = DQuat::from_rotation_y(0.6) * DQuat::from_rotation_x(0.4);
        let views: Vec<TrainView> = (0..20)
            .map(|i| {
                let at = DVec3::new(
                    0.2 * f64::from(i % 5) - 0.4,
                    0.2 * f64::from(i / 5) - 0.3,
                    0.0,
                );
                with_balls(view(tilt * at, tilt * DVec3::Z), &[(tilt * ball, radius)])
            })
            .collect();
        let config = crate::config::TrainConfig::default().prepare;
        let half = |points: &[SparsePoint]| {
            let frame = box_from_masks(&views, points, &config, Quorum::OfAll).unwrap();
            let off = (frame.centre - tilt * ball).abs().max_element();
            assert!(off + radius < frame.half_side, "holds the ball: {frame:?}");
            let holds = |view: &TrainView| {
                let camera = frame.normalised_from_world(view.camera_from_world.centre());
                camera.abs().max_element() < 1.0
            };
            assert!(!views.iter().any(holds), "holds cameras: {frame:?}");
            frame.half_side
        };
        assert!(half(&[]) < 2.5 * radius);

        // Points on the side of the ball that is seen, and a tenth as many strays in front of it.
        let points: Vec<SparsePoint> = (0..110)
            .map(|i| {
                let (turn, z) = (2.4 * f64::from(i), 0.05 + 0.9 * f64::from(i % 10) / 10.0);
                let across = (1.0 - z * z).sqrt();
                let front = DVec3::new(across * turn.cos(), across * turn.sin(), -z);
                let stray = if i < 10 { DVec3::Z * 1.5 } else { DVec3::ZERO };
                SparsePoint {
                    id: i as u64,
                    position: tilt * (ball + 0.98 * front - stray),
                    colour: [0; 3],
                    error: 0.0,
                    views: Vec::new(),
                }
            })
            .collect();
        assert!(half(&points) < 2.2 * radius);
    }
}
