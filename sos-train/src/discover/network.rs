//! Labels over the voxels of a surface: the potentials of a network that conducts well where colours are alike and
//! badly in creases (random walks, Grady 2006).

use glam::Vec3;
use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;

use super::normal::normal;
use crate::voxels::neighbours;

/// Conductance between colours however far apart.
const LEAST_CONDUCTANCE: f32 = 1e-3;
/// Rounds of conjugate gradients at most, and the residual at which they end, over the first.
const ROUNDS: usize = 400;
const RESIDUAL: f64 = 1e-4;

/// Voxels of the surface and how well neighbours conduct.
pub(super) struct Network {
    /// Where each voxel's neighbours begin in `others`.
    starts: Vec<usize>,
    others: Vec<(u32, f32)>,
}

impl Network {
    /// Of the voxels `places` of `resolution^3`, which have `colours` (sRGB in `[0, 1]`), `solid` being the fused distances.
    /// Two of them that are the sides of a right angle conduct worse by `exp(-0.7 creases)`.
    pub(super) fn new(
        places: &[usize],
        colours: &[Vec3],
        solid: &[f32],
        resolution: usize,
        creases: f32,
    ) -> Self {
        let mut number = vec![u32::MAX; resolution.pow(3)];
        for (i, place) in places.iter().enumerate() {
            number[*place] = i as u32;
        }
        let normals: Vec<Vec3> = places
            .par_iter()
            .map(|place| normal(solid, *place, resolution))
            .collect();
        let next_to = |i: usize| {
            let number = &number;
            neighbours(places[i], resolution)
                .map(move |place| number[place])
                .filter(|other| *other != u32::MAX)
        };
        let apart = |i: usize, j: usize| colours[i].distance_squared(colours[j]);
        let beside = |i: usize| {
            next_to(i).fold((0.0f64, 0usize), |(sum, count), j| {
                (sum + f64::from(apart(i, j as usize)), count + 1)
            })
        };
        // Added up in order, as sums in any other would differ from run to run.
        let all: Vec<(f64, usize)> = (0..places.len()).into_par_iter().map(beside).collect();
        let (sum, count) = all
            .into_iter()
            .fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        let spread = (2.0 * sum / count.max(1) as f64).max(1e-9) as f32;
        let all: Vec<Vec<(u32, f32)>> = (0..places.len())
            .into_par_iter()
            .map(|i| {
                let here = ProbabilityMap::centre(resolution, places[i]);
                next_to(i)
                    .map(|j| {
                        let other = j as usize;
                        let way = ProbabilityMap::centre(resolution, places[other]) - here;
                        let steps = way.length() * 0.5 * resolution as f32;
                        let crease =
                            (0.5 * (normals[i] - normals[other]).dot(way.normalize())).max(0.0);
                        let alike = (-apart(i, other) / spread).exp() + LEAST_CONDUCTANCE;
                        (j, alike * (-creases * crease).exp() / steps)
                    })
                    .collect()
            })
            .collect();
        let mut starts = vec![0];
        for some in &all {
            starts.push(starts[starts.len() - 1] + some.len());
        }
        Self {
            starts,
            others: all.into_iter().flatten().collect(),
        }
    }

