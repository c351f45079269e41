//! From rays to the two fields' samples.

use std::ops::Range;

use glam::Vec3;
use neus_render::composite::Packing;
use neus_render::contraction::contract;
use neus_render::march::{Grids, Intervals, MarchConfig, Marcher};
use neus_render::rays::Ray;
use rayon::prelude::*;
use scene_decomp::LevelSet;
use scene_decomp::probability::ProbabilityMap;
use scene_decomp::sdf_field::{Forward, TapedRows};

/// Where a field is evaluated, in its own frame; point-major lists.
#[derive(Clone, Debug, Default)]
pub struct FieldSamples {
    /// Positions, `[m * 3]`: normalised for FoCoR, contracted for BaCo.
    pub points: Vec<f32>,
    /// Unit directions in the same frame, `[m * 3]`.
    pub directions: Vec<f32>,
    /// m^P at the points, `[m]`; empty for FoCoR, and before [`FieldSamples::look_up`].
    pub probability: Vec<f32>,
    /// The ray that each sample belongs to, `[m]`.
    pub ray: Vec<u32>,
    /// Factor on a density, for a sample that stands for several, `[m]`; empty where each stands for
    /// itself.
    pub stretch: Vec<f32>,
    /// How many samples each counts for in means over them, `[m]`; empty where each counts once.
    pub stands_for: Vec<f32>,
    /// The field's geometry there, where it was written down; empty, or a row for each sample.
    pub taped: TapedRows,
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

    /// How many samples these are, with those that they stand for.
    #[must_use]
    pub fn stood_for(&self) -> f32 {
        if self.stands_for.is_empty() {
            return self.len() as f32;
        }
        self.stands_for.iter().sum()
    }

    pub(super) fn with_capacity(samples: usize) -> Self {
        Self {
            points: Vec::with_capacity(3 * samples),
            directions: Vec::with_capacity(3 * samples),
            probability: Vec::with_capacity(samples),
            ray: Vec::with_capacity(samples),
            stretch: Vec::new(),
            stands_for: Vec::new(),
            taped: TapedRows::default(),
        }
    }

    /// How the field's geometry is had here.
    pub(super) fn forward(&self) -> Forward {
        if self.taped.is_empty() {
            Forward::Alone
        } else {
            Forward::FromTape(self.taped.clone())
        }
    }

    /// Looks m^P up. In the box BaCo's contracted space is the box's own, outside there is nothing.
    pub fn look_up(&mut self, map: &ProbabilityMap) {
        let points = self.points.chunks_exact(3).map(Vec3::from_slice);
        self.probability = points.map(|point| map.at(point)).collect();
    }

    /// The samples with these numbers.
    #[must_use]
    pub fn select(&self, chosen: &[u32]) -> Self {
        let mut out = Self::with_capacity(chosen.len());
        for i in chosen.iter().map(|&i| i as usize) {
            out.points.extend_from_slice(&self.points[3 * i..3 * i + 3]);
            out.directions
                .extend_from_slice(&self.directions[3 * i..3 * i + 3]);
            out.ray.push(self.ray[i]);
        }
        if !self.taped.is_empty() {
            out.taped = self.taped.select(chosen);
        }
        out
    }

    /// Appends the samples of `other`, whose ray 0 is ray `first` here.
    pub(super) fn append(&mut self, other: &Self, first: u32) {
        self.points.extend_from_slice(&other.points);
        self.directions.extend_from_slice(&other.directions);
        self.probability.extend_from_slice(&other.probability);
        self.ray.extend(other.ray.iter().map(|ray| ray + first));
        self.stretch.extend_from_slice(&other.stretch);
        self.stands_for.extend_from_slice(&other.stands_for);
        self.taped.append(&other.taped);
    }

    fn push(&mut self, point: Vec3, direction: Vec3, ray: u32) {
        self.points.extend(point.to_array());
        self.directions.extend(direction.to_array());
        self.ray.push(ray);
    }
}

/// Length of a ray's last interval: what lies there is opaque whatever its density, as the sky is.
const BACKDROP: f32 = 1e4;

/// Which parts of the box each field may fill, by m^P.
#[derive(Clone, Copy, Debug)]
pub struct Partition<'a> {
    /// m^P.
    pub map: &'a ProbabilityMap,
    /// FoCoR is asked only here.
    pub hull: &'a LevelSet,
    /// BaCo is transparent here (method: BaCo's crop).
    pub crop: Option<&'a LevelSet>,
}

/// A batch of rays, marched.
#[derive(Clone, Debug, Default)]
pub struct MarchedBatch {
    /// Which sample belongs where.
    pub packing: Packing,
    /// FoCoR's samples.
    pub object: FieldSamples,
    /// BaCo's samples.
    pub background: FieldSamples,
}

