//! Seeded lattice noise and a counter-based random number generator.
//!
//! Everything here is integer hashing plus `+ - * /`, so the same seed gives the same bits on
//! every platform. Noise values lie in `[-1, 1]`, coverages and uniform numbers in `[0, 1)`.

use glam::{DVec2, DVec3};

/// Mixes lattice coordinates and a seed into 32 well-spread bits.
pub(crate) fn hash3(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f)
        ^ seed.wrapping_mul(0x9e37_79b9);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// Maps 32 bits to `[0, 1)`.
pub(crate) fn unit(bits: u32) -> f64 {
    f64::from(bits) * (1.0 / 4_294_967_296.0)
}

/// Lattice cell below `x` and the smoothstep weight inside it. (A cast is much cheaper than
/// `f64::floor`, which baseline x86-64 calls as a function.)
fn cell(x: f64) -> (i32, f64) {
    let i = floor(x);
    let f = x - f64::from(i);
    (i, f * f * (3.0 - 2.0 * f))
}

/// The largest integer not above `x`.
pub(crate) fn floor(x: f64) -> i32 {
    let truncated = x as i32;
    truncated - i32::from(x < f64::from(truncated))
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Smooth value noise over the plane.
pub(crate) fn value2(p: DVec2, seed: u32) -> f64 {
    let ((x, u), (y, v)) = (cell(p.x), cell(p.y));
    let at = |i, j| unit(hash3(x + i, y + j, 0, seed));
    2.0 * lerp(lerp(at(0, 0), at(1, 0), u), lerp(at(0, 1), at(1, 1), u), v) - 1.0
}

/// Smooth value noise over space.
pub(crate) fn value3(p: DVec3, seed: u32) -> f64 {
    let ((x, u), (y, v), (z, w)) = (cell(p.x), cell(p.y), cell(p.z));
    let at = |i, j, k| unit(hash3(x + i, y + j, z + k, seed));
    let low = lerp(
        lerp(at(0, 0, 0), at(1, 0, 0), u),
        lerp(at(0, 1, 0), at(1, 1, 0), u),
        v,
    );
    let high = lerp(
        lerp(at(0, 0, 1), at(1, 0, 1), u),
        lerp(at(0, 1, 1), at(1, 1, 1), u),
        v,
    );
    2.0 * lerp(low, high, w) - 1.0
}

/// Fractal sum of [`value2`]: every octave doubles the frequency and keeps 0.6 of the height.
pub(crate) fn fbm2(p: DVec2, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut total, mut q) = (0.0, 1.0, 0.0, p);
    for octave in 0..octaves {
        sum += weight * value2(q, seed.wrapping_add(octave));
        total += weight;
        weight *= 0.6;
        // A turn between octaves hides the lattice.
        q = DVec2::new(1.6 * q.x - 1.2 * q.y, 1.2 * q.x + 1.6 * q.y) + DVec2::splat(17.3);
    }
    sum / total
}

/// Fractal sum of [`value3`].
pub(crate) fn fbm3(p: DVec3, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut total, mut q) = (0.0, 1.0, 0.0, p);
    for octave in 0..octaves {
        sum += weight * value3(q, seed.wrapping_add(octave));
        total += weight;
        weight *= 0.6;
        q = DVec3::new(1.6 * q.x - 1.2 * q.y, 1.2 * q.x + 1.6 * q.y, 2.0 * q.z) + 17.3;
    }
    sum / total
}

/// Coverage by spots: a unit cell holds one with probability `density`; its radius is at most
/// `radius` (below one half) and it stays inside its cell.
pub(crate) fn speckle3(p: DVec3, density: f64, radius: f64, seed: u32) -> f64 {
    let (x, y, z) = (floor(p.x), floor(p.y), floor(p.z));
    let h = hash3(x, y, z, seed);
    if unit(h) >= density {
        return 0.0;
    }
    let jitter = |n: u32| radius + (1.0 - 2.0 * radius) * unit(hash3(h as i32, n as i32, 7, seed));
    let spot = DVec3::new(
        f64::from(x) + jitter(1),
        f64::from(y) + jitter(2),
        f64::from(z) + jitter(3),
    );
    let size = radius * (0.45 + 0.55 * unit(hash3(h as i32, 4, 7, seed)));
    smoothstep(1.0, 0.6, (p - spot).length() / size)
}

/// Cubic step from 0 at `from` to 1 at `to`; `from > to` gives a falling step.
pub(crate) fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// SplitMix64: a small generator whose whole state is its seed.
#[derive(Clone, Debug)]
pub(crate) struct Rng(u64);

impl Rng {
    /// A stream of its own for each `(seed, stream)`.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        let mut rng = Self(seed ^ stream.wrapping_mul(0xd134_2543_de82_ef95));
        rng.bits();
        rng.bits();
        rng
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `[0, 1)`.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in `[from, to)`.
    pub(crate) fn range(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }

    /// Uniform among `0..n`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// Approximately normal with mean 0 and deviation 1: the sum of four uniform numbers, which
    /// needs no logarithm and never strays beyond 3.5.
    pub(crate) fn normal(&mut self) -> f64 {
        let bits = self.bits();
        let lane = |shift: u32| f64::from((bits >> shift) as u16) / 65_536.0;
        (lane(0) + lane(16) + lane(32) + lane(48) - 2.0) * 1.732_050_807_568_877_2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floor_agrees_with_std() {
        for x in [-2.0, -1.5, -0.1, 0.0, 0.9, 1.0, 7.25] {
            assert_eq!(f64::from(floor(x)), x.floor());
        }
    }

    #[test]
    fn normal_numbers_have_unit_variance() {
        let mut rng = Rng::new(3, 1);
        let draws: Vec<f64> = (0..20_000).map(|_| rng.normal()).collect();
        let mean = draws.iter().sum::<f64>() / 20_000.0;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(
            mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03,
            "{mean} {variance}"
        );
    }

    #[test]
    fn noise_stays_in_range_and_is_continuous() {
        let mut rng = Rng::new(1, 2);
        for _ in 0..2000 {
            let p = DVec3::new(
                rng.range(-9.0, 9.0),
                rng.range(-9.0, 9.0),
                rng.range(-9.0, 9.0),
            );
            let a = fbm3(p, 4, 5);
            assert!(a.abs() <= 1.0);
            assert!((a - fbm3(p + 1e-7, 4, 5)).abs() < 1e-4);
        }
    }
}
