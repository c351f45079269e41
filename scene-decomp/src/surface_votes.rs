//! m^P from the masks of the views that really see a place: votes cast on surfaces.
//!
//! The soft visual hull asks every view about every point, also those that look at it through
//! something else. Once the scene's geometry is known roughly, each pixel can vote where its light
//! comes from instead, with the rendering weights of its ray's samples: a place is the object's when
//! the views that see it mostly say so. Wrong pixels are outvoted, what stands before the object
//! gets votes of its own, and the ground under it is no part of it.

use glam::Vec3;
use rayon::prelude::*;

use crate::probability::ProbabilityMap;

mod spread;
mod tipping_point;

use spread::spread;

/// Votes on the voxels of the cube `[-1, 1]^3`, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceVotes {
    resolution: usize,
    object: Vec<f32>,
    total: Vec<f32>,
}

/// Radii, in voxels, over which votes are spread, and how much each spread counts beside a voxel's
/// own votes. Close by that evens out chance; farther away it gives space between surfaces the
/// side of the nearest one.
const SPREADS: [(usize, f32); 3] = [(1, 4.0), (3, 0.2), (8, 1e-2)];
/// The prior's weight, in votes: it decides where no surface is near.
const PRIOR_WEIGHT: f32 = 1e-4;

impl SurfaceVotes {
    /// No votes yet.
    #[must_use]
    pub fn new(resolution: usize) -> Self {
        let cells = resolution.pow(3);
        Self {
            resolution,
            object: vec![0.0; cells],
            total: vec![0.0; cells],
        }
    }

    /// A vote of this `weight` at `point`, for the object or against it; outside the cube none.
    pub fn add(&mut self, point: Vec3, weight: f32, object: bool) {
        if point.is_nan() || point.abs().max_element() >= 1.0 {
            return;
        }
        let n = self.resolution;
        let voxel = ((point * 0.5 + 0.5) * n as f32).as_usizevec3();
        let [x, y, z] = voxel.to_array().map(|v| v.min(n - 1));
        let cell = (z * n + y) * n + x;
        self.total[cell] += weight;
        if object {
            self.object[cell] += weight;
        }
    }

    /// Makes older votes count less: geometry has moved on since.
    pub fn fade(&mut self, factor: f32) {
        for values in [&mut self.object, &mut self.total] {
            values.par_iter_mut().for_each(|value| *value *= factor);
        }
    }

    /// The votes as lists, for the object and in all, to be stored in a checkpoint.
    #[must_use]
    pub fn values(&self) -> [&[f32]; 2] {
        [&self.object, &self.total]
    }

    /// Takes over what [`values`](Self::values) gave; `None` when lengths are not the cube's.
    #[must_use]
    pub fn from_values(resolution: usize, object: Vec<f32>, total: Vec<f32>) -> Option<Self> {
        let cells = resolution.pow(3);
        (object.len() == cells && total.len() == cells).then_some(Self {
            resolution,
            object,
            total,
        })
    }

    /// m^P: the share of votes for the object in and around each voxel, `prior` where there are
    /// none.
    ///
    /// Shares are given as probabilities: one of `tipping_point` as one half, others as the odds
    /// shift with it. With 0.5 they stay what they are.
    ///
    /// # Panics
    /// When the prior has another resolution.
    #[must_use]
    pub fn map(&self, prior: &ProbabilityMap, tipping_point: f32) -> ProbabilityMap {
        let n = self.resolution;
        assert_eq!(
            prior.resolution(),
            n,
            "SurfaceVotes::map: the prior has another resolution"
        );
        let mut object: Vec<f32> = self.object.clone();
        let mut total: Vec<f32> = self.total.clone();
        for (radius, weight) in SPREADS {
            for (sum, votes) in [(&mut object, &self.object), (&mut total, &self.total)] {
                let spread = spread(votes, n, radius);
                sum.par_iter_mut()
                    .zip(spread)
                    .for_each(|(sum, spread)| *sum += weight * spread);
            }
        }
        let values = object
            .par_iter()
            .zip(&total)
            .zip(prior.values())
            .map(|((&object, &total), prior)| {
                let for_it = object * (1.0 - tipping_point);
                let against = (total - object) * tipping_point;
                let both = for_it + against;
                let voted = if both > 0.0 {
                    total * for_it / both
                } else {
                    0.0
                };
                (voted + PRIOR_WEIGHT * prior) / (total + PRIOR_WEIGHT)
            })
            .collect();
        ProbabilityMap::new(n, values)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn votes_decide_where_there_are_any_and_the_prior_elsewhere() {
        let n = 64;
        let prior = ProbabilityMap::new(n, vec![0.9; n * n * n]);
        let mut votes = SurfaceVotes::new(n);
        assert_eq!(votes.map(&prior, 0.5), prior);
        // A floor z = 0 that all views call background but one in five.
        for x in -20..20 {
            for y in -20..20 {
                for k in 0..5 {
                    let p = Vec3::new(0.025 * x as f32, 0.025 * y as f32, 0.01);
                    votes.add(p, 1.0, k == 0);
                }
            }
        }
        let map = votes.map(&prior, 0.5);
        let on = map.at(Vec3::new(0.0, 0.0, 0.03));
        assert!((on - 0.2).abs() < 0.02, "{on}");
        // Just below the floor nobody sees anything: the floor's side.
        let below = map.at(Vec3::new(0.0, 0.0, -0.15));
        assert!((below - 0.2).abs() < 0.1, "{below}");
        let far = map.at(Vec3::new(0.0, 0.0, 0.95));
        assert!(far > 0.8, "{far}");
        // One view in five is enough where masks hardly ever call anything else object.
        let on = votes.map(&prior, 0.2).at(Vec3::new(0.0, 0.0, 0.03));
        assert!((on - 0.5).abs() < 0.03, "{on}");
    }

    #[test]
    fn fading_keeps_the_share() {
        let n = 16;
        let prior = ProbabilityMap::new(n, vec![0.0; n * n * n]);
        let mut votes = SurfaceVotes::new(n);
        votes.add(Vec3::ZERO, 3.0, true);
        votes.add(Vec3::ZERO, 1.0, false);
        votes.add(Vec3::splat(2.0), 1.0, false);
        let before = votes.map(&prior, 0.5).at(Vec3::splat(0.06));
        votes.fade(0.5);
        let after = votes.map(&prior, 0.5).at(Vec3::splat(0.06));
        assert!((before - 0.75).abs() < 0.01 && (after - before).abs() < 0.01);
        let [object, total] = votes.values().map(<[f32]>::to_vec);
        assert_eq!(SurfaceVotes::from_values(n, object, total), Some(votes));
    }
}