impl MarchedBatch {
    /// The samples with these row numbers only (ascending), of either field, and the intervals that
    /// have one.
    #[must_use]
    pub fn keep(&self, object: &[u32], background: &[u32]) -> Self {
        let all = &self.packing;
        let (mut offsets, mut t, mut dt) = (vec![0], Vec::new(), Vec::new());
        let mut kept_object = Vec::with_capacity(object.len());
        let mut kept_background = Vec::with_capacity(background.len());
        let mut object_left = object.iter().map(|&i| all.object()[i as usize]).peekable();
        let mut background_left = background
            .iter()
            .map(|&i| all.background()[i as usize])
            .peekable();
        for &end in &all.ray_offsets()[1..] {
            loop {
                let next = [object_left.peek(), background_left.peek()]
                    .into_iter()
                    .flatten()
                    .min();
                let Some(&interval) = next.filter(|interval| **interval < end) else {
                    break;
                };
                let number = t.len() as u32;
                t.push(all.t()[interval as usize]);
                dt.push(all.dt()[interval as usize]);
                if object_left.next_if_eq(&interval).is_some() {
                    kept_object.push(number);
                }
                if background_left.next_if_eq(&interval).is_some() {
                    kept_background.push(number);
                }
            }
            offsets.push(t.len() as u32);
        }
        Self {
            packing: Packing::new(offsets, t, dt, kept_object, kept_background),
            object: self.object.select(object),
            background: self.background.select(background),
        }
    }
}

/// Marches rays through both grids and keeps its memory.
#[derive(Debug, Default)]
pub struct BatchMarcher {
    marcher: Marcher,
    intervals: Intervals,
}

/// Rays with what the grids leave of them. Samples are made of it as they are wanted: all by
/// [`MarchedRays::samples`], or those that light reaches by [`FrozenFields::look`](super::visible::FrozenFields::look).
#[derive(Clone, Copy, Debug)]
pub struct MarchedRays<'a> {
    /// The rays.
    pub rays: &'a [Ray],
    /// Their intervals in occupied cells.
    pub intervals: &'a Intervals,
    /// Neither field is asked where this gives space to the other.
    pub partition: Partition<'a>,
    /// Whether they were marched on behind the box, to where the scene ends.
    pub to_the_end: bool,
}

/// Rays that one task turns into samples.
const CHUNK: usize = 64;

/// Samples of both fields in the order in which they were made, and the intervals that they are in.
#[derive(Debug)]
pub(super) struct SampleLists {
    pub(super) object: FieldSamples,
    pub(super) object_intervals: Vec<u32>,
    pub(super) background: FieldSamples,
    pub(super) background_intervals: Vec<u32>,
}

impl BatchMarcher {
    /// Marches `rays`.
    pub fn march<'a>(
        &'a mut self,
        rays: &'a [Ray],
        grids: Grids<'_>,
        config: &MarchConfig,
        partition: Partition<'a>,
    ) -> MarchedRays<'a> {
        self.marcher.march(rays, grids, config, &mut self.intervals);
        self.along(rays, partition, config)
    }

    /// The same without the background behind each ray's last interval of the object's, which no
    /// matte depends on.
    pub fn march_to_object<'a>(
        &'a mut self,
        rays: &'a [Ray],
        grids: Grids<'_>,
        config: &MarchConfig,
        partition: Partition<'a>,
    ) -> MarchedRays<'a> {
        self.march(rays, grids, config, partition);
        let Intervals {
            ray_offsets,
            object,
            background,
            ..
        } = &mut self.intervals;
        for range in ray_offsets.windows(2) {
            let range = range[0] as usize..range[1] as usize;
            let last = object[range.clone()].iter().rposition(|object| *object);
            let behind = last.map_or(range.start, |last| range.start + last + 1);
            background[behind..range.end].fill(false);
        }
        self.along(rays, partition, config)
    }

    fn along<'a>(
        &'a self,
        rays: &'a [Ray],
        partition: Partition<'a>,
        config: &MarchConfig,
    ) -> MarchedRays<'a> {
        MarchedRays {
            rays,
            intervals: &self.intervals,
            partition,
            to_the_end: config.behind_box,
        }
    }
}

