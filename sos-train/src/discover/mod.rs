//! Finding the object without masks.
//!
//! A capture says what it is of by where its cameras look. So a background field learns the whole
//! region of interest ([`region`]) for a while; its depths, fused, are solid shapes; the plane that
//! things stand on is taken away ([`plane`]); and of the parts that remain, the object is the one in
//! the middle, or the one that a hint points at ([`parts`]). Every view's pixels that show this part
//! are its rough mask ([`masks`]), and from there on a run is like any other.
//!
//! The whole of it is open point 5 of the method, which leaves the choice of the surface to the reader.

pub mod hint;
pub mod masks;
pub mod parts;
pub mod plane;
pub mod region;

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use io_colmap::SparsePoint;
use scene_decomp::probability::ProbabilityMap;

use crate::config::{Preset, TrainConfig, Transparency};
use crate::prepare::error::PrepareError;
use crate::prepare::mask::Mask;
use crate::prepare::outline::{outline, silhouette};
use crate::prepare::votes::ViewTrust;
use crate::prepare::{Prepared, TrainView};
use crate::train::Trainer;
use crate::train::carve::depth::depth_pictures;
use crate::train::carve::fusion::fuse;

pub use hint::Hint;
use parts::Parts;

/// Voxels per axis on which shapes are told apart.
const RESOLUTION: usize = 160;
/// Rays whose depths are asked, in all views together, at most.
const RAYS: usize = 1_500_000;
/// Pixels between the rays of a silhouette.
const STRIDE: u32 = 2;
/// Steps that the whole scene is learnt for, as a share of the run's, and at most.
const STEP_SHARE: f32 = 0.3;
const MOST_STEPS: u32 = 2400;
/// What short runs spend on it, as far as they have as many: with fewer the wrong thing is found.
const WORTHWHILE_STEPS: u32 = 1500;

/// The object that was found.
#[derive(Debug)]
pub struct Discovery {
    /// A rough mask for each view, white is the object.
    pub masks: Vec<Mask>,
    /// What was chosen and why, for the user.
    pub notes: Vec<String>,
}

/// Looks for the object that `views` are of. `None` when `interrupt` came up.
///
/// `progress` is told the steps done and to be done.
///
/// # Errors
/// When cameras, points and hints do not determine a region, or nothing stands in it.
pub fn find_object(
    views: &[TrainView],
    points: &[SparsePoint],
    hint: &Hint,
    config: &TrainConfig,
    interrupt: &AtomicBool,
    mut progress: impl FnMut(u32, u32),
) -> Result<Option<Discovery>, PrepareError> {
    let config = search_config(config);
    let data = search_scene(views, points, hint, &config)?;
    let mut trainer = Trainer::new(&config, &data)?;
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
    let solid = fuse(&data, &depths, &data.map, 0.5);
    let cameras: Vec<Vec3> = data
        .views
        .iter()
        .map(|view| view.world_from_camera(&data.frame).translation.into())
        .collect();
    let sparse: Vec<Vec3> = points
        .iter()
        .map(|point| data.frame.normalised_from_world(point.position))
        .collect();
    let ground = plane::ground(&sparse, &cameras, config.seed).or_else(|| {
        let surface = plane::surface_points(&solid, RESOLUTION);
        plane::ground_of_surface(&surface, &cameras, config.seed)
    });
    let parts = Parts::new(&solid, RESOLUTION, ground.as_ref());
    let chosen = hint.choose(&parts, &data, &depths)?;
    let masks = data
        .views
        .iter()
        .zip(&depths)
        .map(|(view, depth)| {
            let mask = masks::project(view, &data.frame, depth, &chosen);
            Mask::of_white(&mask, &view.store)
        })
        .collect::<Result<_, _>>()?;
    let notes = vec![format!(
        "no masks: {} taken for the object, one of {} parts in the box around ({:.3}, {:.3}, {:.3}) \
         of side {:.3}, {}; found_masks/ shows it",
        hint.reason(),
        parts.count(),
        data.frame.centre.x,
        data.frame.centre.y,
        data.frame.centre.z,
        2.0 * data.frame.half_side,
        match ground {
            Some(_) => "without the ground it stands on",
            None => "where no ground was found",
        },
    )];
    Ok(Some(Discovery { masks, notes }))
}

/// The settings of the search: the background alone, as a density, whatever the run itself is to be.
fn search_config(run: &TrainConfig) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Default);
    config.seed = run.seed;
    config.device.clone_from(&run.device);
    config.steps = ((STEP_SHARE * run.steps as f32) as u32)
        .clamp(WORTHWHILE_STEPS.min(run.steps), MOST_STEPS)
        .max(1);
    config.schedule.carve = 1.0;
    config.model.background = Transparency::Density;
    config.loss.mask = 0.0;
    config.loss.mask_trusted = 0.0;
    config.loss.hidden = 0.0;
    config
}

/// The region of interest, in which everything may be the object.
fn search_scene(
    views: &[TrainView],
    points: &[SparsePoint],
    hint: &Hint,
    config: &TrainConfig,
) -> Result<Prepared, PrepareError> {
    let views: Vec<TrainView> = views
        .iter()
        .map(|view| TrainView {
            mask: None,
            ..view.clone()
        })
        .collect();
    let frame = hint.region(&views, points)?;
    let map = ProbabilityMap::new(RESOLUTION, vec![1.0; RESOLUTION.pow(3)]);
    let outlines = views
        .iter()
        .map(|view| {
            let everything = silhouette(view, &frame, &map, STRIDE);
            outline(view, &everything, STRIDE, 0.0, 1, &config.prepare)
        })
        .collect();
    let trust = ViewTrust(vec![0.0; views.len()]);
    Ok(Prepared {
        given_masks: vec![None; views.len()],
        views,
        trust,
        frame,
        map,
        outlines,
        points: Vec::new(),
        notes: Vec::new(),
    })
}
