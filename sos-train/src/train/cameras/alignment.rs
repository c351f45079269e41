//! One camera against its photo: the motion after which the photo shows the scene where the fields have it.
//!
//! Direct alignment, as visual odometry has it (Engel et al. 2018, "Direct Sparse Odometry"): places with the colours that
//! the fields give them are projected into the photo, and Gauss-Newton moves the camera until the photo has those colours
//! there. The gradient is the photo's, so that no field has to be asked for one.

use glam::{DQuat, DVec2, DVec3, Vec2, Vec3};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::median::median;
use crate::prepare::TrainView;
use crate::prepare::pixels::Photo;

/// Steps of Gauss and Newton.
const ITERATIONS: usize = 6;
/// By how many typical differences a colour may be off before it counts less and less.
const TOLERANCE: f32 = 1.5;
/// What counts as a typical difference at least, of colours in `[0, 1]`.
const LEAST_DIFFERENCE: f32 = 0.01;
/// How far around a position the photo is averaged, in pixels: its gradient is meant, not that of its noise.
const BLUR: f32 = 0.75;
/// Share of the diagonal that is added to it: where nothing says how to move, nothing moves.
const DAMPING: f64 = 0.01;
/// Landmarks below which a photo says nothing.
const FEWEST: usize = 60;

/// A place of the scene, seen from a camera where it is believed to be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Landmark {
    /// In camera space.
    pub(super) place: DVec3,
    /// What the fields make of it, sRGB in `[0, 1]`.
    pub(super) colour: Vec3,
}

/// A motion of camera space: a rotation, then a translation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Motion {
    pub(super) rotation: DQuat,
    pub(super) translation: DVec3,
}

impl Motion {
    pub(super) const NONE: Motion = Motion {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    pub(super) fn of(&self, place: DVec3) -> DVec3 {
        self.rotation * place + self.translation
    }

    /// A part of it, `0` for nothing and `1` for all.
    fn part(&self, share: f64) -> Motion {
        Motion {
            rotation: DQuat::from_scaled_axis(share * self.rotation.to_scaled_axis()),
            translation: share * self.translation,
        }
    }

    /// This one, then a small one: rotation vector and translation.
    fn then(&self, small: SVector<f64, 6>) -> Motion {
        let rotation = DQuat::from_scaled_axis(DVec3::new(small[0], small[1], small[2]));
        Motion {
            rotation: (rotation * self.rotation).normalize(),
            translation: rotation * self.translation + DVec3::new(small[3], small[4], small[5]),
        }
    }
}

/// What a photo says about where its camera is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Alignment {
    /// The motion that brings landmarks where the photo has them, as far as it is believed.
    pub(super) motion: Motion,
    /// By how many pixels that moves the landmarks: the median.
    pub(super) shift: f64,
}

impl Alignment {
    /// Where a photo says nothing.
    pub(super) const NONE: Alignment = Alignment {
        motion: Motion::NONE,
        shift: 0.0,
    };
}

/// Finds the motion of camera space after which `view` shows the landmarks in their colours; `None` where the photo has too
/// little to go by.
///
/// Two halves of the landmarks are asked as well, each by itself. What they do not agree in is chance, and by the share of
/// what they agree in (as Spearman and Brown have it for a test twice as long) the motion of all is shortened.
pub(super) fn align(view: &TrainView, landmarks: &[Landmark]) -> Option<Alignment> {
    let mut differences = differences(view, landmarks);
    if differences.len() < FEWEST {
        return None;
    }
    let scale = TOLERANCE * median(&mut differences)?.max(LEAST_DIFFERENCE);
    let [even, odd] = [0, 1].map(|first| {
        let half: Vec<Landmark> = landmarks.iter().skip(first).step_by(2).copied().collect();
        Some(displacements(view, landmarks, fit(view, &half, scale)?))
    });
    let (even, odd) = (even?, odd?);
    let dot = |a: &[DVec2], b: &[DVec2]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
    let size = 0.5 * (dot(&even, &even) + dot(&odd, &odd));
    let alike = (dot(&even, &odd) / size.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let believed = 2.0 * alike / (1.0 + alike);
    let motion = fit(view, landmarks, scale)?.part(believed);
    let moved = displacements(view, landmarks, motion);
    let mut lengths: Vec<f64> = moved.iter().map(|moved| moved.length()).collect();
    Some(Alignment {
        motion,
        shift: median(&mut lengths)?,
    })
}

/// How far the photo's colours are from the landmarks'.
fn differences(view: &TrainView, landmarks: &[Landmark]) -> Vec<f32> {
    let difference = |landmark: &Landmark| {
        let pixel = view.lens.0.project(landmark.place)?;
        let (colour, _) = look(&view.photo, pixel.as_vec2())?;
        Some((colour - landmark.colour).length())
    };
    landmarks.iter().filter_map(difference).collect()
}

/// By how much a motion moves the landmarks in the photo, in pixels; nothing for those that leave it.
fn displacements(view: &TrainView, landmarks: &[Landmark], motion: Motion) -> Vec<DVec2> {
    let displacement = |landmark: &Landmark| {
        let before = view.lens.0.project(landmark.place)?;
        Some(view.lens.0.project(motion.of(landmark.place))? - before)
    };
    let displacement = |landmark| displacement(landmark).unwrap_or(DVec2::ZERO);
    landmarks.iter().map(displacement).collect()
}

/// How far apart two motions show the landmarks in the photo, in pixels: the median.
pub(super) fn apart(view: &TrainView, landmarks: &[Landmark], a: Motion, b: Motion) -> Option<f64> {
    let [a, b] = [a, b].map(|motion| displacements(view, landmarks, motion));
    let mut lengths: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a.distance(*b)).collect();
    median(&mut lengths)
}

