//! One look at a region: the whole scene is learnt there, and falls into parts.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, Vec3};
use image::GrayImage;
use scene_decomp::probability::ProbabilityMap;

use super::beyond::{is_within, lies_beyond, seen_from, spread_beyond};
use super::division::{Division, Learnt, SAME};
use super::gaze::Gaze;
use super::hint::Hint;
use super::masks;
use super::part_set::PartSet;
use super::parts::Parts;
use super::places::Places;
use super::plane::{self, Plane};
use super::region;
use super::seams;
use super::sparse_ground;
use crate::config::TrainConfig;
use crate::prepare::error::PrepareError;
use crate::prepare::outline::{outline, silhouette};
use crate::prepare::votes::{Quorum, ViewTrust};
use crate::prepare::{Frame, Prepared, Sights, TrainView};
use crate::train::Trainer;
use crate::train::carve::depth::{DepthPicture, depth_pictures};
use crate::train::carve::fusion::fuse;

/// Voxels per axis on which shapes are told apart.
const RESOLUTION: usize = 160;
/// Rays whose depths are asked, in all views together, at most.
const RAYS: usize = 4_000_000;
/// Pixels between the rays of a silhouette.
const STRIDE: u32 = 2;
/// How much of what is central about it one of its cores must have to be the object.
const CORE_SHARE: f32 = 0.5;
/// Layers of voxels that are taken off at most to find cores.
const MOST_LAYERS: usize = 4;

/// What was found in a region.
pub(super) struct Look {
    /// All views, in the region's frame.
    pub(super) data: Prepared,
    /// What each of them shows.
    pub(super) depths: Vec<DepthPicture>,
    /// The object.
    pub(super) chosen: PartSet,
    /// What it was chosen from.
    pub(super) parts: Parts,
    /// The fused distances of what was learnt, `[RESOLUTION^3]`.
    pub(super) learnt: Vec<f32>,
    /// The same as it was [divided](Division).
    pub(super) solid: Vec<f32>,
    /// What things stand on, or before; taken away.
    pub(super) ground: Option<Plane>,
    /// What is behind that, if it was taken away as well.
    pub(super) wall: Option<Plane>,
    /// The look at a smaller region whose object this one's goes on from: it has what lies there.
    within: Option<Box<Self>>,
}

impl Look {
    /// Learns the `region` and chooses the object in it; `None` when `interrupt` came up.
    pub(super) fn new(
        views: &[TrainView],
        places: &Places,
        hint: &Hint,
        config: &TrainConfig,
        region: Frame,
        interrupt: &AtomicBool,
        progress: &mut dyn FnMut(u32, u32),
    ) -> Result<Option<Self>, PrepareError> {
        let data = Prepared {
            sights: places.sights.clone(),
            ..prepared(views, region, config)
        };
        let mut trainer = Trainer::new(config, &data)?;
        while trainer.step_number() < config.steps {
            if interrupt.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let report = trainer.step(&data);
            if !report.is_finite() {
                return Err(PrepareError::Diverged(trainer.step_number()));
            }
            progress(trainer.step_number(), config.steps);
        }
        let depths = depth_pictures(&trainer.freeze_before(), &data, RAYS);
        Self::of_depths(data, depths, &places.points, hint, config.seed).map(Some)
    }

