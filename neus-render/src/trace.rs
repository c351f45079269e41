//! Sphere tracing (Hart 1996): the first surface on each ray, for final renders.
//!
//! All rays that are still under way take their step with one evaluation of the field. Learned
//! distances aren't exact, so steps are shortened by a factor, and a ray that steps through the
//! surface is brought back by regula falsi between the last point outside and the first inside.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{field::SdfBatch, intersect::Span, rays::Ray};

/// When a ray has arrived, and how carefully it walks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TraceConfig {
    /// A signed distance below this is a hit.
    pub tolerance: f32,
    /// Steps are the signed distance times this; below 1 for fields that overestimate.
    pub step_scale: f32,
    /// Least step, so that rays pass along surfaces that they graze.
    pub least_step: f32,
    /// Steps after which a ray is given up.
    pub max_steps: u32,
    /// Refinements of a bracketed surface; each is one evaluation for all such rays.
    pub max_refinements: u32,
}

impl Default for TraceConfig {
    fn default() -> Self {
        Self {
            tolerance: 1e-4,
            step_scale: 0.9,
            least_step: 5e-4,
            max_steps: 256,
            max_refinements: 12,
        }
    }
}

/// How a ray ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Hit {
    /// It meets the surface at this distance.
    Surface(f32),
    /// It leaves its span without a surface, or has no span.
    Miss,
    /// It is still under way, at this distance, after the allowed number of steps.
    GivenUp(f32),
}

impl Hit {
    /// The distance of a hit.
    pub fn distance(self) -> Option<f32> {
        match self {
            Self::Surface(t) => Some(t),
            Self::Miss | Self::GivenUp(_) => None,
        }
    }
}

/// How the batch went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceStatistics {
    /// Rays that met a surface.
    pub hits: usize,
    /// Rays that met none.
    pub misses: usize,
    /// Rays given up.
    pub given_up: usize,
    /// Evaluations of the field at one point.
    pub evaluations: usize,
    /// Batched evaluations.
    pub rounds: usize,
}

/// A ray under way.
struct Walker {
    ray: usize,
    t: f32,
    far: f32,
    /// Last point outside: distance along the ray and signed distance.
    outside: (f32, f32),
    phase: Phase,
    steps: u32,
}

enum Phase {
    Walking,
    /// Between `outside` and this point inside (distance along the ray, signed distance).
    Bracketed((f32, f32)),
}

/// The first surface on each ray within its span, `[rays]`; a ray without a span misses.
///
/// A ray that begins inside a solid hits where it begins.
///
/// ```
/// use glam::Vec3;
/// use neus_render::{
///     field::FnSdf,
///     intersect::{Aabb, ray_box},
///     rays::Ray,
///     trace::{TraceConfig, sphere_trace},
/// };
///
/// let sphere = FnSdf(|p: Vec3| p.length() - 0.5);
/// let rays = [
///     Ray { origin: Vec3::new(0.0, 0.0, -3.0), direction: Vec3::Z },
///     Ray { origin: Vec3::new(0.9, 0.0, -3.0), direction: Vec3::Z },
/// ];
/// let spans = rays.map(|ray| ray_box(&ray, &Aabb::UNIT));
/// let (hits, statistics) = sphere_trace(&sphere, &rays, &spans, &TraceConfig::default());
/// assert!((hits[0].distance().expect("in the middle") - 2.5).abs() < 1e-3);
/// assert_eq!(hits[1].distance(), None);
/// assert_eq!((statistics.hits, statistics.misses), (1, 1));
/// ```
///
/// # Panics
/// When there are not as many spans as rays.
pub fn sphere_trace(
    field: &impl SdfBatch,
    rays: &[Ray],
    spans: &[Option<Span>],
    config: &TraceConfig,
) -> (Vec<Hit>, TraceStatistics) {
    assert_eq!(
        rays.len(),
        spans.len(),
        "sphere_trace: {} rays but {} spans",
        rays.len(),
        spans.len()
    );
    let mut hits = vec![Hit::Miss; rays.len()];
    let mut statistics = TraceStatistics::default();
    let mut walkers: Vec<Walker> = spans
        .iter()
        .enumerate()
        .filter_map(|(ray, span)| {
            let span = span.as_ref()?;
            Some(Walker {
                ray,
                t: span.near,
                far: span.far,
                outside: (span.near, f32::INFINITY),
                phase: Phase::Walking,
                steps: 0,
            })
        })
        .collect();
    let mut points: Vec<Vec3> = Vec::with_capacity(walkers.len());
    let mut values = Vec::new();
    while !walkers.is_empty() {
        points.clear();
        points.extend(walkers.iter().map(|walker| rays[walker.ray].at(walker.t)));
        values.clear();
        values.resize(points.len(), 0.0);
        field.sdf(&points, &mut values);
        statistics.rounds += 1;
        statistics.evaluations += points.len();
        let mut value = values.iter();
        walkers.retain_mut(|walker| {
            let sdf = value.next().copied().unwrap_or(f32::NAN);
            match walker.step(sdf, config) {
                None => true,
                Some(hit) => {
                    hits[walker.ray] = hit;
                    false
                }
            }
        });
    }
    for hit in &hits {
        match hit {
            Hit::Surface(_) => statistics.hits += 1,
            Hit::Miss => statistics.misses += 1,
            Hit::GivenUp(_) => statistics.given_up += 1,
        }
    }
    (hits, statistics)
}

impl Walker {
    /// Takes the signed distance at `t` and moves on; how the ray ended, if it did.
    fn step(&mut self, sdf: f32, config: &TraceConfig) -> Option<Hit> {
        self.steps += 1;
        if sdf.is_nan() {
            return Some(Hit::GivenUp(self.t));
        }
        if sdf.abs() <= config.tolerance {
            return Some(Hit::Surface(self.t));
        }
        match self.phase {
            Phase::Walking if sdf < 0.0 => {
                if self.outside.1 == f32::INFINITY {
                    return Some(Hit::Surface(self.t));
                }
                self.phase = Phase::Bracketed((self.t, sdf));
                self.steps = 0;
            }
            Phase::Walking => {
                self.outside = (self.t, sdf);
                if self.t >= self.far {
                    return Some(Hit::Miss);
                }
                if self.steps >= config.max_steps {
                    return Some(Hit::GivenUp(self.t));
                }
                let step = (config.step_scale * sdf).max(config.least_step);
                // The span's end is looked at, too: a surface may lie just before it.
                self.t = (self.t + step).min(self.far);
                return None;
            }
            Phase::Bracketed(inside) => {
                let inside = if sdf < 0.0 { (self.t, sdf) } else { inside };
                if sdf > 0.0 {
                    self.outside = (self.t, sdf);
                }
                self.phase = Phase::Bracketed(inside);
                if self.steps >= config.max_refinements {
                    return Some(Hit::Surface(self.t));
                }
            }
        }
        if let Phase::Bracketed(inside) = self.phase {
            // Kept off the ends, so that a bent field can't stall one of them.
            let share = (self.outside.1 / (self.outside.1 - inside.1)).clamp(0.1, 0.9);
            self.t = self.outside.0 + share * (inside.0 - self.outside.0);
        }
        None
    }
}