/// The motion that leaves the least difference, where those beyond `scale` count ever less (Geman and McClure).
fn fit(view: &TrainView, landmarks: &[Landmark], scale: f32) -> Option<Motion> {
    let mut motion = Motion::NONE;
    for _ in 0..ITERATIONS {
        let (mut normal, mut slope) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
        for landmark in landmarks {
            let place = motion.of(landmark.place);
            let Some((pixel, by_place)) = projection(view, place) else {
                continue;
            };
            let Some((colour, gradient)) = look(&view.photo, pixel.as_vec2()) else {
                continue;
            };
            let difference = colour - landmark.colour;
            let away = (difference / scale).length_squared();
            let weight = f64::from(1.0 / ((1.0 + away) * (1.0 + away)));
            for channel in 0..3 {
                let [by_x, by_y] = gradient.map(|by| f64::from(by[channel]));
                // Of the colour by the place, and by a rotation of it about the camera.
                let moved = by_x * by_place[0] + by_y * by_place[1];
                let turned = place.cross(moved);
                let row = SVector::from([turned.x, turned.y, turned.z, moved.x, moved.y, moved.z]);
                slope += weight * f64::from(difference[channel]) * row;
                normal += weight * row * row.transpose();
            }
        }
        for i in 0..6 {
            normal[(i, i)] *= 1.0 + DAMPING;
        }
        motion = motion.then(-normal.cholesky()?.solve(&slope));
    }
    motion.translation.is_finite().then_some(motion)
}

/// Where a place of camera space is seen, and the gradients of x and y by the place.
fn projection(view: &TrainView, place: DVec3) -> Option<(DVec2, [DVec3; 2])> {
    let lens = &view.lens.0;
    let pixel = lens.project(place)?;
    let step = 1e-5 * place.length();
    let [by_x, by_y, by_z] = DVec3::AXES.map(|axis| {
        let there = lens.project(place + step * axis)?;
        Some((there - pixel) / step)
    });
    let (x, y, z) = (by_x?, by_y?, by_z?);
    let gradients = [DVec3::new(x.x, y.x, z.x), DVec3::new(x.y, y.y, z.y)];
    Some((pixel, gradients))
}

/// The photo's colour around a position, and its derivatives by x and y; `None` at its border.
pub(super) fn look(photo: &Photo, position: Vec2) -> Option<(Vec3, [Vec3; 2])> {
    let at = |x: f32, y: f32| interpolated(photo, position + BLUR * Vec2::new(x, y));
    let (a, b, c, d) = (
        at(-1.0, -1.0)?,
        at(1.0, -1.0)?,
        at(-1.0, 1.0)?,
        at(1.0, 1.0)?,
    );
    let colour = 0.5 * at(0.0, 0.0)? + 0.125 * (a + b + c + d);
    let by_x = (b + d - a - c) / (4.0 * BLUR);
    let by_y = (c + d - a - b) / (4.0 * BLUR);
    Some((colour, [by_x, by_y]))
}

