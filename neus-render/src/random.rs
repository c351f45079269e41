//! Numbers that look random and depend on nothing but a seed and a counter, so that batches come
//! out alike for any number of threads.

/// SplitMix64's finaliser (Steele, Lea and Flood 2014) over a seed and a counter.
#[inline]
pub fn hash(seed: u64, counter: u64) -> u64 {
    let mut z = seed
        .wrapping_add(0x9E37_79B9_7F4A_7C15)
        .wrapping_add(counter.wrapping_mul(0xD1B5_4A32_D192_ED03));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A number in [0, 1), the same for the same seed and counter.
///
/// ```
/// use neus_render::random::unit_float;
///
/// assert_eq!(unit_float(7, 1), unit_float(7, 1));
/// assert_ne!(unit_float(7, 1), unit_float(7, 2));
/// assert!((0..1000).all(|i| (0.0..1.0).contains(&unit_float(7, i))));
/// ```
#[inline]
pub fn unit_float(seed: u64, counter: u64) -> f32 {
    (hash(seed, counter) >> 40) as f32 * (1.0 / 16_777_216.0)
}
