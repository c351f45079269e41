//! Marching: which stretches of each ray the two fields have to be asked about.
//!
//! A batch of `r` rays gives `n` intervals, packed ray by ray and sorted by distance. `t` is an
//! interval's midpoint, where the fields are evaluated, and `dt` its length, both as distances
//! along the unit direction in the space of the rays (object box [-1, 1]^3).
//!
//! - Within the box: steps of a fixed length whose raster has a random offset per ray. An interval
//!   is kept when the object's grid or the background's says "occupied" at its midpoint; each has
//!   a flag of its own.
//! - Before the box and behind it: intervals for the background alone. With `d` the distance from
//!   the box, steps are even in `d / (d + 1)`, the contraction's sense (see
//!   [`contraction`](crate::contraction)). A ray that misses the box has them on both sides of its
//!   closest approach, in units of the distance there.
//!
//! The last interval behind the box is there whatever the grid says: something closes every view.
//!
//! With everything occupied, the intervals cover [near, far] without a gap.
//!
//! With the feature `cube`, `march_on_device` does the same on a GPU.

#[cfg(feature = "cube")]
mod cube;
#[cfg(feature = "cube")]
mod device;
mod intervals;
mod raster;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

#[cfg(feature = "cube")]
pub use device::{DeviceGrids, DeviceIntervals, march_on_device, rays_on};
pub use intervals::{Field, Intervals, Samples};
use raster::{Flags, Raster};

use crate::{
    contraction::contract,
    intersect::{Aabb, ray_box},
    occupancy::OccupancyGrid,
    random::unit_float,
    rays::Ray,
};

/// Rays that one task marches; also the unit in which intervals are gathered.
const CHUNK: usize = 64;

/// Steps ahead in which the object's grid must be empty for the background to be marched in longer
/// ones.
const CLEARANCE: usize = 6;

/// How the raster of steps is placed on a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Jitter {
    /// Begins at the ray's entry: the same rays give the same intervals. For rendering.
    Fixed,
    /// Shifted by a fraction of a step that hashes the seed and the ray's index in the batch. For
    /// training, with another seed at every step.
    Seeded(u64),
}

impl Jitter {
    /// Where in the first step of ray `ray` the raster's first line lies, in (0, 1].
    fn offset(self, ray: usize) -> f32 {
        match self {
            Self::Fixed => 1.0,
            Self::Seeded(seed) => 1.0 - unit_float(seed, ray as u64),
        }
    }
}

/// How densely and how far rays are marched; lengths in units of half the object box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarchConfig {
    /// Step length inside the object box.
    pub step_object: f32,
    /// Inside the box, how many steps the background alone is marched at once, where the object's
    /// grid is empty for six steps ahead: only the object needs fine steps. At most six.
    pub background_stride: u32,
    /// Intervals between the box and infinity, evenly spaced in `d / (d + 1)`; what lies beyond
    /// `far` or nearer than `near` is left out.
    pub background_samples: u32,
    /// Whether rays go on behind the object box. Without it, only what stands before the object or
    /// around it is found: enough for mattes.
    pub behind_box: bool,
    /// Where rays begin; finite where there is a background.
    pub near: f32,
    /// Where rays end; finite where the background behind the box is marched, whose last interval ends there and has
    /// a midpoint. Contracted, distances above 10^7 are as good as infinite.
    pub far: f32,
    /// Where the raster of steps lies.
    pub jitter: Jitter,
    /// A ray with more intervals than this is marched again with all steps twice as long, until
    /// they fit; after [`MAX_DOUBLINGS`] times the rest of the ray is cut off.
    pub max_intervals_per_ray: usize,
}

/// How often steps are doubled for a ray that has too many intervals.
pub const MAX_DOUBLINGS: u32 = 8;

impl Default for MarchConfig {
    fn default() -> Self {
        Self {
            step_object: 3.0f32.sqrt() * 2.0 / 1024.0,
            background_stride: 1,
            background_samples: 64,
            behind_box: true,
            near: 0.01,
            far: 1000.0,
            jitter: Jitter::Fixed,
            max_intervals_per_ray: 1024,
        }
    }
}

impl MarchConfig {
    /// Panics, naming `op`, when there is no step in the object's box, or an interval of the background would have no
    /// midpoint.
    #[track_caller]
    fn check(&self, op: &str, has_background: bool) {
        assert!(
            self.step_object > 0.0 && self.step_object.is_finite(),
            "{op}: a step of {} in the object's box",
            self.step_object
        );
        let ends = self.near.is_finite() && (self.far.is_finite() || !self.behind_box);
        assert!(
            ends || !has_background,
            "{op}: the background is marched from {} to {}, which must be finite",
            self.near,
            self.far
        );
    }
}

