//! A set of voxels that is taken for the object.

use glam::Vec3;
use scene_decomp::probability::ProbabilityMap;

use crate::voxels::neighbours;

/// Share of a part's voxels at the border from which on it is taken to go on.
pub(super) const BORDER_SHARE: f32 = 0.02;
/// The same for no more of it than a tip: an ear, a nose.
const TIP_SHARE: f32 = 0.002;
/// Where the border begins, in the normalised frame.
const BORDER: f32 = 0.97;
/// Share of its voxels at the border on one side from which on a part goes on there.
const SIDE_SHARE: f32 = 0.1;

/// Voxels of the parts that were chosen, and those next to them.
#[derive(Clone, Debug)]
pub struct PartSet {
    resolution: usize,
    inside: Vec<bool>,
}

impl PartSet {
    /// Of voxels of a surface, each with whether it is the object: those that are, and what is next to them and no part of
    /// the surface.
    pub(super) fn of_surface(
        resolution: usize,
        surface: impl Iterator<Item = (usize, bool)>,
    ) -> Self {
        let mut labels = vec![None; resolution.pow(3)];
        for (place, is_object) in surface {
            labels[place] = Some(is_object);
        }
        Self::of_labels(resolution, |cell| labels[cell])
    }

    /// The voxels whose label holds, and those next to them without any.
    pub(super) fn of_labels(resolution: usize, label: impl Fn(usize) -> Option<bool>) -> Self {
        let holds = |cell| label(cell) == Some(true);
        let inside = (0..resolution.pow(3))
            .map(|cell| label(cell).unwrap_or_else(|| neighbours(cell, resolution).any(holds)))
            .collect();
        Self { resolution, inside }
    }

    /// Whether a voxel belongs to it.
    pub(super) fn holds(&self, cell: usize) -> bool {
        self.inside[cell]
    }

    /// Whether a point of the normalised frame belongs to it.
    #[must_use]
    pub fn contains(&self, point: Vec3) -> bool {
        voxel(point, self.resolution).is_some_and(|cell| self.holds(cell))
    }

    /// The centres of its voxels, in the normalised frame.
    pub(super) fn points(&self) -> Vec<Vec3> {
        (0..self.inside.len())
            .filter(|&cell| self.holds(cell))
            .map(|cell| ProbabilityMap::centre(self.resolution, cell))
            .collect()
    }

    /// The share of its voxels that lie at the region's border.
    pub(super) fn border_share(&self) -> f32 {
        let points = self.points();
        let border = points.iter().filter(|point| at_border(**point)).count();
        border as f32 / points.len().max(1) as f32
    }

    /// Along which axes it goes on beyond the region: 1 or -1 where it does on one side, 0 where it does not or
    /// on both; `None` where it ends within, but for a tip perhaps.
    pub(super) fn goes_on(&self) -> Option<Vec3> {
        self.beyond(BORDER_SHARE)
    }

    /// The same where a tip of it lies beyond is enough.
    pub(super) fn reaches_on(&self) -> Option<Vec3> {
        self.beyond(TIP_SHARE)
    }

    /// Where it goes on with more than the share `least` of its voxels at the border.
    fn beyond(&self, least: f32) -> Option<Vec3> {
        let mut border = self.points();
        let voxels = border.len();
        border.retain(|point| at_border(*point));
        if border.len() as f32 <= least * voxels as f32 {
            return None;
        }
        let side = |axis: usize| {
            let on = |sign: f32| {
                let there = border.iter().filter(|p| sign * p[axis] > BORDER).count();
                f32::from(there as f32 > SIDE_SHARE * border.len() as f32)
            };
            on(1.0) - on(-1.0)
        };
        Some(Vec3::new(side(0), side(1), side(2)))
    }
}

/// Whether a point of the normalised frame lies at the region's border.
pub(super) fn at_border(point: Vec3) -> bool {
    point.abs().max_element() > BORDER
}

/// The voxel of `n^3` that a point of the normalised frame lies in.
pub(super) fn voxel(point: Vec3, n: usize) -> Option<usize> {
    if point.is_nan() || point.abs().max_element() >= 1.0 {
        return None;
    }
    let at = ((point * 0.5 + 0.5) * n as f32).as_usizevec3();
    let [x, y, z] = at.to_array().map(|v| v.min(n - 1));
    Some((z * n + y) * n + x)
}
