//! What this machine can do at best, measured now: arithmetic and memory.

use std::hint::black_box;
use std::time::Instant;

use pulp::{Arch, Simd, WithSimd};
use serde::Serialize;

/// Fused multiply-adds in flight at once: enough for two units of four cycles latency.
const CHAINS: usize = 16;
/// Rounds of one measurement; some milliseconds.
const ROUNDS: usize = 200_000;
/// Values of each array of the memory measurement: 64 MiB, more than a core's own caches.
const VALUES: usize = 16 << 20;
/// Values of a cache line.
const LINE: usize = 16;
/// Values of a level's gradient: 2^19 entries of two features.
const LEVEL_VALUES: usize = 2 << 19;
/// Lines of one measurement.
const LINES: usize = 1 << 21;
/// The best of so many measurements counts: what disturbs a measurement makes it slower.
const ATTEMPTS: usize = 5;

/// Peaks of one core and of all that are in use.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Peaks {
    /// Single precision, a fused multiply-add counting two, in 10^9 operations a second.
    pub(crate) gflops_one_core: f64,
    /// The same on all cores at once.
    pub(crate) gflops: f64,
    /// Copying, bytes read and written, in 10^9 a second.
    pub(crate) copy_gbs_one_core: f64,
    /// The same on all cores at once.
    pub(crate) copy_gbs: f64,
    /// `a = b + s c`, bytes read and written, in 10^9 a second.
    pub(crate) triad_gbs_one_core: f64,
    /// The same on all cores at once.
    pub(crate) triad_gbs: f64,
    /// Cache lines read in no order, independent of each other, as corners of a hashed level are; in
    /// 10^9 bytes a second.
    pub(crate) lines_gbs_one_core: f64,
    /// The same on all cores at once.
    pub(crate) lines_gbs: f64,
    /// Cache lines of a buffer as large as a hashed level's gradient, added to in no order; in 10^9 bytes a
    /// second, a line counting once. Such a buffer stays in the caches.
    pub(crate) added_lines_gbs_one_core: f64,
    /// The same on all cores at once, each with a buffer of its own.
    pub(crate) added_lines_gbs: f64,
}

impl Peaks {
    /// Measures one core, then `threads` at once.
    pub(crate) fn measure(threads: usize) -> Self {
        let memory = Memory::new();
        let [copy_gbs_one_core, triad_gbs_one_core] = memory.best(1);
        let [copy_gbs, triad_gbs] = memory.best(threads);
        Self {
            gflops_one_core: gflops(1),
            gflops: gflops(threads),
            copy_gbs_one_core,
            copy_gbs,
            triad_gbs_one_core,
            triad_gbs,
            lines_gbs_one_core: memory.lines(1),
            lines_gbs: memory.lines(threads),
            added_lines_gbs_one_core: added_lines(1),
            added_lines_gbs: added_lines(threads),
        }
    }

    /// Arithmetic and memory (the better of copy and triad) of one core or of all.
    pub(crate) fn of(&self, one_core: bool) -> (f64, f64) {
        if one_core {
            let memory = self.copy_gbs_one_core.max(self.triad_gbs_one_core);
            (self.gflops_one_core, memory)
        } else {
            (self.gflops, self.copy_gbs.max(self.triad_gbs))
        }
    }
}

/// Chains of multiply-adds that stay in registers.
struct MultiplyAdd;

impl WithSimd for MultiplyAdd {
    type Output = f64;

    /// Returns the number of operations.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let factor = simd.splat_f32s(black_box(0.999_999));
        let summand = simd.splat_f32s(black_box(1e-6));
        let mut chains = [simd.splat_f32s(1.0); CHAINS];
        for _ in 0..ROUNDS {
            for chain in &mut chains {
                *chain = simd.mul_add_f32s(*chain, factor, summand);
            }
        }
        for chain in chains {
            black_box(simd.reduce_sum_f32s(chain));
        }
        (2 * CHAINS * ROUNDS * S::F32_LANES) as f64
    }
}

fn gflops(threads: usize) -> f64 {
    best_of(|| {
        let begun = Instant::now();
        let operations: f64 = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads)
                .map(|_| scope.spawn(|| Arch::new().dispatch(MultiplyAdd)))
                .collect();
            workers.into_iter().filter_map(|w| w.join().ok()).sum()
        });
        operations / begun.elapsed().as_secs_f64() * 1e-9
    })
}