/// What the fields' grids say about occupancy; a field without a grid is never evaluated.
#[derive(Clone, Copy, Debug, Default)]
pub struct Grids<'a> {
    /// The object's, over the box [-1, 1]^3 (a half other than 1 is allowed, but the object is
    /// only marched within the box).
    pub object: Option<&'a OccupancyGrid>,
    /// The background's, over contracted space [-2, 2]^3.
    pub background: Option<&'a OccupancyGrid>,
}

/// Marches batches of rays and keeps its working memory between them.
#[derive(Clone, Debug, Default)]
pub struct Marcher {
    chunks: Vec<Chunk>,
}

/// Intervals of up to [`CHUNK`] rays.
#[derive(Clone, Debug, Default)]
struct Chunk {
    counts: Vec<u32>,
    t: Vec<f32>,
    dt: Vec<f32>,
    object: Vec<bool>,
    background: Vec<bool>,
    /// Of the ray at hand.
    object_steps: Flags,
    background_steps: Flags,
}

impl Marcher {
    /// A marcher without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Marches `rays` into `out`, whose former content is dropped and whose memory is used again.
    ///
    /// The result doesn't depend on the number of threads.
    ///
    /// # Panics
    /// When there is no step in the object's box, or the background would be marched from or to infinity: see
    /// [`MarchConfig::step_object`] and [`MarchConfig::far`].
    pub fn march(
        &mut self,
        rays: &[Ray],
        grids: Grids<'_>,
        config: &MarchConfig,
        out: &mut Intervals,
    ) {
        config.check("march", grids.background.is_some());
        let count = rays.len().div_ceil(CHUNK);
        if self.chunks.len() < count {
            self.chunks.resize_with(count, Chunk::default);
        }
        self.chunks[..count]
            .par_iter_mut()
            .zip(rays.par_chunks(CHUNK))
            .enumerate()
            .for_each(|(number, (chunk, rays))| {
                chunk.clear();
                for (i, ray) in rays.iter().enumerate() {
                    let offset = config.jitter.offset(number * CHUNK + i);
                    chunk.march_ray(ray, grids, config, offset);
                }
            });
        out.clear();
        out.ray_offsets.push(0);
        let mut end = 0;
        for chunk in &self.chunks[..count] {
            for &n in &chunk.counts {
                end += n;
                out.ray_offsets.push(end);
            }
            out.t.extend_from_slice(&chunk.t);
            out.dt.extend_from_slice(&chunk.dt);
            out.object.extend_from_slice(&chunk.object);
            out.background.extend_from_slice(&chunk.background);
        }
    }
}

/// [`Marcher::march`] for a single batch, with fresh memory.
///
/// # Panics
/// As [`Marcher::march`].
pub fn march(rays: &[Ray], grids: Grids<'_>, config: &MarchConfig) -> Intervals {
    let mut out = Intervals::default();
    Marcher::new().march(rays, grids, config, &mut out);
    out
}

impl Chunk {
    fn clear(&mut self) {
        self.counts.clear();
        self.truncate(0);
    }

    fn truncate(&mut self, len: usize) {
        self.t.truncate(len);
        self.dt.truncate(len);
        self.object.truncate(len);
        self.background.truncate(len);
    }

    #[inline]
    fn push(&mut self, from: f32, to: f32, object: bool, background: bool) {
        self.t.push(0.5 * (from + to));
        self.dt.push(to - from);
        self.object.push(object);
        self.background.push(background);
    }

    fn march_ray(&mut self, ray: &Ray, grids: Grids<'_>, config: &MarchConfig, offset: f32) {
        let start = self.t.len();
        let mut stretch = 1.0;
        for doubling in 0..=MAX_DOUBLINGS {
            self.march_once(ray, grids, config, offset, stretch);
            if self.t.len() - start <= config.max_intervals_per_ray {
                break;
            }
            if doubling == MAX_DOUBLINGS {
                self.truncate(start + config.max_intervals_per_ray);
            } else {
                self.truncate(start);
                stretch *= 2.0;
            }
        }
        self.counts.push((self.t.len() - start) as u32);
    }

