//! What is left of a region without what things stand on or before, divided into parts, and the object among them.

use glam::Vec3;
use scene_decomp::probability::ProbabilityMap;

use super::gaze::Gaze;
use super::hint::Hint;
use super::humps;
use super::part_set::PartSet;
use super::parts::Parts;
use super::plane::{self, Plane, SurfacePoint};
use super::surroundings::open_voxels;
use crate::prepare::Prepared;
use crate::prepare::error::PrepareError;
use crate::train::carve::depth::DepthPicture;

/// The parts of a region.
pub(super) struct Division {
    /// The fused distances without humps of the ground; infinite where surroundings without an edge, a wall behind the ground, or a
    /// box, leave it out.
    pub(super) solid: Vec<f32>,
    /// What was taken away.
    pub(super) ground: Option<Plane>,
    pub(super) parts: Parts,
    /// The object.
    pub(super) chosen: PartSet,
}

/// What is known of a region that is to be divided.
pub(super) struct Learnt<'a> {
    pub(super) data: &'a Prepared,
    /// What each view shows.
    pub(super) depths: &'a [DepthPicture],
    /// The fused distances of that, `[resolution^3]`.
    pub(super) distances: &'a [f32],
}

impl Learnt<'_> {
    /// Divides it at the `ground`.
    ///
    /// Where that is a wall, or none is known, and what is taken for the object goes on beyond the region with what it stands on,
    /// a table or a shelf, that is taken away as well, if the object ends within the region then. The `surface` is that of the
    /// distances.
    pub(super) fn divided(
        &self,
        ground: Option<Plane>,
        surface: Vec<SurfacePoint>,
        hint: &Hint,
        seed: u64,
    ) -> Result<Division, PrepareError> {
        let first = self.divided_at(ground, None, hint)?;
        let Gaze { up, .. } = Gaze::of(self.data);
        let stands = ground.is_some_and(|ground| ground.is_level(up));
        let has_end = matches!(hint, Hint::Box(_) | Hint::Masks(_));
        if stands || has_end || first.chosen.goes_on().is_none() {
            return Ok(first);
        }
        let before_wall = |p: &SurfacePoint| ground.is_none_or(|wall| !wall.has(p.at));
        let before: Vec<SurfacePoint> = surface.into_iter().filter(before_wall).collect();
        let support = plane::support_of_surface(&before, &self.cameras(), up, seed);
        let on_support = support.and_then(|support| {
            let division = self.divided_at(Some(support), ground.as_ref(), hint).ok()?;
            division.chosen.goes_on().is_none().then_some(division)
        });
        Ok(on_support.unwrap_or(first))
    }

    /// Divides it at the `ground`, in front of a `wall`.
    fn divided_at(
        &self,
        ground: Option<Plane>,
        wall: Option<&Plane>,
        hint: &Hint,
    ) -> Result<Division, PrepareError> {
        let Self { data, depths, .. } = *self;
        let resolution = data.map.resolution();
        let mut solid = self.distances.to_vec();
        if let Some(ground) = &ground {
            let eyes = humps::Eyes::new(&data.views, &data.frame, depths);
            humps::flatten(&mut solid, resolution, ground, &eyes);
        }
        let open = match hint {
            // What masks show is the object, of whatever colour.
            Hint::Masks(_) => vec![false; solid.len()],
            _ => open_voxels(&solid, data, depths, hint.clicked(&data.views)?),
        };
        for (cell, (distance, open)) in solid.iter_mut().zip(&open).enumerate() {
            let centre = || ProbabilityMap::centre(resolution, cell);
            if *open || wall.is_some_and(|wall| wall.has(centre())) {
                *distance = f32::INFINITY;
            }
        }
        hint.clip(&mut solid, resolution, &data.frame);
        let parts =
            Parts::new(&solid, resolution, ground.as_ref(), Gaze::of(data)).keeping_out(open);
        let chosen = hint.choose(&parts, data, depths, &solid)?;
        Ok(Division {
            solid,
            ground,
            parts,
            chosen,
        })
    }

    /// Where the views were taken from, in the normalised frame.
    pub(super) fn cameras(&self) -> Vec<Vec3> {
        let views = self.data.views.iter();
        views
            .map(|view| view.world_from_camera(&self.data.frame).translation.into())
            .collect()
    }
}
