//! How long a kernel has taken, over all its calls.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Adds up the time between [`Stopwatch::lap`] and the end of what it returned.
///
/// Two reads of the clock a call, nothing next to a kernel: it is always on. Calls that overlap, from
/// several threads, count each.
///
/// ```
/// use tensor_slices::Stopwatch;
///
/// static KERNEL: Stopwatch = Stopwatch::new();
/// {
///     let _lap = KERNEL.lap();
///     std::thread::sleep(std::time::Duration::from_millis(2));
/// }
/// assert!(KERNEL.total().as_millis() >= 2);
/// ```
#[derive(Debug)]
pub struct Stopwatch {
    nanoseconds: AtomicU64,
}

/// A stretch of time that ends when this is dropped.
#[derive(Debug)]
pub struct Lap<'a> {
    of: &'a Stopwatch,
    begun: Instant,
}

impl Stopwatch {
    /// At zero.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            nanoseconds: AtomicU64::new(0),
        }
    }

    /// Counts until the result is dropped.
    #[must_use = "time counts until the lap is dropped"]
    pub fn lap(&self) -> Lap<'_> {
        Lap {
            of: self,
            begun: Instant::now(),
        }
    }

    /// The time counted so far; differences of two answers belong to what happened in between.
    #[must_use]
    pub fn total(&self) -> Duration {
        Duration::from_nanos(self.nanoseconds.load(Ordering::Relaxed))
    }
}

impl Default for Stopwatch {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for Lap<'_> {
    fn drop(&mut self) {
        let nanoseconds = u64::try_from(self.begun.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.of
            .nanoseconds
            .fetch_add(nanoseconds, Ordering::Relaxed);
    }
}
