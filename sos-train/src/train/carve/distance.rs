//! The signed distance of a set of voxels.

use rayon::prelude::*;

/// Euclidean distances up to this many voxels are told apart.
pub const REACH: usize = 8;

/// Signed distances, in voxels and negative inside, between the centres of `inside` voxels and
/// others; cut off at [`REACH`]. `[n^3]`, x fastest.
#[must_use]
pub fn signed_distance(inside: &[bool], n: usize) -> Vec<f32> {
    let outward = squared_distance(inside, n);
    let outside: Vec<bool> = inside.iter().map(|i| !i).collect();
    let inward = squared_distance(&outside, n);
    // The surface lies halfway between the last voxel inside and the first outside.
    let half = |squared: f32| (squared.sqrt() - 0.5).min(REACH as f32);
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

/// Removes connected parts (sharing faces) with fewer voxels than `share` of the largest one.
pub fn keep_large_parts(inside: &mut [bool], n: usize, share: f32) {
    let mut part = vec![0u32; inside.len()];
    let mut sizes = vec![0usize];
    let mut stack = Vec::new();
    for seed in 0..inside.len() {
        if !inside[seed] || part[seed] != 0 {
            continue;
        }
        let number = sizes.len() as u32;
        sizes.push(0);
        part[seed] = number;
        stack.push(seed);
        while let Some(i) = stack.pop() {
            sizes[number as usize] += 1;
            for (axis, stride) in [1, n, n * n].into_iter().enumerate() {
                let at = i / n.pow(axis as u32) % n;
                let neighbours = [
                    (at > 0).then(|| i - stride),
                    (at + 1 < n).then(|| i + stride),
                ];
                for j in neighbours.into_iter().flatten() {
                    if inside[j] && part[j] == 0 {
                        part[j] = number;
                        stack.push(j);
                    }
                }
            }
        }
    }
    let largest = sizes.iter().copied().max().unwrap_or(0) as f32;
    for (inside, part) in inside.iter_mut().zip(part) {
        *inside = *inside && sizes[part as usize] as f32 >= share * largest;
    }
}

/// Squared distance of every voxel to the nearest of `set`, one axis at a time (Felzenszwalb and
/// Huttenlocher 2012, within a window).
fn squared_distance(set: &[bool], n: usize) -> Vec<f32> {
    let far = ((REACH + 1) * (REACH + 1)) as f32;
    let mut squared: Vec<f32> = set.iter().map(|s| if *s { 0.0 } else { far }).collect();
    for axis in 0..3 {
        let stride = n.pow(axis);
        squared = (0..squared.len())
            .into_par_iter()
            .with_min_len(n)
            .map(|i| {
                let at = i / stride % n;
                let window = at.saturating_sub(REACH)..(at + REACH + 1).min(n);
                window
                    .map(|k| squared[i + k * stride - at * stride] + (k as f32 - at as f32).powi(2))
                    .fold(far, f32::min)
            })
            .collect();
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_has_its_distance() {
        let n = 32;
        let radius = 9.0;
        let distance = |i: usize| {
            let at = |v: usize| v as f32 - 15.5;
            let (x, y, z) = (at(i % n), at(i / n % n), at(i / (n * n)));
            (x * x + y * y + z * z).sqrt() - radius
        };
        let mut inside: Vec<bool> = (0..n * n * n).map(|i| distance(i) < 0.0).collect();
        // A crumb far away.
        inside[0] = true;
        keep_large_parts(&mut inside, n, 0.1);
        assert!(!inside[0]);
        for (i, found) in signed_distance(&inside, n).into_iter().enumerate() {
            let expected = distance(i).clamp(-(REACH as f32), REACH as f32);
            assert!((found - expected).abs() < 0.9, "{found} {expected}");
        }
    }
}
