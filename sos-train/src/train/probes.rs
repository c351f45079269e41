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
    mattes: Vec<f32>,
}

impl Probes {
    pub(super) fn new(data: &Prepared, config: &TrainConfig) -> Self {
        let sampler = Sampler::new(data, config.seed ^ 0x0070_0be5, 1.0);
        Self {
            rays: sampler.draw(data, 0, PROBES).rays,
            mattes: Vec::new(),
        }
    }

    /// Mean change of the mattes since the last call.
    pub(super) fn change(&mut self, trainer: &Trainer) -> f32 {
        let scene: FrozenScene = trainer.freeze();
        let mattes = scene.mattes(&self.rays);
        let change = if self.mattes.len() == mattes.len() {
            let sum: f32 = mattes
                .iter()
                .zip(&self.mattes)
                .map(|(a, b)| (a - b).abs())
                .sum();
            sum / mattes.len().max(1) as f32
        } else {
            1.0
        };
        self.mattes = mattes;
        change
    }
}
