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

/// How much of what was found must have been found before for it to be of that.
pub(super) const SAME: f32 = 0.5;
/// Of what is central about a shelf with all that is on it, what the object has at least: less is haze above it.
const LEAST_LEFT: f32 = 0.02;

/// The parts of a region.
pub(super) struct Division {
    /// The fused distances without humps of the ground; infinite where surroundings without an edge, a wall behind the ground, or a
    /// box, leave it out.
    pub(super) solid: Vec<f32>,
    /// What things stand on, or before; taken away.
    pub(super) ground: Option<Plane>,
    /// What is behind that, if it was taken away as well.
    pub(super) wall: Option<Plane>,
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
    /// Divides it at the `ground`; the `surface` is that of the distances.
    ///
    /// Where that is a wall, and what is taken for the object goes on beyond the region with what it stands on, a table or a shelf, that
    /// is taken away as well, if the object is a part of what it was and ends within the region then.
    pub(super) fn divided(
        &self,
        ground: Option<Plane>,
        surface: Vec<SurfacePoint>,
        hint: &Hint,
        seed: u64,
    ) -> Result<Division, PrepareError> {
        let first = self.divided_at(ground, None, hint)?;
        let gaze = Gaze::of(self.data);
        let has_end = matches!(hint, Hint::Box(_) | Hint::Masks(_));
        let Some(wall) = ground.filter(|ground| !ground.is_level(gaze.up)) else {
            return Ok(first);
        };
        if has_end || first.chosen.goes_on().is_none() {
            return Ok(first);
        }
        let before: Vec<SurfacePoint> = surface.into_iter().filter(|p| !wall.has(p.at)).collect();
        let cameras = self
            .data
            .views
            .iter()
            .map(|view| view.camera_centre(&self.data.frame));
        let cameras: Vec<Vec3> = cameras.collect();
        let clicked = hint.clicked_point(self.data, self.depths)?;
        let is_wanted = |support: &Plane| clicked.is_some_and(|point| support.has(point));
        let support = plane::support_of_surface(&before, &cameras, gaze.up, seed)
            .filter(|support| !is_wanted(support));
        let Some(support) = support else {
            return Ok(first);
        };
        // What has gone well with the wall alone can only fail for want of anything that stands there.
        let Ok(second) = self.divided_at(Some(support), Some(wall), hint) else {
            return Ok(first);
        };
        let points = second.chosen.points();
        let again = points
            .iter()
            .filter(|point| first.chosen.contains(**point))
            .count();
        let is_of_it = again as f32 > SAME * points.len() as f32;
        let is_much = gaze.central_of(&second.chosen) > LEAST_LEFT * gaze.central_of(&first.chosen);
        let ends = second.chosen.goes_on().is_none();
        Ok(if ends && is_of_it && is_much {
            second
        } else {
            first
        })
    }

    /// Divides it at the `ground`, in front of a `wall`.
    fn divided_at(
        &self,
        ground: Option<Plane>,
        wall: Option<Plane>,
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
            wall,
            parts,
            chosen,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::DVec3;

    use super::super::hint::{Click, WorldBox};
    use super::super::look::prepared;
    use super::super::staged::{Ball, Stage};
    use super::*;
    use crate::config::{Preset, TrainConfig};
    use crate::prepare::{Frame, TrainView};
    use crate::train::carve::fusion::fuse;

    #[test]
    fn what_stands_on_a_shelf_before_a_wall_is_parted_from_it() {
        let stage = Stage {
            table: -0.2,
            wall: 0.4,
            is_checkered: true,
            balls: vec![Ball {
                centre: Vec3::ZERO,
                radius: 0.25,
                colour: [200, 60, 40],
            }],
        };
        let from = (0..16).map(|i| (0.1 * f64::from(i) - 0.75, 0.5 + 0.5 * f64::from(i % 2)));
        let photos = from
            .map(|(angle, up)| stage.photo(DVec3::new(2.5 * angle.sin(), -2.5 * angle.cos(), up)));
        let named = photos.zip(0..).map(|(view, number)| TrainView {
            name: format!("{number}.png"),
            ..view
        });
        let views: Vec<TrainView> = named.collect();
        let region = Frame {
            centre: DVec3::ZERO,
            half_side: 0.5,
        };
        let data = prepared(&views, region, &TrainConfig::preset(Preset::Default));
        let depths: Vec<DepthPicture> = views
            .iter()
            .map(|view| stage.depths(view, &region))
            .collect();
        let distances = fuse(&data, &depths, &data.map, 0.5, f32::INFINITY);
        let learnt = Learnt {
            data: &data,
            depths: &depths,
            distances: &distances,
        };
        let wall = Plane {
            normal: Vec3::NEG_Y,
            offset: -0.8,
            thickness: 0.03,
        };
        let surface = plane::surface_points(&distances, data.map.resolution());
        let divided = |hint: &Hint| {
            learnt
                .divided(Some(wall), surface.clone(), hint, 1)
                .unwrap()
        };
        let front = Vec3::new(0.0, -0.49, 0.0);
        let on_shelf = Vec3::new(0.7, -0.3, -0.41);
        let click_on = |point: Vec3| {
            let world = data.frame.world_from_normalised(point);
            let (pixel, _) = views[8].project(world).unwrap();
            Hint::Click(Click {
                view: views[8].name.clone(),
                x: pixel.x.into(),
                y: pixel.y.into(),
            })
        };
        for hint in [Hint::Nothing, click_on(front)] {
            let found = divided(&hint);
            assert!(found.ground.unwrap().normal.z > 0.99);
            assert_eq!(found.wall, Some(wall));
            assert!(found.chosen.contains(front) && !found.chosen.contains(on_shelf));
            assert_eq!(found.chosen.goes_on(), None);
        }
        // The shelf itself is clicked on, and all of a box is wanted.
        let all = WorldBox {
            low: [-0.5; 3],
            high: [0.5; 3],
        };
        for hint in [click_on(on_shelf), Hint::Box(all)] {
            let found = divided(&hint);
            assert_eq!((found.ground, found.wall), (Some(wall), None));
            assert!(found.chosen.contains(front) && found.chosen.contains(on_shelf));
        }
    }
}
