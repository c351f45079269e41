//! Values spread over their surroundings: means over cubes, twice, which is nearly a Gaussian.
//!
//! Each axis by itself, in planes that stay in a core's cache: a window's sum is the one before, plus the value
//! that enters and less the one that leaves, so that the time does not depend on the radius. Sums run beside each
//! other through all rows of a plane. They are in `f64`, so that what has left leaves nothing behind.

use pulp::Arch;
use rayon::prelude::*;

/// Edge of the squares in which a plane is turned.
const BLOCK: usize = 16;

/// Means over cubes of `2 radius + 1` voxels, twice, of `values` `[n^3]`; outside the cube counts as zero.
pub(super) fn spread(values: &[f32], n: usize, radius: usize) -> Vec<f32> {
    let arch = Arch::new();
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(n * n)
        .zip(values.par_chunks(n * n))
        .for_each_init(
            || Plane::new(n),
            |plane, (out, values)| {
                arch.dispatch(|| {
                    plane.values.copy_from_slice(values);
                    plane.average(radius);
                    turn(&plane.values, &mut plane.means, n);
                    std::mem::swap(&mut plane.values, &mut plane.means);
                    plane.average(radius);
                    turn(&plane.values, out, n);
                });
            },
        );
    // Of each plane across z, its rows.
    let mut planes: Vec<Vec<&mut [f32]>> = (0..n).map(|_| Vec::with_capacity(n)).collect();
    for (number, row) in out.chunks_mut(n).enumerate() {
        planes[number % n].push(row);
    }
    planes.into_par_iter().for_each_init(
        || Plane::new(n),
        |plane, mut rows| {
            arch.dispatch(|| {
                for (to, row) in plane.values.chunks_exact_mut(n).zip(&rows) {
                    to.copy_from_slice(row);
                }
                plane.average(radius);
                for (row, from) in rows.iter_mut().zip(plane.values.chunks_exact(n)) {
                    row.copy_from_slice(from);
                }
            });
        },
    );
    out
}

/// A plane of a cube, with working memory.
struct Plane {
    n: usize,
    /// `[n * n]`
    values: Vec<f32>,
    means: Vec<f32>,
    /// The window of each column.
    sums: Vec<f64>,
    /// What lies beyond the plane.
    nothing: Vec<f32>,
}

impl Plane {
    fn new(n: usize) -> Self {
        Self {
            n,
            values: vec![0.0; n * n],
            means: vec![0.0; n * n],
            sums: vec![0.0; n],
            nothing: vec![0.0; n],
        }
    }

    /// Means along columns, twice.
    #[inline(always)]
    fn average(&mut self, radius: usize) {
        for _ in 0..2 {
            self.window_means(radius);
            std::mem::swap(&mut self.values, &mut self.means);
        }
    }

    #[inline(always)]
    fn window_means(&mut self, radius: usize) {
        let n = self.n;
        let share = 1.0 / (2 * radius + 1) as f64;
        let row = |at: usize| -> &[f32] { &self.values[at * n..][..n] };
        self.sums.fill(0.0);
        for at in 0..radius.min(n) {
            for (sum, &value) in self.sums.iter_mut().zip(row(at)) {
                *sum += f64::from(value);
            }
        }
        for (at, means) in self.means.chunks_exact_mut(n).enumerate() {
            let enters = at + radius;
            let enters = if enters < n {
                row(enters)
            } else {
                &self.nothing
            };
            let leaves = match at.checked_sub(radius) {
                Some(at) => row(at),
                None => &self.nothing,
            };
            let ends = enters.iter().zip(leaves);
            for ((sum, mean), (&enters, &leaves)) in self.sums.iter_mut().zip(means).zip(ends) {
                *sum += f64::from(enters);
                *mean = (share * *sum) as f32;
                *sum -= f64::from(leaves);
            }
        }
    }
}

/// Rows become columns.
#[inline(always)]
fn turn(from: &[f32], to: &mut [f32], n: usize) {
    for first_y in (0..n).step_by(BLOCK) {
        for first_x in (0..n).step_by(BLOCK) {
            for y in first_y..n.min(first_y + BLOCK) {
                for x in first_x..n.min(first_x + BLOCK) {
                    to[x * n + y] = from[y * n + x];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means over windows along one axis, by their definition.
    fn means(values: &[f64], n: usize, axis: usize, radius: usize) -> Vec<f64> {
        let stride = n.pow(axis as u32);
        (0..values.len())
            .map(|i| {
                let at = i / stride % n;
                let window = at.saturating_sub(radius)..(at + radius + 1).min(n);
                let sum: f64 = window.map(|k| values[i + k * stride - at * stride]).sum();
                sum / (2 * radius + 1) as f64
            })
            .collect()
    }

    #[test]
    fn spreading_is_taking_means_along_each_axis_twice() {
        // Not a multiple of the blocks.
        for (n, radius) in [(8, 2), (19, 3), (5, 8)] {
            let values: Vec<f32> = (0..n * n * n).map(|i| ((i * 37) % 101) as f32).collect();
            let mut expected: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
            for axis in [0, 1, 2, 0, 1, 2] {
                expected = means(&expected, n, axis, radius);
            }
            for (found, expected) in spread(&values, n, radius).iter().zip(expected) {
                assert!(
                    (f64::from(*found) - expected).abs() < 1e-4,
                    "{found} {expected}"
                );
            }
        }
    }
}
