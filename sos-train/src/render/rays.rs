//! Renders rays through the trained fields, without gradients.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::{Device, TensorData};
use glam::Vec3;
use neus_render::composite::{
    self, CompositeConfig, background_column, column, composite, object_column,
};
use neus_render::march::{Grids, Jitter, MarchConfig};
use neus_render::rays::Ray;
use scene_decomp::FrozenSurface;
use scene_decomp::probability::ProbabilityMap;

use crate::config::{AlphaSource, TrainConfig, Transparency};
use crate::train::batch::{BatchMarcher, FieldSamples};
use crate::train::grids::FieldGrids;
use crate::train::step::density_of;

/// Rays whose samples are in memory at once.
const CHUNK: usize = 8192;

/// A trained scene, frozen.
#[derive(Debug)]
pub struct FrozenScene {
    /// FoCoR.
    pub object: FrozenSurface,
    /// BaCo.
    pub background: FrozenSurface,
    /// `b` of both fields.
    pub sharpness: [f32; 2],
    /// Occupied space.
    pub grids: FieldGrids,
    /// m^P.
    pub map: ProbabilityMap,
    /// The run's settings.
    pub config: TrainConfig,
}

/// What a ray met. Colours are straight, sRGB in `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderedRay {
    /// The visible object's share of the pixel.
    pub matte: f32,
    /// Colour of both fields.
    pub joint: Vec3,
    /// The object's own colour.
    pub object: Vec3,
    /// The scene's colour without the object.
    pub background: Vec3,
    /// Opacity of the background alone.
    pub background_opacity: f32,
    /// Distance along the ray to the object, in the normalised frame; 0 where there is none.
    pub object_distance: f32,
    /// Distance along the ray to the background behind the object; 0 where there is none.
    pub background_distance: f32,
}

impl FrozenScene {
    /// Renders `rays` of the normalised frame.
    #[must_use]
    pub fn render(&self, rays: &[Ray]) -> Vec<RenderedRay> {
        let mut marcher = BatchMarcher::default();
        rays.chunks(CHUNK)
            .flat_map(|chunk| self.render_chunk(chunk, &mut marcher))
            .collect()
    }

    fn render_chunk(&self, rays: &[Ray], marcher: &mut BatchMarcher) -> Vec<RenderedRay> {
        let sampling = &self.config.sampling;
        let march = MarchConfig {
            step_object: 2.0 / sampling.object_steps as f32,
            background_stride: crate::train::BACKGROUND_STRIDE,
            background_samples: sampling.background_samples,
            jitter: Jitter::Fixed,
            ..MarchConfig::default()
        };
        let grids = Grids {
            object: Some(&self.grids.object),
            background: Some(&self.grids.background),
        };
        let crop = self.config.prepare.crop_threshold;
        let marched = marcher.march(rays, grids, &march, &self.map, crop);
        let object = self.object_rows(&marched.object);
        let background = self.background_rows(&marched.background);
        let packing = Arc::new(marched.packing);
        let joint = self.composite(object.clone(), background.clone(), &packing);
        // The background's own depth: the same op with the object left out.
        let alone = Arc::new(composite::Packing::new(
            packing.ray_offsets().to_vec(),
            packing.t().to_vec(),
            packing.dt().to_vec(),
            Vec::new(),
            packing.background().to_vec(),
        ));
        let alone = self.composite(Vec::new(), background, &alone);
        joint
            .chunks_exact(column::COUNT)
            .zip(alone.chunks_exact(column::COUNT))
            .map(|(row, alone)| rendered(row, alone))
            .collect()
    }

    fn composite(
        &self,
        object: Vec<f32>,
        background: Vec<f32>,
        packing: &Arc<composite::Packing>,
    ) -> Vec<f32> {
        let device = Device::flex();
        let tensor = |values: Vec<f32>, columns: usize| {
            let rows = values.len() / columns;
            Tensor::<2>::from_data(TensorData::new(values, [rows, columns]), &device)
        };
        let out = composite(
            tensor(object, object_column::COUNT),
            tensor(background, background_column::COUNT),
            Tensor::from_floats(self.sharpness, &device),
            packing.clone(),
            CompositeConfig {
                background: match self.config.model.background {
                    Transparency::Sdf => composite::Transparency::Sdf,
                    Transparency::Density => composite::Transparency::Density,
                },
                ..CompositeConfig::default()
            },
        );
        out.into_data().try_to_vec::<f32>().unwrap_or_default()
    }

    fn object_rows(&self, at: &FieldSamples) -> Vec<f32> {
        let geometry = self.object.geometry(&at.points);
        let colour = self
            .object
            .colour(&geometry, &at.points, &at.directions, &[]);
        let mut rows = Vec::with_capacity(at.len() * object_column::COUNT);
        for (i, colour) in colour.chunks_exact(4).enumerate() {
            let direction = Vec3::from_slice(&at.directions[3 * i..]);
            rows.extend([geometry.sdf(i), geometry.normal(i).dot(direction)]);
            rows.extend(&colour[..3]);
            rows.push(match self.config.model.alpha {
                AlphaSource::Opacity => 1.0,
                AlphaSource::Head | AlphaSource::Both => colour[3],
            });
        }
        rows
    }

    fn background_rows(&self, at: &FieldSamples) -> Vec<f32> {
        let geometry = self.background.geometry(&at.points);
        let colour = self
            .background
            .colour(&geometry, &at.points, &at.directions, &at.probability);
        let mut rows = Vec::with_capacity(at.len() * background_column::COUNT);
        for (i, colour) in colour.chunks_exact(3).enumerate() {
            let direction = Vec3::from_slice(&at.directions[3 * i..]);
            let first = match self.config.model.background {
                Transparency::Sdf => geometry.sdf(i),
                Transparency::Density => density_of(geometry.sdf(i)),
            };
            rows.extend([first, geometry.normal(i).dot(direction)]);
            rows.extend(colour);
        }
        rows
    }
}

fn rendered(row: &[f32], alone: &[f32]) -> RenderedRay {
    let colour = |first: usize, opacity: f32| {
        if opacity > 1e-4 {
            (Vec3::from_slice(&row[first..]) / opacity).clamp(Vec3::ZERO, Vec3::ONE)
        } else {
            Vec3::ZERO
        }
    };
    let opacity = row[column::OBJECT_OPACITY];
    let behind = alone[column::BACKGROUND_OPACITY];
    let distance = |depth: f32, opacity: f32| if opacity > 0.05 { depth / opacity } else { 0.0 };
    RenderedRay {
        matte: row[column::MATTE].clamp(0.0, 1.0),
        joint: colour(column::JOINT_COLOUR, row[column::JOINT_OPACITY]),
        object: colour(column::OBJECT_COLOUR, opacity),
        background: colour(column::BACKGROUND_COLOUR, row[column::BACKGROUND_OPACITY]),
        background_opacity: behind,
        object_distance: distance(row[column::OBJECT_DEPTH], opacity),
        background_distance: distance(alone[column::JOINT_DEPTH], behind),
    }
}
