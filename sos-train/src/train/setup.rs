//! From settings and a prepared scene to a trainer at step 0.

use std::sync::Arc;

use hashgrid::{GridConfig, GridLayout, LazyAdam, LazyAdamConfig};
use scene_decomp::{InitialShape, Scene, SceneConfig, Sharpness, SurfaceVotes};

use super::adam::NetworkOptimiser;
use super::agreement::Agreement;
use super::ahead::Ahead;
use super::cameras::Cameras;
use super::clock::StepClock;
use super::contested::Contested;
use super::grids::FieldGrids;
use super::outlook::Outlook;
use super::sampler::Sampler;
use super::schedule;
use super::step::StepContext;
use super::{Trainer, gradient_sinks};
use crate::config::{Fields, Interpolation, TrainConfig, Transparency};
use crate::device::{ChosenDevice, DeviceKind, choose, verify};
use crate::median::median;
use crate::prepare::Prepared;
use crate::prepare::error::PrepareError;
use crate::prepare::mask_faults::MaskFaults;

/// Growth from level to level when their number is left to us.
const GROWTH: f32 = 1.5;

/// Levels of a grid when their number is left to us, at most.
pub(crate) const MOST_LEVELS: usize = 16;
/// Cells a side of the finest grid when that is left to us: least and most.
pub(crate) const FINEST: [u32; 2] = [128, 2048];

/// Refuses tables that the device cannot bind as one buffer.
fn check_fits(
    chosen: &ChosenDevice,
    asked: &str,
    grids: [&GridLayout; 2],
) -> Result<(), PrepareError> {
    let Some(limit) = chosen.largest_binding else {
        return Ok(());
    };
    let entries = grids.map(GridLayout::entries).into_iter().max();
    let bytes = 8 * entries.unwrap_or(0) as u64;
    if bytes <= limit {
        return Ok(());
    }
    Err(PrepareError::Device {
        name: asked.to_owned(),
        remedy: format!(
            "a hash table of {} MiB is more than the {} MiB this device can bind; set \
             model.log2_table_size or model.levels lower, or choose --device cpu",
            bytes >> 20,
            limit >> 20
        ),
    })
}

/// The finest grid resolution that the photos can tell: a cell as wide as a pixel at the object.
fn finest_resolution(scene: &Prepared) -> u32 {
    let mut cells: Vec<f64> = scene
        .views
        .iter()
        .map(|view| 2.0 / view.pixel_at_object(&scene.frame))
        .collect();
    (median(&mut cells).unwrap_or(512.0) as u32).clamp(FINEST[0], FINEST[1])
}

/// Sizes of the model for a scene.
#[must_use]
pub fn scene_config(config: &TrainConfig, scene: &Prepared) -> SceneConfig {
    let model = &config.model;
    let finest = match model.finest_resolution {
        // A base that was set holds, however few cells the photos tell.
        0 => finest_resolution(scene).max(model.base_resolution),
        fixed => fixed,
    };
    let levels = match model.levels {
        0 => {
            let octaves = (finest as f32 / model.base_resolution as f32).ln() / GROWTH.ln();
            (octaves.ceil() as usize + 1).clamp(2, MOST_LEVELS)
        }
        fixed => fixed as usize,
    };
    let grid = GridConfig {
        levels,
        base_resolution: model.base_resolution,
        finest_resolution: finest,
        log2_table_size: model.log2_table_size,
        interpolation: match model.interpolation {
            Interpolation::Linear => hashgrid::Interpolation::Linear,
            Interpolation::Smoothstep => hashgrid::Interpolation::Smoothstep,
        },
        hash: model.hash,
        device_reads: model.table_reads,
        ..GridConfig::default()
    };
    let semantic = model.fields == Fields::Semantic;
    // Two densities that begin alike do not part. One field for the whole scene gains nothing by a flat start.
    let by_surface = !semantic && model.foreground == Transparency::Sdf;
    SceneConfig {
        object_grid: grid.clone(),
        background_grid: grid,
        hidden: model.hidden as usize,
        object_features: model.object_features as usize,
        background_features: model.background_features as usize + usize::from(semantic),
        object_initial: match model.foreground {
            Transparency::Sdf => InitialShape::Ball(0.5),
            Transparency::Density => InitialShape::Uneven(2.0),
        },
        // A field that is not split has no use for what splits it.
        background_extra: usize::from(!semantic),
        background_initial: match model.background {
            // Wide enough that cameras start in free space.
            Transparency::Sdf => InitialShape::Hollow(1.8),
            Transparency::Density if by_surface => InitialShape::Flat(2.0),
            Transparency::Density => InitialShape::Uneven(2.0),
        },
        direction_degree: model.direction_degree,
        sharpness_start: config.schedule.sharpness_start,
    }
}