    /// Chooses the object in what the views of `data` show, by their depths.
    fn of_depths(
        data: Prepared,
        depths: Vec<DepthPicture>,
        points: &[DVec3],
        hint: &Hint,
        seed: u64,
    ) -> Result<Self, PrepareError> {
        let learnt = fuse(&data, &depths, &data.map, 0.5, f32::INFINITY);
        let sparse: Vec<Vec3> = points
            .iter()
            .map(|point| data.frame.normalised_from_world(*point))
            .collect();
        let region = Learnt {
            data: &data,
            depths: &depths,
            distances: &learnt,
        };
        let views = data.views.iter();
        let cameras: Vec<Vec3> = views.map(|view| view.camera_centre(&data.frame)).collect();
        let surface = plane::surface_points(&learnt, RESOLUTION);
        let ground = sparse_ground::ground(&sparse, &cameras, seed)
            .map(|ground| sparse_ground::settled(ground, &surface, &cameras))
            .filter(|ground| !plane::is_side(ground, &surface))
            .or_else(|| plane::ground_of_surface(&surface, &cameras, seed));
        let Division {
            solid,
            ground,
            wall,
            parts,
            chosen,
        } = region.divided(ground, surface, hint, seed)?;
        Ok(Self {
            data,
            depths,
            chosen,
            parts,
            learnt,
            solid,
            ground,
            wall,
            within: None,
        })
    }

    /// Whether a point lies in, or behind, what was taken away.
    pub(super) fn is_ground(&self, point: Vec3) -> bool {
        [self.ground, self.wall]
            .into_iter()
            .flatten()
            .any(|plane| plane.has(point))
    }

    /// Whether the object goes on beyond the region, unless the region is the user's; see [`PartSet::goes_on`].
    pub(super) fn goes_on(&self, hint: &Hint) -> bool {
        !matches!(hint, Hint::Box(_)) && self.chosen.goes_on().is_some()
    }

    /// The larger region that may hold what lies beyond this one, if anything does and this one is not the user's.
    pub(super) fn region_beyond(&self, hint: &Hint) -> Option<Frame> {
        let (towards, growth) = match hint {
            Hint::Box(_) => None,
            _ => match self.chosen.goes_on() {
                Some(towards) => Some((towards, region::ENLARGED)),
                None => self
                    .chosen
                    .reaches_on()
                    .map(|towards| (towards, region::ENLARGED_FOR_TIP)),
            },
        }?;
        Some(region::enlarged(&self.data.frame, towards, growth))
    }

    /// The object as a core of what was found, if that hangs together with what lies beyond the region by bridges
    /// that are thinner than it: streaks of what was learnt in a short time, or things that touch.
    pub(super) fn parted(&self, hint: &Hint) -> Option<PartSet> {
        if matches!(hint, Hint::Masks(_)) {
            // What they show is the object, wherever it ends.
            return None;
        }
        let gaze = Gaze::of(&self.data);
        let least = CORE_SHARE * gaze.central_of(&self.chosen);
        (1..=MOST_LAYERS).find_map(|layers| {
            let split = self.parts.split(&self.chosen, layers);
            let core = hint
                .choose(&split, &self.data, &self.depths, &self.solid)
                .ok()?;
            (core.goes_on().is_none() && gaze.central_of(&core) >= least).then_some(core)
        })
    }

    /// The object of `before` where it hangs together with too much in this wider look: what it was and what of it lies beyond, if there
    /// is any and it ends here. Gives `before` back otherwise, and where the object can be parted, masks say what it is everywhere, or no
    /// ground is known, which what goes on may be then.
    pub(super) fn going_on_from(mut self, before: Self, hint: &Hint) -> Result<Self, Box<Self>> {
        let is_parted = || before.goes_on(hint) && before.parted(hint).is_some();
        if before.ground.is_none() || matches!(hint, Hint::Masks(_)) || is_parted() {
            return Err(Box::new(before));
        }
        match spread_beyond(&before, &self) {
            Some(object) if object.goes_on().is_none() => self.chosen = object,
            _ => return Err(Box::new(before)),
        }
        if !lies_beyond(&before, &self) || !self.shows_more_of(&before) {
            return Err(Box::new(before));
        }
        self.within = Some(Box::new(before));
        Ok(self)
    }

    /// Ends the object where colours change and surfaces crease, unless masks said where it ends, or it was followed beyond its
    /// region by these already.
    pub(super) fn settle_ends(&mut self, hint: &Hint) {
        if matches!(hint, Hint::Masks(_)) || self.goes_beyond_another() {
            return;
        }
        if let Some(object) = seams::settled(self) {
            self.chosen = object;
        }
    }