impl MarchedRays<'_> {
    /// The numbers of a ray's intervals.
    pub(super) fn range(&self, ray: usize) -> Range<u32> {
        self.intervals.ray_offsets[ray]..self.intervals.ray_offsets[ray + 1]
    }

    /// All samples, whether light reaches them or not.
    #[must_use]
    pub fn samples(&self) -> MarchedBatch {
        let parts: Vec<(SampleLists, Vec<f32>)> = (0..self.rays.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let first = chunk * CHUNK;
                let end = (first + CHUNK).min(self.rays.len());
                let mut lists = SampleLists::for_rays(self.intervals, first, end);
                let mut lengths = Vec::new();
                for ray in first..end {
                    for interval in self.range(ray) {
                        let length = self.add(ray, interval, &mut lists);
                        lengths.push(length.unwrap_or(self.intervals.dt[interval as usize]));
                    }
                }
                (lists, lengths)
            })
            .collect();
        let (parts, lengths): (Vec<SampleLists>, Vec<Vec<f32>>) = parts.into_iter().unzip();
        let lists = SampleLists::joined(parts);
        MarchedBatch {
            packing: Packing::new(
                self.intervals.ray_offsets.clone(),
                self.intervals.t.clone(),
                lengths.concat(),
                lists.object_intervals,
                lists.background_intervals,
            ),
            object: lists.object,
            background: lists.background,
        }
    }

    /// Adds the samples that the fields have in an interval of a ray. Its length is returned, in the
    /// space of these samples; `None` where there is none.
    pub(super) fn add(&self, ray: usize, interval: u32, to: &mut SampleLists) -> Option<f32> {
        let Self {
            intervals,
            partition,
            ..
        } = self;
        let i = interval as usize;
        let number = ray as u32;
        let ray = &self.rays[ray];
        let point = ray.at(intervals.t[i]);
        let inside = point.abs().max_element() <= 1.0;
        let within = |set: &LevelSet| inside && set.contains(partition.map, point);
        let object = intervals.object[i] && within(partition.hull);
        if object {
            to.object.push(point, ray.direction, number);
            to.object_intervals.push(interval);
        }
        if !intervals.background[i] || partition.crop.is_some_and(within) {
            return object.then_some(intervals.dt[i]);
        }
        to.background_intervals.push(interval);
        if inside {
            // Contracted space is the box's own there.
            to.background.push(point, ray.direction, number);
            return Some(intervals.dt[i]);
        }
        // Outside the box the field lives in contracted space, and so do steps along the ray.
        let (t, half) = (intervals.t[i], 0.5 * intervals.dt[i]);
        let across = contract(ray.at(t + half)) - contract(ray.at(t - half));
        let length = across.length();
        let direction = across / length.max(1e-12);
        to.background.push(contract(point), direction, number);
        // The last of a ray that was not marched to its end may lie before the box, and is like any other there.
        let last = self.to_the_end && interval + 1 == intervals.ray_offsets[number as usize + 1];
        Some(if last { BACKDROP } else { length })
    }
}

impl SampleLists {
    /// With room for all that rays `first..end` can have.
    fn for_rays(intervals: &Intervals, first: usize, end: usize) -> Self {
        let offsets = &intervals.ray_offsets;
        let range = offsets[first] as usize..offsets[end] as usize;
        let wanted = |flags: &[bool]| flags[range.clone()].iter().filter(|flag| **flag).count();
        Self::with_capacity(wanted(&intervals.object), wanted(&intervals.background))
    }

    /// With room for so many samples of either field.
    pub(super) fn with_capacity(object: usize, background: usize) -> Self {
        Self {
            object: FieldSamples::with_capacity(object),
            object_intervals: Vec::with_capacity(object),
            background: FieldSamples::with_capacity(background),
            background_intervals: Vec::with_capacity(background),
        }
    }

    /// All of `parts`, in their order. A single one is not copied: callers with few rays have no other.
    fn joined(mut parts: Vec<Self>) -> Self {
        if parts.len() == 1
            && let Some(part) = parts.pop()
        {
            return part;
        }
        let total = |count: fn(&Self) -> usize| parts.iter().map(count).sum::<usize>();
        let mut all = Self::with_capacity(total(|p| p.object.len()), total(|p| p.background.len()));
        for part in parts {
            all.object.append(&part.object, 0);
            all.background.append(&part.background, 0);
            all.object_intervals.extend(part.object_intervals);
            all.background_intervals.extend(part.background_intervals);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use neus_render::occupancy::OccupancyGrid;
    use scene_decomp::BACKGROUND_HALF_SIDE;

    /// Something in front of the box, and nothing in it.
    #[test]
    fn what_is_before_the_box_does_not_end_a_ray() {
        let mut grid = OccupancyGrid::new(32, BACKGROUND_HALF_SIDE);
        let before: Vec<u32> = (0..grid.cell_count() as u32)
            .filter(|&cell| grid.centre_of(cell).z < -1.2)
            .collect();
        grid.update(&before, &vec![1.0; before.len()]);
        grid.rebuild_bits(0.5);
        let map = ProbabilityMap::new(2, vec![0.5; 8]);
        let hull = LevelSet::new(&map, 0.9);
        let rays = [Ray::new(Vec3::new(0.0, 0.0, -3.0), Vec3::Z).expect("a direction")];
        for behind_box in [false, true] {
            let config = MarchConfig {
                behind_box,
                background_samples: 32,
                ..MarchConfig::default()
            };
            let grids = Grids {
                object: None,
                background: Some(&grid),
            };
            let partition = Partition {
                map: &map,
                hull: &hull,
                crop: None,
            };
            let mut marcher = BatchMarcher::default();
            let marched = marcher.march(&rays, grids, &config, partition);
            let samples = marched.samples();
            assert!(samples.background.len() > 3);
            let ends = samples.packing.dt().contains(&BACKDROP);
            assert_eq!(ends, behind_box);
        }
    }
}