struct Memory {
    from: Vec<f32>,
    other: Vec<f32>,
}

impl Memory {
    fn new() -> Self {
        Self {
            from: vec![1.0; VALUES],
            other: vec![2.0; VALUES],
        }
    }

    /// GB/s of copy and triad on so many cores.
    fn best(&self, threads: usize) -> [f64; 2] {
        let mut to = vec![0.0f32; VALUES];
        let part = VALUES.div_ceil(threads);
        let mut run = |arrays: usize, work: fn(&mut [f32], &[f32], &[f32])| {
            best_of(|| {
                let begun = Instant::now();
                std::thread::scope(|scope| {
                    let parts = to
                        .chunks_mut(part)
                        .zip(self.from.chunks(part))
                        .zip(self.other.chunks(part));
                    for ((to, from), other) in parts {
                        scope.spawn(move || work(to, from, other));
                    }
                });
                let bytes = arrays * VALUES * size_of::<f32>();
                bytes as f64 / begun.elapsed().as_secs_f64() * 1e-9
            })
        };
        let copy = run(2, |to, from, _| to.copy_from_slice(from));
        let triad = run(3, |to, from, other| {
            for ((to, from), other) in to.iter_mut().zip(from).zip(other) {
                *to = from + 0.5 * other;
            }
        });
        black_box(&to);
        [copy, triad]
    }

    /// GB/s of cache lines at random on so many cores.
    fn lines(&self, threads: usize) -> f64 {
        best_of(|| {
            let begun = Instant::now();
            std::thread::scope(|scope| {
                for seed in 0..threads as u32 {
                    scope.spawn(move || black_box(sum_of_lines(&self.from, seed)));
                }
            });
            let bytes = threads * LINES * LINE * size_of::<f32>();
            bytes as f64 / begun.elapsed().as_secs_f64() * 1e-9
        })
    }
}

/// GB/s of cache lines of a level's gradient added to at random on so many cores.
fn added_lines(threads: usize) -> f64 {
    let mut buffers = vec![vec![0.0; LEVEL_VALUES]; threads];
    best_of(|| {
        let begun = Instant::now();
        std::thread::scope(|scope| {
            for (seed, buffer) in buffers.iter_mut().enumerate() {
                scope.spawn(move || add_to_lines(black_box(buffer), seed as u32));
            }
        });
        let bytes = threads * LINES * LINE * size_of::<f32>();
        bytes as f64 / begun.elapsed().as_secs_f64() * 1e-9
    })
}

/// Lines taken at once; the next ones are asked for while these are used, as the field ops do.
const GROUP: usize = 32;

/// Which lines come next.
struct RandomLines {
    count: u64,
    lines: u64,
}

impl RandomLines {
    fn of(values: &[f32], seed: u32) -> Self {
        Self {
            count: u64::from(seed) << 32,
            lines: (values.len() / LINE) as u64,
        }
    }

    /// The first values of the next lines.
    #[inline(always)]
    fn group(&mut self) -> [usize; GROUP] {
        let mut group = [0; GROUP];
        for at in &mut group {
            // A hash of a counter: one does not wait for the one before.
            self.count += 1;
            let mixed = self.count.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            *at = LINE * (((mixed >> 32) * self.lines) >> 32) as usize;
        }
        group
    }
}

/// Sums one value of so many lines of `values`.
fn sum_of_lines(values: &[f32], seed: u32) -> f32 {
    let mut random = RandomLines::of(values, seed);
    let mut sum = 0.0;
    let mut group = random.group();
    for _ in 0..LINES / GROUP {
        let following = random.group();
        for (at, following) in group.into_iter().zip(following) {
            prefetch(&values[following]);
            sum += values[at];
        }
        group = following;
    }
    sum
}

/// Adds to one value of so many lines of `values`.
fn add_to_lines(values: &mut [f32], seed: u32) {
    let mut random = RandomLines::of(values, seed);
    let mut group = random.group();
    for _ in 0..LINES / GROUP {
        let following = random.group();
        for (at, following) in group.into_iter().zip(following) {
            prefetch(&values[following]);
            values[at] += 1.0;
        }
        group = following;
    }
}

fn prefetch(value: &f32) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch is a hint; it faults for no address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

fn best_of(mut measure: impl FnMut() -> f64) -> f64 {
    (0..ATTEMPTS).map(|_| measure()).fold(0.0, f64::max)
}
