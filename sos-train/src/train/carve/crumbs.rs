//! Small parts of a set of voxels.

use crate::voxels::{components, faces};

/// Removes connected parts (sharing faces) with fewer voxels than `share` of the largest one.
pub fn keep_large_parts(inside: &mut [bool], n: usize, share: f32) {
    let (part, count) = components(inside, |cell| faces(cell, n));
    let mut sizes = vec![0usize; count as usize + 1];
    for part in part.iter().filter(|part| **part != 0) {
        sizes[*part as usize] += 1;
    }
    let largest = sizes.iter().copied().max().unwrap_or(0) as f32;
    for (inside, part) in inside.iter_mut().zip(part) {
        *inside = *inside && sizes[part as usize] as f32 >= share * largest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crumb_far_away_is_removed_and_the_rest_stays() {
        let n = 8;
        let mut inside = vec![false; n * n * n];
        inside[0] = true;
        inside[200..212].fill(true);
        let mut expected = inside.clone();
        expected[0] = false;
        keep_large_parts(&mut inside, n, 0.1);
        assert_eq!(inside, expected);
    }
}