/// Between four pixels.
fn interpolated(photo: &Photo, position: Vec2) -> Option<Vec3> {
    let from = position - 0.5;
    let (width, height) = photo.dimensions();
    let inside = from.x >= 0.0
        && from.y >= 0.0
        && from.x < (width - 1) as f32
        && from.y < (height - 1) as f32;
    if !inside {
        return None;
    }
    let (x, y, share) = (from.x as u32, from.y as u32, from.fract());
    let colour = |x, y| Vec3::from(photo.get_pixel(x, y).0.map(f32::from)) / 255.0;
    let above = colour(x, y).lerp(colour(x + 1, y), share.x);
    let below = colour(x, y + 1).lerp(colour(x + 1, y + 1), share.x);
    Some(above.lerp(below, share.y))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::prepare::pixels::PixelStore;
    use crate::prepare::view::Lens;
    use image::{Rgb, RgbImage};
    use io_colmap::{Camera, CameraModel, Pose};

    /// A pattern without repetition, by direction.
    fn pattern(at: DVec2) -> Vec3 {
        let wave = |a: f64, b: f64, c: f64| (0.5 + 0.4 * (a * at.x + b * at.y + c).sin()) as f32;
        let (x, y, z) = (
            wave(19.0, 7.0, 0.3),
            wave(-11.0, 23.0, 1.1),
            wave(29.0, -13.0, 2.0),
        );
        Vec3::new(x, 0.5 * (x + y), z)
    }

    /// Of a wall at depth 3 and a smaller one before it at 2, as a camera at the origin sees them.
    fn scene(from: &Motion) -> (TrainView, Vec<Landmark>) {
        let folder = tempfile::tempdir().unwrap();
        let store = PixelStore::new(folder.path());
        let (width, height) = (160, 120);
        let lens = Lens(Camera {
            id: 1,
            model: CameraModel::SimplePinhole,
            width,
            height,
            params: vec![150.0, 80.0, 60.0],
        });
        let depth_of = |at: DVec2| {
            if at.abs().max_element() < 0.2 {
                2.0
            } else {
                3.0
            }
        };
        let photo = RgbImage::from_fn(width, height, |x, y| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = lens.0.unproject(pixel).unwrap();
            let at = DVec2::new(ray.x, ray.y);
            Rgb(pattern(at).to_array().map(|v| (255.0 * v).round() as u8))
        });
        // Seen in their colours from the origin; believed to be where `from` has them.
        let back = from.rotation.inverse();
        let landmarks = (0..900)
            .map(|i| {
                let (x, y) = (f64::from(i % 30) - 14.5, f64::from(i / 30) - 14.5);
                let at = DVec2::new(x / 33.0, y / 45.0);
                let there = depth_of(at) * at.extend(1.0);
                Landmark {
                    place: back * (there - from.translation),
                    colour: pattern(at),
                }
            })
            .collect();
        let view = TrainView {
            name: "a.png".to_owned(),
            lens,
            camera_from_world: Pose::IDENTITY,
            photo: store.keep_photo(photo).unwrap(),
            mask: None,
            ignored: None,
            store,
        };
        (view, landmarks)
    }

    /// The largest error that is left, in pixels.
    fn left_over(view: &TrainView, landmarks: &[Landmark], found: &Motion, truth: &Motion) -> f64 {
        let errors = landmarks.iter().filter_map(|landmark| {
            let [a, b] =
                [found, truth].map(|motion| view.lens.0.project(motion.of(landmark.place)));
            Some(a?.distance(b?))
        });
        errors.fold(0.0, f64::max)
    }

    #[test]
    fn a_camera_goes_back_to_where_its_photo_was_taken() {
        let truth = Motion {
            rotation: DQuat::from_scaled_axis(DVec3::new(0.008, -0.011, 0.013)),
            translation: DVec3::new(0.02, 0.01, -0.04),
        };
        let (view, landmarks) = scene(&truth);
        let before = left_over(&view, &landmarks, &Motion::NONE, &truth);
        let found = align(&view, &landmarks).unwrap();
        let after = left_over(&view, &landmarks, &found.motion, &truth);
        assert!(before > 2.5 && after < 0.1, "{before} {after}");
        assert!(found.shift > 0.5, "{found:?}");
    }

    #[test]
    fn a_camera_that_is_right_stays() {
        let (view, landmarks) = scene(&Motion::NONE);
        let found = align(&view, &landmarks).unwrap();
        let moved = left_over(&view, &landmarks, &found.motion, &Motion::NONE);
        assert!(moved < 0.05, "{moved}");
    }

    #[test]
    fn chance_moves_no_camera() {
        let (view, mut landmarks) = scene(&Motion::NONE);
        // The colours of others.
        let colours: Vec<Vec3> = landmarks.iter().map(|l| l.colour).collect();
        let count = landmarks.len();
        for (i, landmark) in landmarks.iter_mut().enumerate() {
            landmark.colour = colours[(i * 389 + 31) % count];
        }
        let scale = 1.0;
        let all = displacements(&view, &landmarks, fit(&view, &landmarks, scale).unwrap());
        let mut lengths: Vec<f64> = all.iter().map(|d| d.length()).collect();
        let unshortened = median(&mut lengths).unwrap();
        let found = align(&view, &landmarks).unwrap();
        assert!(
            found.shift < 0.5 * unshortened,
            "{found:?} of {unshortened}"
        );
    }

    #[test]
    fn too_little_says_nothing() {
        let (view, landmarks) = scene(&Motion::NONE);
        assert!(align(&view, &landmarks[..FEWEST - 1]).is_none());
        assert!(align(&view, &[]).is_none());
    }
}