    /// Whether its object was found in a smaller region, and went on from there.
    pub(super) fn goes_beyond_another(&self) -> bool {
        self.within.is_some()
    }

    /// The look in which its object was chosen from parts.
    pub(super) fn first(&self) -> &Self {
        self.within.as_deref().unwrap_or(self)
    }

    /// White where a view, by its number, shows the object.
    pub(super) fn mask(&self, view: usize) -> GrayImage {
        let (photo, depth) = (&self.data.views[view], &self.depths[view]);
        let fused = (self.learnt.as_slice(), RESOLUTION);
        let Some(within) = &self.within else {
            return masks::project(photo, &self.data.frame, depth, fused, |p| {
                self.chosen.contains(p)
            });
        };
        let mut mask = masks::project(photo, &self.data.frame, depth, fused, |p| {
            self.chosen.contains(p) && !is_within(seen_from(within, self, p))
        });
        // Up to the region's very side, or there would be a gap.
        let there = within.mask(view);
        for (pixel, there) in mask.iter_mut().zip(there.iter()) {
            *pixel = (*pixel).max(*there);
        }
        mask
    }

    /// Whether this is the same object, and less of it lies beyond the region.
    pub(super) fn shows_more_of(&self, other: &Self) -> bool {
        let there = |point: Vec3| {
            let world = other.data.frame.world_from_normalised(point);
            self.chosen
                .contains(self.data.frame.normalised_from_world(world))
        };
        let found = other.chosen.points();
        let again = found.iter().filter(|point| there(**point)).count();
        again as f32 > SAME * found.len() as f32
            && self.chosen.border_share() < other.chosen.border_share()
    }
}

