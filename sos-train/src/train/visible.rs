//! Which samples light reaches: a look ahead without gradients or colours.
//!
//! Most samples of a marched ray lie behind its first surface, where nothing they do can be seen.
//! Their geometry alone tells, at a fraction of the price of a whole sample with its gradient.

use burn::tensor::Device;
use neus_render::composite::{self, CompositeConfig, MatteRole, SampleVisibility};
use rand::{Rng, RngExt};
use scene_decomp::colour_field::density_of;
use scene_decomp::{FrozenSurface, Geometry};

use super::batch::MarchedBatch;
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

    /// Looks at the geometry of all samples that light reaches: through both fields, or through the
    /// background by itself on the rays where that is asked for `alone`. The others are as if they
    /// were nothing that nobody sees.
    ///
    /// The alpha head is not asked: samples count as if it said 1, unless it is a factor of the
    /// opacity; then they all count as reached.
    #[must_use]
    pub fn look(
        &self,
        marched: &MarchedBatch,
        config: &TrainConfig,
        cos_anneal: f32,
        alone: impl Fn(usize) -> bool,
    ) -> Look {
        let rules = Rules {
            transparency: [config.model.object_transparency(), config.model.background],
            matte: match config.model.alpha {
                AlphaSource::Opacity | AlphaSource::Head => 1.0,
                AlphaSource::Both => 0.0,
            },
            sharpness: self.sharpness,
            compositing: composite_config(config, cos_anneal),
        };
        rounds::look(&self.object, &self.background, marched, rules, alone)
    }
}

impl Look {
    /// The numbers of the object's samples that light reaches through both fields.
    #[must_use]
    pub fn object_reached(&self) -> Vec<u32> {
        numbers(self.visibility.object.len(), |i| {
            self.visibility.object[i].transmittance > LEAST_TRANSMITTANCE
        })
    }

    /// The same of the background: through both fields, or through itself `alone` where that is
    /// asked for.
    #[must_use]
    pub fn background_reached(&self, alone: impl Fn(usize) -> bool) -> Vec<u32> {
        numbers(self.visibility.background.len(), |i| {
            let of = &self.visibility.background[i];
            let light = if alone(i) { of.alone } else { of.transmittance };
            light > LEAST_TRANSMITTANCE
        })
    }
}

/// Samples that stand for all of a ray's.
#[derive(Clone, Debug, Default)]
pub struct Representatives {
    /// Row numbers, ascending.
    pub rows: Vec<u32>,
    /// What each one's density has to be multiplied with; empty when each stands for itself.
    pub stretch: Vec<f32>,
}

impl Representatives {
    /// Samples that stand for themselves.
    #[must_use]
    pub fn all(rows: Vec<u32>) -> Self {
        Self {
            rows,
            stretch: Vec::new(),
        }
    }
}

/// Neighbours on a ray are drawn as one while they hide less than this share of the pixel,
const GROUP_WEIGHT: f32 = 0.08;
/// and while they are no more than this.
const GROUP_SIZE: usize = 8;

impl Look {
    /// Draws representatives of the background's samples, for a field read as a density.
    ///
    /// Neighbours on a ray that together hide little form a group; one of them is drawn with a
    /// probability proportional to its optical depth, and its density stretched to the optical
    /// depth of all. So a ray's transmittance stays what it is, and on average so do colours and
    /// gradients, for a third of the samples.
    #[must_use]
    pub fn background_drawn(
        &self,
        marched: &MarchedBatch,
        alone: impl Fn(usize) -> bool,
        random: &mut impl Rng,
    ) -> Representatives {
        let packing = &marched.packing;
        let mut out = Representatives::default();
        for ray in 0..packing.ray_count() {
            let rows = packing.background_offsets()[ray]..packing.background_offsets()[ray + 1];
            let objects = &packing.object()[packing.object_offsets()[ray] as usize
                ..packing.object_offsets()[ray + 1] as usize];
            let mut group = Group::default();
            for row in rows {
                let i = row as usize;
                let seen = &self.visibility.background[i];
                let light = if alone(ray) {
                    seen.alone
                } else {
                    seen.transmittance
                };
                if light <= LEAST_TRANSMITTANCE {
                    break;
                }
                let interval = packing.background()[i];
                let parted = group.count > 0
                    && objects.partition_point(|&o| o < group.last)
                        != objects.partition_point(|&o| o < interval);
                if parted || group.weight >= GROUP_WEIGHT || group.count >= GROUP_SIZE {
                    group.close(&mut out);
                }
                let depth = density_of(self.background.sdf(i)) * packing.dt()[interval as usize];
                group.depth += depth;
                if group.count == 0 || random.random::<f32>() * group.depth < depth {
                    (group.row, group.own) = (row, depth);
                }
                group.weight += light * -(-depth).exp_m1();
                group.count += 1;
                group.last = interval;
            }
            group.close(&mut out);
        }
        out
    }
}

