//! How cameras look at a region.

use glam::{DVec3, Vec3};

use super::part_set::PartSet;
use crate::prepare::depth_range::one_side;
use crate::prepare::{Prepared, TrainView};

/// How much less a voxel counts with its distance from the middle: the deviation of a Gaussian.
const CENTRAL: f32 = 0.45;

/// Cameras whose directions are this near to one line, in degrees, have optical axes whose meeting is told badly along it.
const ONE_WAY: f64 = 30.0;

/// The directions that the views of a region have in common, in its normalised frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaze {
    /// The mean of the cameras' upward directions.
    pub(super) up: Vec3,
    /// The unit direction that nine in ten cameras look along to within [`ONE_WAY`], if they do.
    pub(super) along: Option<Vec3>,
}

impl Gaze {
    /// Of the views of `data`.
    #[must_use]
    pub(super) fn of(data: &Prepared) -> Self {
        let pose = |view: &TrainView| view.world_from_camera(&data.frame);
        let up = |view| -> Vec3 {
            pose(view)
                .transform_vector3(Vec3::NEG_Y)
                .normalize_or_zero()
        };
        let views = data.views.iter();
        let towards_middle = |view: &TrainView| -> Option<DVec3> {
            (-view.camera_centre(&data.frame).as_dvec3()).try_normalize()
        };
        let directions: Vec<DVec3> = views.clone().filter_map(towards_middle).collect();
        Self {
            up: views.map(up).sum::<Vec3>() / data.views.len().max(1) as f32,
            along: one_side(&directions, ONE_WAY).map(|along| along.as_vec3()),
        }
    }

    /// How central a point of the normalised frame is, 0..1.
    ///
    /// Where all cameras look one way, how far away their optical axes meet is left to how well they were aimed, and what they look at
    /// may be anywhere along that way: only how far a point is beside it tells.
    #[must_use]
    pub(super) fn central(&self, point: Vec3) -> f32 {
        let beside = self.along.map_or(point, |along| point.reject_from(along));
        (-0.5 * beside.length_squared() / (CENTRAL * CENTRAL)).exp()
    }

    /// The sum of how central the voxels of a set are.
    pub(super) fn central_of(&self, set: &PartSet) -> f32 {
        set.points().into_iter().map(|p| self.central(p)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::super::look::prepared;
    use super::*;
    use crate::config::{Preset, TrainConfig};
    use crate::prepare::{Frame, balls};

    const WORLD: Frame = Frame {
        centre: DVec3::ZERO,
        half_side: 1.0,
    };

    /// Of a camera per angle around the vertical and height above the ground, in degrees, which all look at the middle.
    fn gaze(cameras: impl Iterator<Item = [f64; 2]>) -> Gaze {
        let view = |angles: [f64; 2]| {
            let [around, up] = angles.map(f64::to_radians);
            let level = DVec3::new(around.sin(), -around.cos(), 0.0);
            let from = 3.0 * (up.cos() * level + up.sin() * DVec3::Z);
            balls::view(from, -from)
        };
        let views: Vec<TrainView> = cameras.map(view).collect();
        let config = TrainConfig::preset(Preset::Default);
        Gaze::of(&prepared(&views, WORLD, &config))
    }

    #[test]
    fn cameras_on_one_side_look_along_one_line_and_rings_do_not() {
        let fan = gaze((-2..=2).map(|i| [10.0 * f64::from(i), 10.0]));
        let along = fan.along.unwrap_or_default();
        assert!(along.y > 0.95 && along.x.abs() < 0.01, "{along}");
        for up in [0.0, 20.0, 45.0, 55.0] {
            let ring = gaze((0..24).map(|i| [15.0 * f64::from(i), up]));
            assert_eq!(ring.along, None, "{up} degrees above the ground");
        }
    }

    #[test]
    fn how_deep_something_is_tells_nothing_from_one_side() {
        let [around, from_front] = [None, Some(Vec3::Y)].map(|along| Gaze { up: Vec3::Z, along });
        let deep = 0.6 * Vec3::Y;
        assert!(around.central(deep) < 0.5 && from_front.central(deep) == 1.0);
        let beside = 0.6 * Vec3::X;
        assert_eq!(around.central(beside), from_front.central(beside + deep));
    }
}
