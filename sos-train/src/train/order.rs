//! Samples that were made round by round, brought into the order of their rays.

/// Where each of `wanted`, some of `all` in their order, stands there.
pub(super) fn numbers(all: &[u32], wanted: &[u32]) -> Vec<u32> {
    let mut number = 0;
    wanted
        .iter()
        .map(|wanted| {
            while all[number] != *wanted {
                number += 1;
            }
            number as u32
        })
        .collect()
}

/// The order that brings samples, given by their rays in `of`, ray by ray: those of a ray stay in theirs.
pub(super) fn by_ray(of: &[u32], rays: usize) -> Vec<u32> {
    let mut next = vec![0; rays + 1];
    for ray in of {
        next[*ray as usize + 1] += 1;
    }
    for ray in 0..rays {
        next[ray + 1] += next[ray];
    }
    let mut order = vec![0; of.len()];
    for (i, ray) in of.iter().enumerate() {
        let place: &mut u32 = &mut next[*ray as usize];
        order[*place as usize] = i as u32;
        *place += 1;
    }
    order
}

/// The values with the numbers `chosen`.
pub(super) fn select<T: Copy>(values: &[T], chosen: &[u32]) -> Vec<T> {
    chosen.iter().map(|&i| values[i as usize]).collect()
}
