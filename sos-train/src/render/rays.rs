//! Renders rays through the trained fields, without gradients.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::{Device, TensorData};
use glam::Vec3;
use neus_render::composite::{background_column, column, object_column};
use neus_render::march::{Jitter, MarchConfig};
use neus_render::rays::Ray;
use rayon::prelude::*;
use scene_decomp::FrozenSurface;
use scene_decomp::colour_field::density_of;
use scene_decomp::probability::ProbabilityMap;

use super::semantic::with_shares;
use crate::config::{AlphaSource, Blend, Fields, TrainConfig, Transparency};
use crate::train::batch::{BatchMarcher, MarchedBatch, MarchedRays};
use crate::train::blend::blend;
use crate::train::grids::FieldGrids;
use crate::train::visible::{Alone, FrozenFields, Look, composite_config};

/// Rays that one task renders: few enough that its core's cache holds their samples.
pub(super) const CHUNK: usize = 256;

/// A trained scene, frozen.
#[derive(Debug)]
pub struct FrozenScene {
    /// FoCoR and BaCo.
    pub fields: FrozenFields,
    /// Occupied space.
    pub grids: FieldGrids,
    /// m^P.
    pub map: ProbabilityMap,
    /// The run's settings.
    pub config: TrainConfig,
    /// Steps trained.
    pub step: u32,
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
    /// Opacity of the object alone.
    pub object_opacity: f32,
    /// Distance along the ray to the object, in the normalised frame; 0 where there is none.
    pub object_distance: f32,
    /// Distance along the ray to the background behind the object; 0 where there is none.
    pub background_distance: f32,
}

/// What a survey wants to know of a ray; see [`RenderedRay`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Glance {
    /// The visible object's share of the pixel.
    pub matte: f32,
    /// Distance along the ray to the background behind the object; 0 where there is none.
    pub background_distance: f32,
}

/// What of a ray is marched.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Extent {
    /// Everything.
    All,
    /// Up to where it leaves the object's box.
    Box,
    /// Up to the last place where the object may be.
    BeforeObject,
    /// FoCoR alone.
    Object,
}

impl FrozenScene {
    /// Renders `rays` of the normalised frame.
    #[must_use]
    pub fn render(&self, rays: &[Ray]) -> Vec<RenderedRay> {
        rays.par_chunks(CHUNK)
            .map_init(BatchMarcher::default, |marcher, chunk| {
                let (marched, look) = self.look(chunk, marcher, Extent::All, true);
                let rendered = self.render_marched(&marched, &look);
                if self.is_semantic() {
                    return with_shares(rendered, &marched, &look);
                }
                rendered
            })
            .flatten_iter()
            .collect()
    }

    /// What `rays` meet of the object, as if nothing else were there: what is said of the background is
    /// nothing.
    #[must_use]
    pub fn objects(&self, rays: &[Ray]) -> Vec<RenderedRay> {
        rays.par_chunks(CHUNK)
            .map_init(BatchMarcher::default, |marcher, chunk| {
                let (marched, look) = self.look(chunk, marcher, Extent::Object, false);
                self.render_marched(&marched, &look)
            })
            .flatten_iter()
            .collect()
    }

    /// The mattes of `rays` alone: no colours are computed, unless the matte depends on them.
    #[must_use]
    pub fn mattes(&self, rays: &[Ray]) -> Vec<f32> {
        if self.is_semantic() {
            return self.semantic_mattes(rays);
        }
        if self.mattes_need_colours() {
            return self.render(rays).iter().map(|ray| ray.matte).collect();
        }
        rays.par_chunks(CHUNK)
            .map_init(BatchMarcher::default, |marcher, chunk| {
                // Most rays past the object meet none of its samples: they need no more than that.
                let object = self.march(chunk, marcher, Extent::Object).samples();
                let offsets = object.packing.object_offsets();
                let hit: Vec<usize> = (0..chunk.len())
                    .filter(|&ray| offsets[ray + 1] > offsets[ray])
                    .collect();
                let rays: Vec<Ray> = hit.iter().map(|&ray| chunk[ray]).collect();
                let marched = self.march(&rays, marcher, Extent::BeforeObject);
                let (marched, look) = self
                    .fields
                    .look(marched, &self.config, 1.0, |_| Alone::default());
                let mut mattes = vec![0.0f32; chunk.len()];
                for (&ray, seen) in marched.object.ray.iter().zip(&look.visibility.object) {
                    mattes[hit[ray as usize]] += seen.weight;
                }
                mattes.into_iter().map(|matte| matte.clamp(0.0, 1.0))
            })
            .flatten_iter()
            .collect()
    }