/// Neighbouring samples of one ray, and the one drawn among them.
#[derive(Clone, Copy, Debug, Default)]
struct Group {
    count: usize,
    /// The last one's interval.
    last: u32,
    row: u32,
    /// Optical depth of `row`, and of all.
    own: f32,
    depth: f32,
    weight: f32,
}

impl Group {
    fn close(&mut self, out: &mut Representatives) {
        if self.count > 0 {
            out.rows.push(self.row);
            out.stretch.push(self.depth / self.own.max(1e-12));
        }
        *self = Self::default();
    }
}

fn numbers(n: usize, wanted: impl Fn(usize) -> bool) -> Vec<u32> {
    (0..n).filter(|&i| wanted(i)).map(|i| i as u32).collect()
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
mod tests {
    use neus_render::composite::{Packing, sample_visibility};
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::train::batch::FieldSamples;

    /// Two rays of 20 samples: thin fog, then a wall; the raw value r stands for a density exp(-r).
    fn scene() -> (MarchedBatch, Look) {
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
            stretch: Vec::new(),
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
        };
        (marched, look)
    }

    #[test]
    fn representatives_keep_the_optical_depth() {
        let (marched, look) = scene();
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let drawn = look.background_drawn(&marched, |_| false, &mut random);
        assert!(drawn.rows.is_sorted_by(|a, b| a < b));
        let reached = look.background_reached(|_| false);
        assert!(2 * drawn.rows.len() < reached.len(), "{}", drawn.rows.len());
        let depth = |row: u32| density_of(look.background.sdf(row as usize)) * 0.1;
        let whole: f32 = reached.iter().map(|row| depth(*row)).sum();
        let kept: f32 = drawn
            .rows
            .iter()
            .zip(&drawn.stretch)
            .map(|(row, stretch)| stretch * depth(*row))
            .sum();
        assert!((kept / whole - 1.0).abs() < 1e-4, "{kept} {whole}");
    }

    #[test]
    fn representatives_are_fair() {
        let (marched, look) = scene();
        // Each sample's optical depth, on average over many draws, is its own.
        let mut sums = vec![0.0f64; 40];
        let draws = 20_000;
        let mut random = Pcg64Mcg::seed_from_u64(5);
        for _ in 0..draws {
            let drawn = look.background_drawn(&marched, |_| false, &mut random);
            for (row, stretch) in drawn.rows.iter().zip(&drawn.stretch) {
                let depth = density_of(look.background.sdf(*row as usize)) * 0.1 * stretch;
                sums[*row as usize] += f64::from(depth) / f64::from(draws);
            }
        }
        // The later ones share a group with the wall, which is nearly always drawn.
        for (row, sum) in sums.iter().enumerate().take(8) {
            let own = f64::from(density_of(look.background.sdf(row)) * 0.1);
            assert!((sum / own - 1.0).abs() < 0.1, "{row}: {}", sum / own);
        }
    }

    #[test]
    fn what_lies_behind_a_wall_is_not_reached() {
        let (_, look) = scene();
        let reached = look.background_reached(|_| false);
        // 15 per unit of optical depth and sample: one lets through less than the limit.
        assert!(reached.contains(&12) && !reached.contains(&13));
    }
}
