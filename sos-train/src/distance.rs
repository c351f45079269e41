//! The signed distance of a set of pixels or voxels.

use rayon::prelude::*;

/// Elements that one task computes.
const TASK: usize = 1024;
/// Columns that are turned into rows at a time: as many as a cache line holds.
const COLUMNS: usize = 16;

/// Signed distances between the centres of `inside` elements and others, in elements: negative inside,
/// cut off at `reach`.
///
/// `shape` has the number of elements along each axis, the fastest first; `inside` has their product.
#[must_use]
pub(crate) fn signed_distance(inside: &[bool], shape: &[usize], reach: usize) -> Vec<f32> {
    let outward = squared_distance(inside, true, shape, reach);
    let inward = squared_distance(inside, false, shape, reach);
    // The surface lies halfway between the last element inside and the first outside.
    let half = |squared: f32| (squared.sqrt() - 0.5).min(reach as f32);
    inside
        .iter()
        .zip(outward.iter().zip(&inward))
        .map(|(inside, (outward, inward))| {
            if *inside {
                -half(*inward)
            } else {
                half(*outward)
            }
        })
        .collect()
}

/// Squared distance of every element to the nearest that is `kind`, one axis at a time, in time that does not depend on the
/// reach (Felzenszwalb and Huttenlocher 2012).
fn squared_distance(inside: &[bool], kind: bool, shape: &[usize], reach: usize) -> Vec<f32> {
    let far = ((reach + 1) * (reach + 1)) as f32;
    let start = |i: &bool| if *i == kind { 0.0 } else { far };
    let mut squared: Vec<f32> = inside.iter().map(start).collect();
    if squared.is_empty() {
        return squared;
    }
    for &n in shape {
        squared
            .par_chunks_mut(n)
            .with_min_len(TASK.div_ceil(n))
            .for_each_init(Envelope::default, |envelope, line| {
                envelope.lower(line, far)
            });
        // The next axis becomes the fastest; after the last one all are where they were.
        squared = transposed(&squared, n);
    }
    squared
}

/// Parabolas that are the lowest of all along some stretch of a line.
#[derive(Default)]
struct Envelope(Vec<Parabola>);

struct Parabola {
    /// Where it begins to be the lowest.
    from: f64,
    /// Its place and value at its lowest point.
    root: f32,
    least: f32,
}

impl Envelope {
    /// Makes every element of a line the least of all others' values plus the squares of their distances, at most `far`.
    fn lower(&mut self, line: &mut [f32], far: f32) {
        let parabolas = &mut self.0;
        parabolas.clear();
        for (i, &least) in line.iter().enumerate().filter(|(_, least)| **least < far) {
            let root = i as f32;
            let height = |root: f32, least: f32| f64::from(least) + f64::from(root).powi(2);
            let mut from = f64::NEG_INFINITY;
            while let Some(last) = parabolas.last() {
                let rise = height(root, least) - height(last.root, last.least);
                from = rise / (2.0 * f64::from(root - last.root));
                if from > last.from {
                    break;
                }
                parabolas.pop();
                from = f64::NEG_INFINITY;
            }
            parabolas.push(Parabola { from, root, least });
        }
        let mut lowest = parabolas.iter().peekable();
        let Some(mut now) = lowest.next() else {
            return;
        };
        for (i, value) in line.iter_mut().enumerate() {
            while let Some(next) = lowest.next_if(|next| next.from < i as f64) {
                now = next;
            }
            *value = far.min(now.least + (i as f32 - now.root).powi(2));
        }
    }
}

/// Rows of `n` made columns.
fn transposed(values: &[f32], n: usize) -> Vec<f32> {
    let rows = values.len() / n;
    let mut columns = vec![0.0; values.len()];
    columns
        .par_chunks_mut(COLUMNS * rows)
        .enumerate()
        .for_each(|(block, columns)| {
            for (r, row) in values.chunks_exact(n).enumerate() {
                let row = &row[block * COLUMNS..];
                for (column, value) in columns.chunks_exact_mut(rows).zip(row) {
                    column[r] = *value;
                }
            }
        });
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_and_discs_have_their_distance() {
        let reach = 8;
        for shape in [&[32usize, 32, 32][..], &[40, 30]] {
            let distance = |i: usize| {
                let (mut rest, mut squared) = (i, 0.0);
                for &n in shape {
                    squared += ((rest % n) as f32 - 15.5).powi(2);
                    rest /= n;
                }
                squared.sqrt() - 9.0
            };
            let inside: Vec<bool> = (0..shape.iter().product())
                .map(|i| distance(i) < 0.0)
                .collect();
            let found = signed_distance(&inside, shape, reach);
            for (i, found) in found.into_iter().enumerate() {
                let expected = distance(i).clamp(-(reach as f32), reach as f32);
                assert!(
                    (found - expected).abs() < 0.9,
                    "{shape:?}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn distances_are_those_to_the_nearest_element_of_the_other_kind() {
        let (shape, reach) = ([13usize, 9, 5], 6);
        let place = |i: usize| [i % 13, i / 13 % 9, i / 117];
        let inside: Vec<bool> = (0..585).map(|i| i * i % 97 < 9).collect();
        let found = signed_distance(&inside, &shape, reach);
        for (i, found) in found.into_iter().enumerate() {
            let others = (0..585).filter(|&j| inside[j] != inside[i]);
            let squared = others.map(|j| {
                let (a, b) = (place(i), place(j));
                (0..3).map(|k| a[k].abs_diff(b[k]).pow(2)).sum::<usize>()
            });
            let nearest = squared.min().unwrap_or(usize::MAX) as f32;
            let expected = (nearest.sqrt() - 0.5).min(reach as f32);
            assert_eq!(found.abs(), expected, "{i}");
            assert_eq!(found < 0.0, inside[i]);
        }
        assert!(signed_distance(&[], &[0, 4], 3).is_empty());
        assert_eq!(signed_distance(&[true; 4], &[2, 2], 3), [-3.0; 4]);
    }
}
