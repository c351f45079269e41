//! Where a layer's kernel reads its weights.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use burn_cubecl::cubecl::future::block_on;
use burn_cubecl::tensor::CubeTensor;

use super::Packed;
use crate::points::PointMatrix;
use crate::tensor::zeros;

/// Where threads read a layer's weights; results differ by roundings at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WeightReads {
    /// Where they are: each thread by itself, from what the caches hold.
    Cached,
    /// From memory that a workgroup shares, into which its threads bring them, and the points' values, tile by tile.
    Shared,
}

/// Inputs and outputs of the layer that is timed: a hidden one of the paper's networks.
const WIDTH: usize = 64;
/// Points that it is timed at.
const POINTS: usize = 16_384;
/// The best of so many launches counts.
const ATTEMPTS: usize = 5;

/// What has been measured, a device each.
static MEASURED: Mutex<Vec<(String, WeightReads)>> = Mutex::new(Vec::new());

impl WeightReads {
    /// What is faster where `like` is: measured when a device is first asked about, and remembered. Which
    /// it is depends on what a device's barriers and caches are like, which no list of limits says.
    #[must_use]
    pub fn faster(like: &CubeTensor) -> Self {
        let device = format!("{:?}", like.device);
        let mut measured = measured();
        if let Some((_, reads)) = measured.iter().find(|(name, _)| *name == device) {
            return *reads;
        }
        let [cached, shared] = [Self::Cached, Self::Shared].map(|reads| seconds(like, reads));
        let reads = if shared < cached {
            Self::Shared
        } else {
            Self::Cached
        };
        measured.push((device, reads));
        reads
    }

    /// How often this process has measured: once for each device that it has asked [`Self::faster`] about. For tests.
    #[must_use]
    pub fn measurements() -> usize {
        measured().len()
    }
}

/// A panic elsewhere leaves a list of what was measured until then.
fn measured() -> MutexGuard<'static, Vec<(String, WeightReads)>> {
    MEASURED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The seconds of a layer. Infinite where the device fails: whoever reads its results is told why.
fn seconds(like: &CubeTensor, reads: WeightReads) -> f64 {
    let weight = zeros(like, [WIDTH, WIDTH]);
    let bias = zeros(like, [WIDTH]);
    let x = PointMatrix::zeros(like, WIDTH + 1, POINTS);
    let mut best = f64::INFINITY;
    // The first one compiles.
    for attempt in 0..=ATTEMPTS {
        if block_on(like.client.sync()).is_err() {
            return f64::INFINITY;
        }
        let begun = Instant::now();
        // Made anew, as for each step, whose weights are others: what is made of them counts.
        let y = Packed::forward(&weight, &bias).reading(reads).apply(&x);
        let done = block_on(y.data.client.sync()).is_ok();
        if done && attempt > 0 {
            best = best.min(begun.elapsed().as_secs_f64());
        }
    }
    best
}