/// Adam for a table.
fn table_adam(layout: &GridLayout, config: &TrainConfig) -> LazyAdam {
    let constants = LazyAdamConfig {
        moments: config.schedule.moments,
        ..LazyAdamConfig::default()
    };
    LazyAdam::with_config(layout, constants)
}

impl Trainer {
    /// A trainer at step 0.
    ///
    /// # Errors
    /// When the device does not exist, or cannot hold the model.
    pub fn new(config: &TrainConfig, scene: &Prepared) -> Result<Self, PrepareError> {
        let chosen = choose(&config.device)?;
        verify(&chosen, &config.device)?;
        let is_cpu = chosen.kind == DeviceKind::Processor;
        let device = chosen.device.clone().autodiff();
        let sizes = scene_config(config, scene);
        let object_layout = Arc::new(GridLayout::new(&sizes.object_grid));
        let background_layout = Arc::new(GridLayout::new(&sizes.background_grid));
        check_fits(
            &chosen,
            &config.device,
            [&object_layout, &background_layout],
        )?;
        let [object_gradient, background_gradient] =
            gradient_sinks([&object_layout, &background_layout]);
        let mut model = Scene::new(&sizes, config.seed, &device);
        model.object.grid.table = model.object.grid.table.set_require_grad(false);
        model.background.grid.table = model.background.grid.table.set_require_grad(false);
        let mut grids = FieldGrids::new(
            config.sampling.occupancy_resolution,
            &scene.map,
            config.prepare.crop_threshold,
        );
        if config.model.foreground == Transparency::Density {
            grids = grids.with_object_density();
        }
        let mut trainer = Self {
            frame: scene.frame,
            object_adam: table_adam(&object_layout, config),
            background_adam: table_adam(&background_layout, config),
            context: StepContext {
                config: config.clone(),
                object_layout,
                background_layout,
                object_gradient,
                background_gradient,
                device: device.clone(),
                points: Vec::new(),
            },
            scene: model,
            sharpness: Sharpness::new(sizes.sharpness_start, &device),
            optimiser: NetworkOptimiser::new(),
            sharpness_optimiser: NetworkOptimiser::new(),
            grids: Arc::new(grids),
            outlook: Outlook::new(is_cpu),
            ahead: Ahead::new(is_cpu),
            device_name: chosen.name,
            device_kind: chosen.kind,
            map: Arc::new(scene.map.clone()),
            sparse_points: scene.points.clone(),
            votes: SurfaceVotes::new(scene.map.resolution()),
            agreement: Agreement::new(scene.views.len()),
            mask_contrasts: Vec::new(),
            mask_faults: MaskFaults::default(),
            contested: Contested::default(),
            cameras: Cameras::default(),
            sampler: Sampler::new(scene, config.seed, config.sampling.object_share)
                .with_sights(config.sampling.sight_share, schedule::sights_end(config)),
            step: 0,
            rays: config.sampling.rays.min(config.sampling.most_rays) as f32,
            rate_scale: 1.0,
            empty_batches: 0,
            clock: StepClock::new(),
        };
        trainer.follow(scene.map.clone());
        Ok(trainer)
    }
}