    /// The matte of each ray and the distance to the background behind the object, as
    /// [`FrozenScene::render`] gives them: no colours are computed, unless the matte depends on them.
    #[must_use]
    pub fn glances(&self, rays: &[Ray]) -> Vec<Glance> {
        if self.mattes_need_colours() || self.is_semantic() {
            let glance = |ray: RenderedRay| Glance {
                matte: ray.matte,
                background_distance: ray.background_distance,
            };
            return self.render(rays).into_iter().map(glance).collect();
        }
        rays.par_chunks(CHUNK)
            .map_init(BatchMarcher::default, |marcher, chunk| {
                let (marched, look) = self.look(chunk, marcher, Extent::All, true);
                let mut mattes = vec![0.0f32; chunk.len()];
                for (&ray, seen) in marched.object.ray.iter().zip(&look.visibility.object) {
                    mattes[ray as usize] += seen.weight;
                }
                let depths = background_depths(&marched, &look);
                let glance = |(matte, background_distance): (f32, f32)| Glance {
                    matte: matte.clamp(0.0, 1.0),
                    background_distance,
                };
                mattes.into_iter().zip(depths).map(glance)
            })
            .flatten_iter()
            .collect()
    }

    /// Whether a matte is more than how opaque the surface is.
    pub(super) fn mattes_need_colours(&self) -> bool {
        let model = &self.config.model;
        model.alpha != AlphaSource::Opacity || model.blend != Blend::Sample
    }

    /// Whether FoCoR is drawn as if there were no BaCo before it, to be blended with it ray by ray.
    fn draws_object_alone(&self) -> bool {
        self.config.model.blend == Blend::Ray
    }

    /// Where half of each ray's light has come from: distances in the normalised frame, infinite where
    /// that is behind the box.
    #[must_use]
    pub fn median_distances(&self, rays: &[Ray]) -> Vec<f32> {
        rays.par_chunks(CHUNK)
            .map_init(BatchMarcher::default, |marcher, chunk| {
                let (marched, look) = self.look(chunk, marcher, Extent::Box, false);
                let (packing, seen) = (&marched.packing, &look.visibility);
                let mut light = vec![0.0f32; packing.interval_count()];
                for (intervals, seen) in [
                    (packing.object(), &seen.object),
                    (packing.background(), &seen.background),
                ] {
                    for (&interval, seen) in intervals.iter().zip(seen) {
                        light[interval as usize] += seen.weight;
                    }
                }
                let median = |range: &[u32]| {
                    let mut sum = 0.0;
                    let mut intervals = range[0] as usize..range[1] as usize;
                    let half = intervals.find(|&interval| {
                        sum += light[interval];
                        sum >= 0.5
                    });
                    half.map_or(f32::INFINITY, |interval| packing.t()[interval])
                };
                let rays = packing.ray_offsets().windows(2);
                rays.map(median).collect::<Vec<f32>>()
            })
            .flatten_iter()
            .collect()
    }

    /// Whether one field is the whole scene.
    pub(super) fn is_semantic(&self) -> bool {
        self.config.model.fields == Fields::Semantic
    }

    /// The field that the object is in.
    #[must_use]
    pub fn object_field(&self) -> &FrozenSurface {
        if self.is_semantic() {
            &self.fields.background
        } else {
            &self.fields.object
        }
    }

    /// Marches `rays` and looks along them, through the background `alone` too where that is wanted.
    fn look(
        &self,
        rays: &[Ray],
        marcher: &mut BatchMarcher,
        extent: Extent,
        alone: bool,
    ) -> (MarchedBatch, Look) {
        let marched = self.march(rays, marcher, extent);
        if self.is_semantic() {
            return self.split(&marched.samples(), extent);
        }
        let alone = Alone {
            object: self.draws_object_alone(),
            background: alone,
        };
        self.fields.look(marched, &self.config, 1.0, |_| alone)
    }

