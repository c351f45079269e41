//! One look at a region: the whole scene is learnt there, and falls into parts.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use io_colmap::SparsePoint;
use scene_decomp::probability::ProbabilityMap;

use super::hint::Hint;
use super::humps;
use super::parts::{PartSet, Parts};
use super::plane;
use super::region;
use crate::config::TrainConfig;
use crate::prepare::error::PrepareError;
use crate::prepare::outline::{outline, silhouette};
use crate::prepare::votes::{Quorum, ViewTrust};
use crate::prepare::{Frame, Prepared, TrainView};
use crate::train::Trainer;
use crate::train::carve::depth::{DepthPicture, depth_pictures};
use crate::train::carve::fusion::fuse;

/// Voxels per axis on which shapes are told apart.
const RESOLUTION: usize = 160;
/// Rays whose depths are asked, in all views together, at most.
const RAYS: usize = 4_000_000;
/// Pixels between the rays of a silhouette.
const STRIDE: u32 = 2;
/// How much of what was found must be found again for it to be the same.
const SAME: f32 = 0.5;
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
    /// The fused distances of what was learnt, `[RESOLUTION^3]`, without humps.
    solid: Vec<f32>,
    /// Whether there was a ground to be taken away.
    pub(super) has_ground: bool,
}

impl Look {
    /// Learns the `region` and chooses the object in it; `None` when `interrupt` came up.
    pub(super) fn new(
        views: &[TrainView],
        points: &[SparsePoint],
        hint: &Hint,
        config: &TrainConfig,
        region: Frame,
        interrupt: &AtomicBool,
        progress: &mut dyn FnMut(u32, u32),
    ) -> Result<Option<Self>, PrepareError> {
        let data = prepared(views, region, config);
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
        let mut solid = fuse(&data, &depths, &data.map, 0.5, f32::INFINITY);
        let cameras: Vec<Vec3> = data
            .views
            .iter()
            .map(|view| view.world_from_camera(&data.frame).translation.into())
            .collect();
        let sparse: Vec<Vec3> = points
            .iter()
            .map(|point| data.frame.normalised_from_world(point.position))
            .collect();
        let surface = plane::surface_points(&solid, RESOLUTION);
        let ground = match plane::ground(&sparse, &cameras, config.seed) {
            Some(ground) => Some(plane::settled(ground, &surface, &cameras)),
            None => plane::ground_of_surface(&surface, &cameras, config.seed),
        };
        if let Some(ground) = &ground {
            let eyes = humps::Eyes::new(&data.views, &data.frame, &depths);
            humps::flatten(&mut solid, RESOLUTION, ground, &eyes);
        }
        hint.clip(&mut solid, RESOLUTION, &data.frame);
        let parts = Parts::new(&solid, RESOLUTION, ground.as_ref(), upwards(&data));
        let chosen = hint.choose(&parts, &data, &depths, &solid)?;
        Ok(Some(Self {
            data,
            depths,
            chosen,
            parts,
            solid,
            has_ground: ground.is_some(),
        }))
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
        let least = CORE_SHARE * self.chosen.central();
        (1..=MOST_LAYERS).find_map(|layers| {
            let split = self.parts.split(&self.chosen, layers);
            let core = hint
                .choose(&split, &self.data, &self.depths, &self.solid)
                .ok()?;
            (core.goes_on().is_none() && core.central() >= least).then_some(core)
        })
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

/// The mean of the cameras' upward directions, in the normalised frame.
fn upwards(data: &Prepared) -> Vec3 {
    let up = |view: &TrainView| -> Vec3 {
        let world_from_camera = view.world_from_camera(&data.frame);
        world_from_camera
            .transform_vector3(Vec3::NEG_Y)
            .normalize_or_zero()
    };
    data.views.iter().map(up).sum::<Vec3>() / data.views.len().max(1) as f32
}

/// The region of interest, in which everything may be the object.
fn prepared(views: &[TrainView], frame: Frame, config: &TrainConfig) -> Prepared {
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
        notes: Vec::new(),
    }
}
