//! Voxels of a cube, `n` along each axis and x fastest: what is next to what, and what hangs together.

/// The up to 6 voxels that share a face with one.
pub(crate) fn faces(cell: usize, n: usize) -> impl Iterator<Item = usize> {
    [1, n, n * n].into_iter().flat_map(move |step| {
        let at = cell / step % n;
        let before = (at > 0).then(|| cell - step);
        let after = (at + 1 < n).then(|| cell + step);
        [before, after].into_iter().flatten()
    })
}

/// The up to 26 voxels that share a face, an edge or a corner with one.
pub(crate) fn neighbours(cell: usize, n: usize) -> impl Iterator<Item = usize> {
    let at = [cell % n, cell / n % n, cell / (n * n)].map(|v| v as i64);
    (0..27i64).filter(|k| *k != 13).filter_map(move |k| {
        let to = [at[0] + k % 3 - 1, at[1] + k / 3 % 3 - 1, at[2] + k / 9 - 1];
        to.iter()
            .all(|v| (0..n as i64).contains(v))
            .then(|| ((to[2] * n as i64 + to[1]) * n as i64 + to[0]) as usize)
    })
}

/// Connected sets of the voxels `inside`, which are connected where one is `next_to` the other: the number of each
/// voxel's set, from 1 on, and how many there are. 0 is none.
pub(crate) fn components<I: Iterator<Item = usize>>(
    inside: &[bool],
    next_to: impl Fn(usize) -> I,
) -> (Vec<u32>, u32) {
    let mut labels = vec![0; inside.len()];
    let (mut count, mut stack) = (0, Vec::new());
    for seed in 0..inside.len() {
        if !inside[seed] || labels[seed] != 0 {
            continue;
        }
        count += 1;
        labels[seed] = count;
        stack.push(seed);
        while let Some(cell) = stack.pop() {
            for next in next_to(cell) {
                if inside[next] && labels[next] == 0 {
                    labels[next] = count;
                    stack.push(next);
                }
            }
        }
    }
    (labels, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 3;

    #[test]
    fn a_corner_has_fewer_around_it_than_the_middle() {
        let count = |cell| (faces(cell, N).count(), neighbours(cell, N).count());
        assert_eq!(
            [0, 1, 4, 13].map(count),
            [(3, 7), (4, 11), (5, 17), (6, 26)]
        );
        let around: Vec<usize> = faces(13, N).collect();
        assert_eq!(around, [12, 14, 10, 16, 4, 22]);
    }

    #[test]
    fn what_touches_by_an_edge_hangs_together_only_where_edges_count() {
        let inside: Vec<bool> = (0..27).map(|cell| [0, 4, 26].contains(&cell)).collect();
        let (labels, count) = components(&inside, |cell| faces(cell, N));
        assert_eq!((labels[0], labels[4], labels[26], labels[1]), (1, 2, 3, 0));
        assert_eq!(count, 3);
        let (labels, count) = components(&inside, |cell| neighbours(cell, N));
        assert_eq!((labels[0], labels[4], labels[26]), (1, 1, 2));
        assert_eq!(count, 2);
    }
}
