//! How much mattes still change over a run.

use neus_render::rays::Ray;

use super::Trainer;
use super::sampler::Sampler;
use crate::config::TrainConfig;
use crate::prepare::Prepared;
use crate::render::rays::FrozenScene;

/// Rays whose mattes are followed.
const PROBES: usize = 1024;

/// Fixed rays on which the matte is followed.
pub(super) struct Probes {
    rays: Vec<Ray>,
    /// None yet before the first look.
    mattes: Option<Vec<f32>>,
}

impl Probes {
    pub(super) fn new(data: &Prepared, config: &TrainConfig) -> Self {
        let sampler = Sampler::new(data, config.seed ^ 0x0070_0be5, 1.0);
        Self {
            rays: sampler.draw(data, 0, PROBES).rays,
            mattes: None,
        }
    }

    /// Mean change of the mattes since the last call; `None` the first time.
    pub(super) fn change(&mut self, trainer: &Trainer) -> Option<f32> {
        let scene: FrozenScene = trainer.freeze();
        let mattes = scene.mattes(&self.rays);
        let change = self.mattes.as_ref().map(|before| {
            let pairs = mattes.iter().zip(before);
            let sum: f32 = pairs.map(|(now, before)| (now - before).abs()).sum();
            sum / mattes.len().max(1) as f32
        });
        self.mattes = Some(mattes);
        change
    }
}