    pub(super) fn march<'a>(
        &'a self,
        rays: &'a [Ray],
        marcher: &'a mut BatchMarcher,
        extent: Extent,
    ) -> MarchedRays<'a> {
        let sampling = &self.config.sampling;
        let march = MarchConfig {
            step_object: 2.0 / sampling.object_steps as f32,
            background_stride: crate::train::BACKGROUND_STRIDE,
            background_samples: sampling.background_samples,
            behind_box: extent == Extent::All,
            jitter: Jitter::Fixed,
            ..MarchConfig::default()
        };
        let (mut grids, partition) =
            crate::train::space(&self.config, self.step, &self.grids, &self.map);
        if extent == Extent::Object && !self.is_semantic() {
            grids.background = None;
        }
        if extent == Extent::BeforeObject {
            return marcher.march_to_object(rays, grids, &march, partition);
        }
        marcher.march(rays, grids, &march, partition)
    }

    /// Colours of the samples that light reaches, in both fields alone and together.
    fn render_marched(&self, marched: &MarchedBatch, look: &Look) -> Vec<RenderedRay> {
        let object = look.object_reached(|_| self.draws_object_alone());
        let background = look.background_reached(|_| true);
        let mut kept = marched.keep(&object, &background);
        kept.background.look_up(&self.map);
        let object = self.object_rows(&kept, look, &object);
        let background = self.background_rows(&kept, look, &background);
        let depths = background_depths(marched, look);
        let device = Device::flex();
        let tensor = |values: Vec<f32>, columns: usize| {
            let rows = values.len() / columns;
            Tensor::<2>::from_data(TensorData::new(values, [rows, columns]), &device)
        };
        let pixels = blend(
            tensor(object, object_column::COUNT),
            tensor(background, background_column::COUNT),
            Tensor::from_floats(self.fields.sharpness, &device),
            Arc::new(kept.packing),
            composite_config(&self.config, 1.0),
            &self.config.model,
        );
        let list = |of: Tensor<2>| of.into_data().try_to_vec::<f32>().unwrap_or_default();
        let (rendered, colour, matte) = (
            list(pixels.rendered),
            list(pixels.colour),
            list(pixels.matte),
        );
        let looks = rendered.chunks_exact(column::COUNT).zip(depths);
        looks
            .zip(colour.chunks_exact(3).zip(matte))
            .map(|((row, depth), (joint, matte))| RenderedRay {
                matte: matte.clamp(0.0, 1.0),
                joint: Vec3::from_slice(joint).clamp(Vec3::ZERO, Vec3::ONE),
                ..of_fields(row, depth)
            })
            .collect()
    }

    fn object_rows(&self, kept: &MarchedBatch, look: &Look, chosen: &[u32]) -> Vec<f32> {
        let at = &kept.object;
        let geometry = look.object.select(chosen);
        let views = self.views(&at.directions);
        let field = self.object_field();
        let colour = field.colour(&geometry, &at.points, &views, &[]);
        let outputs = colour.len().checked_div(at.len()).unwrap_or(4);
        let transparency = self.config.model.object_transparency();
        let mut rows = Vec::with_capacity(at.len() * object_column::COUNT);
        for (i, colour) in colour.chunks_exact(outputs).enumerate() {
            let direction = Vec3::from_slice(&at.directions[3 * i..]);
            rows.extend([
                opaque_by(transparency, geometry.sdf(i)),
                geometry.normal(i).dot(direction),
            ]);
            rows.extend(&colour[..3]);
            // Without an alpha head there is nothing to hold back.
            rows.push(colour.get(3).copied().unwrap_or(1.0));
        }
        rows
    }

    /// The directions that colours depend on.
    fn views(&self, directions: &[f32]) -> Vec<f32> {
        let share = if self.is_semantic() {
            1.0
        } else {
            self.fields.view_share
        };
        directions.iter().map(|d| share * d).collect()
    }

    fn background_rows(&self, kept: &MarchedBatch, look: &Look, chosen: &[u32]) -> Vec<f32> {
        let at = &kept.background;
        let geometry = look.background.select(chosen);
        let probability: &[f32] = if self.is_semantic() {
            &[]
        } else {
            &at.probability
        };
        let field = &self.fields.background;
        let colour = field.colour(&geometry, &at.points, &at.directions, probability);
        let mut rows = Vec::with_capacity(at.len() * background_column::COUNT);
        for (i, colour) in colour.chunks_exact(3).enumerate() {
            let direction = Vec3::from_slice(&at.directions[3 * i..]);
            let first = opaque_by(self.config.model.background, geometry.sdf(i));
            rows.extend([first, geometry.normal(i).dot(direction)]);
            rows.extend(colour);
        }
        rows
    }
}

/// What compositing reads of a field's first output.
pub(super) fn opaque_by(transparency: Transparency, first: f32) -> f32 {
    match transparency {
        Transparency::Sdf => first,
        Transparency::Density => density_of(first),
    }
}

/// Where half of the background's own light has come from, with the object left out; 0 where there
/// is none. A mean would not do: what little light is left at the end of a ray comes from very far.
fn background_depths(marched: &MarchedBatch, look: &Look) -> Vec<f32> {
    let packing = &marched.packing;
    let seen = &look.visibility.background;
    packing
        .background_offsets()
        .windows(2)
        .map(|rows| {
            let (first, end) = (rows[0] as usize, rows[1] as usize);
            // The sample behind which less than half is left; at the latest the last, which is opaque.
            (first..end)
                .find(|&i| i + 1 == end || seen[i + 1].alone < 0.5)
                .map_or(0.0, |i| packing.t()[packing.background()[i] as usize])
        })
        .collect()
}

/// What the fields look like by themselves.
fn of_fields(row: &[f32], background_distance: f32) -> RenderedRay {
    let colour = |first: usize, opacity: f32| {
        if opacity > 1e-4 {
            (Vec3::from_slice(&row[first..]) / opacity).clamp(Vec3::ZERO, Vec3::ONE)
        } else {
            Vec3::ZERO
        }
    };
    let opacity = row[column::OBJECT_OPACITY];
    let distance = |depth: f32, opacity: f32| if opacity > 0.05 { depth / opacity } else { 0.0 };
    RenderedRay {
        object: colour(column::OBJECT_COLOUR, opacity),
        background: colour(column::BACKGROUND_COLOUR, row[column::BACKGROUND_OPACITY]),
        object_opacity: opacity,
        object_distance: distance(row[column::OBJECT_DEPTH], opacity),
        background_distance,
        ..RenderedRay::default()
    }
}
