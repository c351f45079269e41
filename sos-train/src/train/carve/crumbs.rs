//! Small parts of a set of voxels.

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
