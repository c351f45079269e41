//! From rays to the two fields' samples.

use glam::Vec3;
use neus_render::composite::Packing;
use neus_render::contraction::contract;
use neus_render::march::{Field, Grids, Intervals, MarchConfig, Marcher, Samples};
use neus_render::rays::Ray;
use scene_decomp::probability::ProbabilityMap;

/// Where a field is evaluated, in its own frame; point-major lists.
#[derive(Clone, Debug, Default)]
pub struct FieldSamples {
    /// Positions, `[m * 3]`: normalised for FoCoR, contracted for BaCo.
    pub points: Vec<f32>,
    /// Unit directions in the same frame, `[m * 3]`.
    pub directions: Vec<f32>,
    /// m^P at the points, `[m]`; empty for FoCoR.
    pub probability: Vec<f32>,
    /// The ray that each sample belongs to, `[m]`.
    pub ray: Vec<u32>,
}

impl FieldSamples {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ray.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ray.is_empty()
    }

    fn push(&mut self, point: Vec3, direction: Vec3, ray: u32) {
        self.points.extend(point.to_array());
        self.directions.extend(direction.to_array());
        self.ray.push(ray);
    }
}

/// A batch of rays, marched.
#[derive(Clone, Debug)]
pub struct MarchedBatch {
    /// Which sample belongs where.
    pub packing: Packing,
    /// FoCoR's samples.
    pub object: FieldSamples,
    /// BaCo's samples.
    pub background: FieldSamples,
}

/// Marches rays through both grids and keeps its memory.
#[derive(Debug, Default)]
pub struct BatchMarcher {
    marcher: Marcher,
    intervals: Intervals,
    object: Samples,
    background: Samples,
}

impl BatchMarcher {
    /// Marches `rays`. BaCo is not asked where m^P reaches `crop`: there it is transparent
    /// (method: BaCo's crop).
    pub fn march(
        &mut self,
        rays: &[Ray],
        grids: Grids<'_>,
        config: &MarchConfig,
        map: &ProbabilityMap,
        crop: f32,
    ) -> MarchedBatch {
        self.marcher.march(rays, grids, config, &mut self.intervals);
        self.intervals
            .samples_into(Field::Object, rays, &mut self.object);
        self.intervals
            .samples_into(Field::Background, rays, &mut self.background);
        let mut object = FieldSamples::default();
        for (&ray, &point) in self.object.ray.iter().zip(&self.object.points) {
            object.push(point, rays[ray as usize].direction, ray);
        }
        let mut dt = self.intervals.dt.clone();
        let mut background = FieldSamples::default();
        let mut kept = Vec::with_capacity(self.background.len());
        for (i, &interval) in self.background.interval.iter().enumerate() {
            let (ray_index, point) = (self.background.ray[i], self.background.points[i]);
            let probability = map.at(point);
            if probability >= crop {
                continue;
            }
            let ray = &rays[ray_index as usize];
            let interval = interval as usize;
            // Outside the box the field lives in contracted space, and so do steps along the ray.
            let direction = if point.abs().max_element() > 1.0 {
                let t = self.intervals.t[interval];
                let half = 0.5 * self.intervals.dt[interval];
                let across = contract(ray.at(t + half)) - contract(ray.at(t - half));
                let length = across.length();
                dt[interval] = length;
                across / length.max(1e-12)
            } else {
                ray.direction
            };
            background.push(contract(point), direction, ray_index);
            background.probability.push(probability);
            kept.push(interval as u32);
        }
        let packing = Packing::new(
            self.intervals.ray_offsets.clone(),
            self.intervals.t.clone(),
            dt,
            self.object.interval.clone(),
            kept,
        );
        MarchedBatch {
            packing,
            object,
            background,
        }
    }
}
