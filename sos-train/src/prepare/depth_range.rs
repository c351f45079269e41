//! How near and how far the object can be, where all views are from much the same side.

use super::locate::Outline;
use super::votes::Electorate;
use glam::{DMat3, DVec3};
use io_colmap::SparsePoint;

/// Views this far from one line, in degrees, see the object from the side as well: what their masks
/// agree on is not deeper than it is. Measured at [`FARTHEST`] of them.
const ONE_SIDED: f64 = 60.0;
/// The share of views that counts; a few from elsewhere do not outvote the others.
const FARTHEST: f64 = 0.9;
/// The share of views that see the object at most this wide; wrong masks may be wider.
const WIDEST: f64 = 0.75;
/// The share of masks that must have a sparse point to take it for the object's.
const POINT_VOTE: f32 = 0.75;
/// Points that are enough to tell where the object's front is.
const ENOUGH_POINTS: usize = 30;
/// The share of them at either end that may be wrong.
const STRAY_POINTS: f64 = 0.05;
/// Room before the nearest point and behind the farthest, and the most from the middle one, over the
/// object's radius: points are on the side that is seen, the other is behind them.
const BEFORE: f64 = 0.25;
const BEHIND: f64 = 0.5;
const FROM_MIDDLE: f64 = 1.25;

/// A slab across the direction that the views have in common.
///
/// The masks' hull narrows only as far from the object as rays of different views part, so from one
/// side it is a cone that reaches to the cameras and beyond the walls. An object is about as deep as
/// it is wide; where its sparse points are, its front is.
#[derive(Clone, Copy, Debug)]
pub(super) struct DepthRange {
    axis: DVec3,
    near: f64,
    far: f64,
}

impl DepthRange {
    /// Around `centre`, where the masks' middles meet; none where the views are from enough sides.
    pub(super) fn of(
        outlines: &[Outline],
        centre: DVec3,
        electorate: &Electorate,
        points: &[SparsePoint],
    ) -> Option<Self> {
        let directions: Vec<DVec3> = outlines
            .iter()
            .filter_map(|o| (centre - o.origin).try_normalize())
            .collect();
        let axis = one_side(&directions, ONE_SIDED)?;
        let widths = outlines
            .iter()
            .map(|o| o.angular_reach * (centre - o.origin).dot(o.forward))
            .filter(|reach| *reach > 0.0);
        let radius = quantile(widths.collect(), WIDEST)?;
        let middle = centre.dot(axis);
        let depths: Vec<f64> = points
            .iter()
            .filter(|point| electorate.vote(point.position) >= POINT_VOTE)
            .map(|point| point.position.dot(axis))
            .collect();
        if depths.len() < ENOUGH_POINTS {
            return Some(Self {
                axis,
                near: middle - radius,
                far: middle + radius,
            });
        }
        let half = quantile(depths.clone(), 0.5)?;
        let near = quantile(depths.clone(), STRAY_POINTS)? - BEFORE * radius;
        let far = quantile(depths, 1.0 - STRAY_POINTS)? + BEHIND * radius;
        Some(Self {
            axis,
            near: near.max(half - FROM_MIDDLE * radius),
            far: far.min(half + FROM_MIDDLE * radius),
        })
    }

    pub(super) fn contains(&self, world: DVec3) -> bool {
        (self.near..=self.far).contains(&world.dot(self.axis))
    }
}

/// The line that nine in ten views of these unit directions look along, to `within` so many degrees, in the way that most do; none
/// where they look from enough sides.
pub(crate) fn one_side(directions: &[DVec3], within: f64) -> Option<DVec3> {
    let axis = common_axis(directions)?;
    let off_axis = directions
        .iter()
        .map(|d| d.dot(axis).abs().min(1.0).acos().to_degrees());
    (quantile(off_axis.collect(), FARTHEST)? <= within).then_some(axis)
}

/// The line that the directions are least off, by power iteration; along their mean.
fn common_axis(directions: &[DVec3]) -> Option<DVec3> {
    let mean: DVec3 = directions.iter().sum();
    let spread = directions.iter().fold(DMat3::ZERO, |sum, d| {
        sum + DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z)
    });
    // From the mean, which is near it wherever the answer is used; any start where that is nothing.
    let mut axis = mean.try_normalize().unwrap_or(DVec3::Z);
    for _ in 0..32 {
        axis = (spread * axis).try_normalize()?;
    }
    Some(if axis.dot(mean) < 0.0 { -axis } else { axis })
}

/// The value that this share of them is at most.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let at = (share * last as f64).round() as usize;
    let (_, value, _) = values.select_nth_unstable_by(at.min(last), f64::total_cmp);
    Some(*value)
}