    /// One ray with all steps `stretch` times as long; `offset` in (0, 1] is where in the first
    /// step the raster's first line lies.
    fn march_once(
        &mut self,
        ray: &Ray,
        grids: Grids<'_>,
        config: &MarchConfig,
        offset: f32,
        stretch: f32,
    ) {
        let (near, far) = (config.near, config.far);
        let inside = ray_box(ray, &Aabb::UNIT).and_then(|span| span.clip(near, far));
        let (before, behind, unit) = match inside {
            Some(span) => (span.near, span.far, 1.0),
            None => {
                let closest = (-ray.origin.dot(ray.direction)).clamp(near, far.max(near));
                let distance = ray.at(closest).abs().max_element().max(1.0);
                (closest, closest, distance)
            }
        };
        let outside = Outside {
            ray,
            grid: grids.background,
            unit,
            step: stretch / config.background_samples.max(1) as f32,
            offset,
        };
        self.approach(&outside, before, before - near);
        if let Some(span) = inside {
            let step = stretch * config.step_object;
            let raster = Raster {
                begin: span.near,
                end: span.far,
                first: span.near + offset * step,
                step,
            };
            let stride = config.background_stride.max(1) as usize;
            self.cross(ray, grids, &raster, stride);
        }
        if config.behind_box {
            self.recede(&outside, behind, far - behind);
        }
    }

    /// The stretch of length `length` that ends at `end`, where steps are finest.
    fn approach(&mut self, outside: &Outside<'_>, end: f32, length: f32) {
        let Some(grid) = outside.grid.filter(|_| length > 0.0) else {
            return;
        };
        let last = outside.position(length);
        // Raster lines from far to near; the first cut is the farthest line short of `last`.
        let mut line = ((last - outside.first()) / outside.step).ceil() as i64;
        let mut from = end - length;
        while from < end {
            line -= 1;
            let to = if line < 0 {
                end
            } else {
                let position = outside.first() + line as f32 * outside.step;
                (end - outside.distance(position)).clamp(from, end)
            };
            if to > from {
                if grid.occupied(contract(outside.ray.at(0.5 * (from + to)))) {
                    self.push(from, to, false, true);
                }
                from = to;
            } else if line < 0 {
                break;
            }
        }
    }

    /// The stretch of length `length` that begins at `begin`, where steps are finest.
    fn recede(&mut self, outside: &Outside<'_>, begin: f32, length: f32) {
        let Some(grid) = outside.grid.filter(|_| length > 0.0) else {
            return;
        };
        let last = outside.position(length);
        let end = begin + length;
        let mut from = begin;
        let mut line = 0;
        while from < end {
            let position = outside.first() + line as f32 * outside.step;
            line += 1;
            let to = if position < last {
                (begin + outside.distance(position)).clamp(from, end)
            } else {
                end
            };
            if to > from {
                // The last one is always there: behind all else stands the sky.
                if to >= end || grid.occupied(contract(outside.ray.at(0.5 * (from + to)))) {
                    self.push(from, to, false, true);
                }
                from = to;
            }
        }
    }

    /// The stretch inside the object box.
    fn cross(&mut self, ray: &Ray, grids: Grids<'_>, raster: &Raster, stride: usize) {
        for (flags, grid) in [
            (&mut self.object_steps, grids.object),
            (&mut self.background_steps, grids.background),
        ] {
            match grid {
                Some(grid) => flags.look_up(grid, ray, raster),
                None => flags.clear(),
            }
        }
        let mut k = 0;
        while let Some(next) = self.object_steps.next_of_either(&self.background_steps, k) {
            let object = self.object_steps.get(next);
            let background = self.background_steps.get(next);
            k = next + 1;
            // Not close to the object: there the background is what its plate shows.
            if !object && (k..next + CLEARANCE).all(|k| !self.object_steps.get(k)) {
                k = next + stride.min(CLEARANCE);
            }
            self.push(raster.line(next), raster.line(k), object, background);
        }
    }
}

/// How the background is marched outside the box.
struct Outside<'a> {
    ray: &'a Ray,
    grid: Option<&'a OccupancyGrid>,
    /// The distance `d` at which `d / (d + unit)` is one half.
    unit: f32,
    /// Spacing of the raster in `d / (d + unit)`.
    step: f32,
    offset: f32,
}

impl Outside<'_> {
    fn first(&self) -> f32 {
        self.offset * self.step
    }

    fn position(&self, distance: f32) -> f32 {
        distance / (distance + self.unit)
    }

    fn distance(&self, position: f32) -> f32 {
        self.unit * position / (1.0 - position).max(1e-7)
    }
}