/// The region of interest, in which everything may be the object.
pub(super) fn prepared(views: &[TrainView], frame: Frame, config: &TrainConfig) -> Prepared {
    let views: Vec<TrainView> = views
        .iter()
        .map(|view| TrainView {
            mask: None,
            ..view.clone()
        })
        .collect();
    let map = ProbabilityMap::new(RESOLUTION, vec![1.0; RESOLUTION.pow(3)]);
    let outlines = views
        .iter()
        .map(|view| {
            let everything = silhouette(view, &frame, &map, STRIDE);
            outline(view, &everything, STRIDE, 0.0, 1, &config.prepare)
        })
        .collect();
    let trust = ViewTrust(vec![0.0; views.len()]);
    Prepared {
        given_masks: vec![None; views.len()],
        views,
        trust,
        frame,
        map,
        outlines,
        quorum: Quorum::OfAll,
        points: Vec::new(),
        sights: Sights::default(),
        notes: Vec::new(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::staged::{Ball, Stage};
    use super::*;
    use crate::config::Preset;

    const NEAR: Vec3 = Vec3::new(-0.15, 0.0, 0.0);
    const FAR: Vec3 = Vec3::new(0.35, 0.0, -0.15);
    const OTHER: Vec3 = Vec3::new(0.73, 0.0, -0.15);
    const OBJECT: [u8; 3] = [200, 60, 40];

    /// An object of two balls on a table, and another thing that touches it.
    fn stage() -> Stage {
        let ball = |centre, radius, colour| Ball {
            centre,
            radius,
            colour,
        };
        Stage {
            table: -0.35,
            wall: f32::INFINITY,
            is_checkered: false,
            balls: vec![
                ball(NEAR, 0.35, OBJECT),
                ball(FAR, 0.2, OBJECT),
                ball(OTHER, 0.2, [40, 60, 200]),
            ],
        }
    }

    /// From all around, from low and from high.
    fn photos(stage: &Stage) -> Vec<TrainView> {
        (0..24)
            .map(|i| (0.26 * f64::from(i), if i % 2 == 0 { 0.6 } else { 2.0 }))
            .map(|(angle, height)| DVec3::new(2.5 * angle.cos(), 2.5 * angle.sin(), height))
            .map(|from| stage.photo(from))
            .collect()
    }

    /// How many pixels of a view's mask are not the object's by their colour in its photo, or are and not in the mask.
    fn wrong(mask: &GrayImage, view: &TrainView) -> usize {
        let pixels = view.photo.pixels().zip(mask.pixels());
        pixels
            .filter(|(photo, mask)| (photo.0 == OBJECT) != (mask.0[0] > 0))
            .count()
    }

    fn look(stage: &Stage, views: &[TrainView], region: Frame) -> Look {
        let config = TrainConfig::preset(Preset::Default);
        let data = prepared(views, region, &config);
        let depths = views.iter().map(|view| stage.depths(view, &region));
        Look::of_depths(data, depths.collect(), &[], &Hint::Nothing, 1).unwrap()
    }

    #[test]
    fn an_object_is_followed_beyond_its_region_and_no_further_than_it_goes() {
        let stage = stage();
        let views = photos(&stage);
        let region = Frame {
            centre: DVec3::new(-0.05, 0.0, 0.0),
            half_side: 0.5,
        };
        let near = look(&stage, &views, region);
        let there = |look: &Look, world: Vec3| {
            let point = look.data.frame.normalised_from_world(world.as_dvec3());
            look.chosen.contains(point)
        };
        let on = |ball: Vec3, radius: f32, way: Vec3| ball + (radius - 0.005) * way.normalize();
        let beyond = on(FAR, 0.2, Vec3::new(0.8, 0.0, 1.0));
        let other = on(OTHER, 0.2, Vec3::new(-0.5, 0.0, 1.0));
        let first = on(NEAR, 0.35, Vec3::new(-0.3, 0.2, 1.0));
        assert!(there(&near, first) && !there(&near, beyond));
        let larger = near.region_beyond(&Hint::Nothing).unwrap();
        let wider = look(&stage, &views, larger);
        // There both are one thing.
        assert!(there(&wider, beyond) && there(&wider, other));
        let near_mask = near.mask(0);
        let all = wider.going_on_from(near, &Hint::Nothing).ok().unwrap();
        assert!(there(&all, first) && there(&all, beyond) && !there(&all, other));
        assert!(all.goes_beyond_another() && all.region_beyond(&Hint::Nothing).is_none());
        let (before, after) = (wrong(&near_mask, &views[0]), wrong(&all.mask(0), &views[0]));
        assert!(after < 16 && 2 * after < before, "{before}, {after}");
    }

    #[test]
    fn an_object_ends_where_its_colour_does_and_not_where_a_part_was_cut() {
        let stage = Stage {
            table: -0.1,
            wall: f32::INFINITY,
            is_checkered: false,
            balls: vec![Ball {
                centre: Vec3::ZERO,
                radius: 0.3,
                colour: OBJECT,
            }],
        };
        let views = photos(&stage);
        let region = Frame {
            centre: DVec3::ZERO,
            half_side: 0.5,
        };
        let mut found = look(&stage, &views, region);
        // Three voxels of its foot are the ground's, or of the ground its own.
        for cut in [0.02, -0.02] {
            let is_object = |p: Vec3| 0.5 * p.z > stage.table + cut && 0.5 * p.length() < 0.33;
            let surface = found.learnt.iter().enumerate().filter(|(_, d)| **d < 0.0);
            let labels = surface
                .map(|(cell, _)| (cell, is_object(ProbabilityMap::centre(RESOLUTION, cell))));
            found.chosen = PartSet::of_surface(RESOLUTION, labels);
            let before = wrong(&found.mask(0), &views[0]);
            found.settle_ends(&Hint::Nothing);
            let after = wrong(&found.mask(0), &views[0]);
            assert!(2 * after < before, "{cut}: {before}, {after}");
        }
    }
}
