//! Which samples light reaches: a look ahead without gradients or colours.
//!
//! Most samples of a marched ray lie behind its first surface, where nothing they do can be seen.
//! Their geometry alone tells; it is written down for a step that learns from them.

use burn::tensor::Device;
use neus_render::composite::{self, CompositeConfig, MatteRole, SampleVisibility, Visibility};
use scene_decomp::{FrozenSurface, Geometry};

use super::batch::{MarchedBatch, MarchedRays};
use super::rounds::{self, Rules};
use crate::config::{AlphaSource, TrainConfig, Transparency};

/// Samples behind this transmittance are left out: they'd change a pixel by less than a tenth of
/// what 8 bits can tell.
pub const LEAST_TRANSMITTANCE: f32 = 4e-4;

/// Both fields without gradients, with what turns their values into opacities.
#[derive(Clone, Debug)]
pub struct FrozenFields {
    /// FoCoR.
    pub object: FrozenSurface,
    /// BaCo.
    pub background: FrozenSurface,
    /// `b` of both fields.
    pub sharpness: [f32; 2],
    /// Factor on the view directions that colours depend on.
    pub view_share: f32,
    /// Whether a look writes FoCoR's and BaCo's geometry down for a step that learns from it.
    pub taped: [bool; 2],
}

/// The geometry of a batch's samples and how visible each is.
#[derive(Clone, Debug)]
pub struct Look {
    /// FoCoR's samples.
    pub object: Geometry,
    /// BaCo's samples.
    pub background: Geometry,
    /// Weights and transmittances.
    pub visibility: SampleVisibility,
    /// Whether transmittances are those through BaCo alone, so that none of FoCoR's samples hides another.
    pub through_object: bool,
}

/// Which fields are asked on a ray as far as their own light goes, whatever the other one has before them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Alone {
    /// FoCoR.
    pub object: bool,
    /// BaCo.
    pub background: bool,
}

impl FrozenFields {
    /// The same for looking alone: [`FrozenSurface::without_features`].
    #[must_use]
    pub fn without_features(self) -> Self {
        Self {
            object: self.object.without_features(),
            background: self.background.without_features(),
            ..self
        }
    }

    /// A copy on another device.
    #[must_use]
    pub fn to_device(self, device: &Device) -> Self {
        Self {
            object: self.object.to_device(device),
            background: self.background.to_device(device),
            ..self
        }
    }

    /// Makes the samples of `marched` that light may reach and looks at their geometry: through both
    /// fields, or through one by itself on the rays where that is asked for `alone`.
    ///
    /// The alpha head is not asked: samples count as if it said 1. Where it is a factor of the opacity, all of FoCoR's that
    /// BaCo does not hide count as reached.
    #[must_use]
    pub fn look(
        &self,
        marched: MarchedRays<'_>,
        config: &TrainConfig,
        cos_anneal: f32,
        alone: impl Fn(usize) -> Alone,
    ) -> (MarchedBatch, Look) {
        let rules = Rules {
            transparency: [config.model.object_transparency(), config.model.background],
            through_object: config.model.alpha == AlphaSource::Both,
            sharpness: self.sharpness,
            compositing: composite_config(config, cos_anneal),
            taped: self.taped,
        };
        rounds::look(&self.object, &self.background, marched, rules, alone)
    }
}

impl Look {
    /// The numbers of the object's samples that light reaches: through both fields, or through itself
    /// `alone` where that is asked for.
    #[must_use]
    pub fn object_reached(&self, alone: impl Fn(usize) -> bool) -> Vec<u32> {
        let seen = &self.visibility.object;
        if self.through_object {
            let light = |i: usize| if alone(i) { 1.0 } else { seen[i].transmittance };
            return lit(seen.len(), light);
        }
        reached(seen, alone)
    }

    /// The same of the background: through both fields, or through itself `alone` where that is
    /// asked for.
    #[must_use]
    pub fn background_reached(&self, alone: impl Fn(usize) -> bool) -> Vec<u32> {
        reached(&self.visibility.background, alone)
    }
}

fn reached(seen: &[Visibility], alone: impl Fn(usize) -> bool) -> Vec<u32> {
    let light = |i: usize| {
        if alone(i) {
            seen[i].alone
        } else {
            seen[i].transmittance
        }
    };
    lit(seen.len(), light)
}

/// The numbers of samples that enough light gets to.
fn lit(samples: usize, light: impl Fn(usize) -> f32) -> Vec<u32> {
    let numbers = (0..samples).filter(|&i| light(i) > LEAST_TRANSMITTANCE);
    numbers.map(|i| i as u32).collect()
}

/// How the settings have samples become opacities.
#[must_use]
pub fn composite_config(config: &TrainConfig, cos_anneal: f32) -> CompositeConfig {
    let opaque_by = |transparency| match transparency {
        Transparency::Sdf => composite::Transparency::Sdf,
        Transparency::Density => composite::Transparency::Density,
    };
    CompositeConfig {
        object: opaque_by(config.model.object_transparency()),
        background: opaque_by(config.model.background),
        matte: matte_role(config.model.alpha),
        cos_anneal,
        ..CompositeConfig::default()
    }
}

/// What the alpha head's values do in compositing.
pub(super) fn matte_role(alpha: AlphaSource) -> MatteRole {
    match alpha {
        AlphaSource::Opacity => MatteRole::Unused,
        AlphaSource::Both => MatteRole::Opacity,
        AlphaSource::Head => MatteRole::Colour,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use neus_render::composite::{Packing, sample_visibility};
    use scene_decomp::colour_field::density_of;

    use super::*;
    use crate::train::batch::FieldSamples;

    /// Two rays of 20 samples: thin fog, then a wall; the raw value r stands for a density exp(-r).
    pub(in crate::train) fn scene() -> (MarchedBatch, Look) {
        let n = 40;
        let intervals: Vec<u32> = (0..n as u32).collect();
        let packing = Packing::new(
            vec![0, 20, 40],
            (0..n).map(|i| (i % 20) as f32 * 0.1).collect(),
            vec![0.1; n],
            Vec::new(),
            intervals,
        );
        let raw: Vec<f32> = (0..n)
            .map(|i| match i % 20 {
                12.. => -5.0,
                k => 2.0 + 0.1 * k as f32,
            })
            .collect();
        let rows: Vec<f32> = raw
            .iter()
            .flat_map(|r| [density_of(*r), 0.0, 0.0, 0.0, 0.0])
            .collect();
        let visibility = sample_visibility(
            &[],
            &rows,
            [20.0; 2],
            &packing,
            CompositeConfig {
                background: composite::Transparency::Density,
                ..CompositeConfig::default()
            },
        );
        let background = FieldSamples {
            points: vec![0.0; 3 * n],
            directions: vec![0.0; 3 * n],
            probability: vec![0.0; n],
            ray: (0..n as u32).map(|i| i / 20).collect(),
            ..FieldSamples::default()
        };
        let marched = MarchedBatch {
            packing,
            object: FieldSamples::default(),
            background,
        };
        let look = Look {
            object: Geometry::default(),
            background: Geometry {
                values: raw,
                columns: 1,
            },
            visibility,
            through_object: false,
        };
        (marched, look)
    }

    #[test]
    fn what_lies_behind_a_wall_is_not_reached() {
        let (_, look) = scene();
        let reached = look.background_reached(|_| false);
        // 15 per unit of optical depth and sample: one lets through less than the limit.
        assert!(reached.contains(&12) && !reached.contains(&13));
    }
}