    /// The labels `x` for which the sum of `held (x - target)^2` over voxels and of `conductance (x - x')^2` over neighbours is
    /// the least; `held` is above zero.
    pub(super) fn solve(&self, held: &[f32], target: &[f32]) -> Vec<f32> {
        let n = held.len();
        let others = |i: usize| &self.others[self.starts[i]..self.starts[i + 1]];
        let diagonal: Vec<f32> = (0..n)
            .map(|i| held[i] + others(i).iter().map(|(_, w)| w).sum::<f32>())
            .collect();
        let apply = |x: &[f32]| -> Vec<f32> {
            (0..n)
                .into_par_iter()
                .map(|i| {
                    let around: f32 = others(i).iter().map(|(j, w)| w * x[*j as usize]).sum();
                    diagonal[i] * x[i] - around
                })
                .collect()
        };
        let dot =
            |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum() };
        let mut x = target.to_vec();
        let mut residual: Vec<f32> = apply(&x)
            .iter()
            .enumerate()
            .map(|(i, ax)| held[i] * target[i] - ax)
            .collect();
        let scaled =
            |r: &[f32]| -> Vec<f32> { r.iter().zip(&diagonal).map(|(r, d)| r / d).collect() };
        let mut z = scaled(&residual);
        let mut way = z.clone();
        let mut rz = dot(&residual, &z);
        let enough = RESIDUAL * RESIDUAL * rz;
        for _ in 0..ROUNDS {
            if rz <= enough {
                break;
            }
            let along = apply(&way);
            let step = (rz / dot(&way, &along)) as f32;
            for i in 0..n {
                x[i] += step * way[i];
                residual[i] -= step * along[i];
            }
            z = scaled(&residual);
            let next = dot(&residual, &z);
            let keep = (next / rz) as f32;
            rz = next;
            for (way, z) in way.iter_mut().zip(&z) {
                *way = z + keep * *way;
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 40;

    /// Distances of a ball on a table, and the voxels of their surfaces, each with whether it is the ball's.
    fn ball_on_table() -> (Vec<f32>, Vec<(usize, bool)>) {
        let of = |cell| {
            let p = ProbabilityMap::centre(N, cell);
            (p.distance(Vec3::Z * 0.1) - 0.4, p.z + 0.3)
        };
        let solid = (0..N.pow(3)).map(|cell| {
            let (ball, table) = of(cell);
            ball.min(table)
        });
        let solid: Vec<f32> = solid.collect();
        let on_surface = |cell: &usize| (-0.05..0.0).contains(&solid[*cell]);
        let cells = (0..N.pow(3)).filter(on_surface);
        let cells = cells.map(|cell| (cell, of(cell).0 < of(cell).1)).collect();
        (solid, cells)
    }

    #[test]
    fn labels_of_one_side_spread_to_the_other_and_end_in_the_crease() {
        let (solid, cells) = ball_on_table();
        let (places, truth): (Vec<usize>, Vec<bool>) = cells.into_iter().unzip();
        let seen = |place: usize| ProbabilityMap::centre(N, place).x > 0.1;
        let held: Vec<f32> = places
            .iter()
            .map(|place| if seen(*place) { 10.0 } else { 1e-6 })
            .collect();
        let target: Vec<f32> = truth.iter().map(|ball| f32::from(*ball)).collect();
        // Where nothing is seen, nothing is told.
        let told = places.iter().zip(&target);
        let told: Vec<f32> = told
            .map(|(place, label)| if seen(*place) { *label } else { 0.0 })
            .collect();
        let share = |colours: &[Vec3]| {
            let labels = Network::new(&places, colours, &solid, N, 4.0).solve(&held, &told);
            let right = labels.iter().zip(&truth).zip(&places);
            let hidden = right.filter(|(_, place)| !seen(**place));
            let right: Vec<bool> = hidden.map(|((x, ball), _)| (*x > 0.5) == *ball).collect();
            right.iter().filter(|right| **right).count() as f32 / right.len() as f32
        };
        // All of one colour, and each of its own.
        let grey = vec![Vec3::splat(0.5); places.len()];
        assert!(share(&grey) > 0.93, "{}", share(&grey));
        let of = |ball: &bool| if *ball { Vec3::X } else { Vec3::splat(0.5) };
        let own: Vec<Vec3> = truth.iter().map(of).collect();
        assert!(share(&own) > 0.995, "{}", share(&own));
    }

    #[test]
    fn labels_are_where_their_sum_of_squares_is_least() {
        // Three in a row: held at 1, held weakly at 0.5, held at 0.
        let row = Network {
            starts: vec![0, 1, 3, 4],
            others: vec![(1, 2.0), (0, 2.0), (2, 1.0), (1, 1.0)],
        };
        let (held, target) = ([4.0, 0.1, 4.0], [1.0, 0.5, 0.0]);
        let x = row.solve(&held, &target);
        let slope = |i: usize| {
            let around = &row.others[row.starts[i]..row.starts[i + 1]];
            let pull: f32 = around
                .iter()
                .map(|(j, w)| w * (x[i] - x[*j as usize]))
                .sum();
            held[i] * (x[i] - target[i]) + pull
        };
        assert!((0..3).all(|i| slope(i).abs() < 1e-3), "{x:?}");
        assert!(x[0] > x[1] && x[1] > x[2]);
    }
}
