//! The scene: FoCoR and BaCo, and how sharply each is drawn.

use burn::Tensor;
use burn::module::{Module, Param};
use burn::tensor::Device;
use hashgrid::GridConfig;
use serde::{Deserialize, Serialize};

use crate::surface::{InitialShape, Surface, SurfaceConfig};

/// Half the side of BaCo's cube: contracted space.
pub const BACKGROUND_HALF_SIDE: f32 = 2.0;

/// The sizes of both fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneConfig {
    /// FoCoR's grid, over the object's box.
    pub object_grid: GridConfig,
    /// BaCo's grid, over contracted space.
    pub background_grid: GridConfig,
    /// Width of hidden layers.
    pub hidden: usize,
    /// Width of FoCoR's geometry feature.
    pub object_features: usize,
    /// Width of BaCo's geometry feature.
    pub background_features: usize,
    /// FoCoR's shape before training.
    pub object_initial: InitialShape,
    /// Further inputs of BaCo's colour network: one, m^P, or none.
    pub background_extra: usize,
    /// BaCo's shape before training.
    pub background_initial: InitialShape,
    /// Degree of the harmonics of view directions that colours depend on; 1: the direction alone.
    pub direction_degree: u32,
    /// `s` in `b = exp(10 s)`, the sharpness of the logistic density, before training.
    pub sharpness_start: f32,
}

impl SceneConfig {
    /// FoCoR, in the box `[-1, 1]^3`, with an alpha head.
    #[must_use]
    pub fn object(&self) -> SurfaceConfig {
        SurfaceConfig {
            grid: self.object_grid.clone(),
            hidden: self.hidden,
            features: self.object_features,
            extra: 0,
            direction_degree: self.direction_degree,
            outputs: 4,
            half_side: 1.0,
            beta: 100.0,
            initial: self.object_initial,
        }
    }

    /// BaCo, over contracted space, where m^P is a further input of its colour.
    #[must_use]
    pub fn background(&self) -> SurfaceConfig {
        SurfaceConfig {
            grid: self.background_grid.clone(),
            hidden: self.hidden,
            features: self.background_features,
            extra: self.background_extra,
            direction_degree: self.direction_degree,
            outputs: 3,
            half_side: BACKGROUND_HALF_SIDE,
            beta: 100.0,
            initial: self.background_initial,
        }
    }
}

/// Both fields.
#[derive(Module, Debug)]
pub struct Scene {
    /// FoCoR, the object.
    pub object: Surface,
    /// BaCo, the scene without it.
    pub background: Surface,
}

impl Scene {
    /// Seeded and geometrically initialised.
    ///
    /// # Panics
    /// When a field's configuration is not valid: see [`SurfaceConfig::validate`].
    #[must_use]
    pub fn new(config: &SceneConfig, seed: u64, device: &Device) -> Self {
        Self {
            object: Surface::new(&config.object(), seed, device),
            background: Surface::new(&config.background(), seed ^ 0x9e37_79b9, device),
        }
    }
}

/// The logistic density's sharpness of both fields, trained at a rate of its own.
#[derive(Module, Debug)]
pub struct Sharpness {
    /// `s` of FoCoR and BaCo, `[2]`.
    pub s: Param<Tensor<1>>,
}

impl Sharpness {
    /// Both at `start`.
    #[must_use]
    pub fn new(start: f32, device: &Device) -> Self {
        Self {
            s: Param::from_tensor(Tensor::from_floats([start, start], device)),
        }
    }

    /// Keeps both `s` within `[smallest, largest]`.
    pub fn limit(&mut self, smallest: f32, largest: f32) {
        let s = self.s.clone();
        self.s = s.map(|s| {
            let tracked = s.is_require_grad();
            // By way of the inner tensor, so that the result is a leaf again.
            let s = Tensor::from_inner(s.inner().clamp(smallest, largest));
            if tracked { s.require_grad() } else { s }
        });
    }

    /// `b = exp(10 s)`, `[2]` (NeuS's parametrisation: one rate serves b from 20 to thousands).
    #[must_use]
    pub fn b(&self) -> Tensor<1> {
        self.s.val().mul_scalar(10.0).exp()
    }
}
