//! Large working memory that kernels use over and over.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::Mutex;

/// A cache line, as which buffers are allocated: a vector load that straddles two takes two.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([f32; LINE]);

/// Values of a cache line.
const LINE: usize = 16;

/// Buffers that were handed back, smallest first.
static POOL: Mutex<Vec<Vec<Line>>> = Mutex::new(Vec::new());

/// The most buffers kept: more than the tasks of a training step hold at once.
const MAX_POOLED: usize = 256;

/// `f32` working memory from a pool; it returns there when dropped.
///
/// A fresh large allocation costs a page fault every 4 KiB, which in a training step takes as long
/// as the arithmetic on it. Steps of about the same size find their last buffers again here.
///
/// The first value lies at the beginning of a cache line.
pub struct Scratch {
    buffer: Vec<Line>,
    len: usize,
}

impl Scratch {
    /// `len` values of arbitrary content.
    #[must_use]
    pub fn new(len: usize) -> Self {
        let lines = len.div_ceil(LINE);
        let mut pool = lock();
        let fitting = pool.iter().position(|b| b.len() >= lines);
        let mut buffer = match fitting {
            // A buffer many times too large would starve whoever needs it next.
            Some(i) if pool[i].len() <= 4 * lines.max(1024 / LINE) => pool.remove(i),
            _ => Vec::<Line>::new(),
        };
        drop(pool);
        if buffer.len() < lines {
            // A quarter more, since steps vary: the next one shall fit as well.
            buffer = vec![Line([0.0; LINE]); lines + lines / 4];
        }
        Self { buffer, len }
    }

    /// `len` zeros.
    #[must_use]
    pub fn zeros(len: usize) -> Self {
        let mut scratch = Self::new(len);
        scratch.fill(0.0);
        scratch
    }
}

fn lock() -> std::sync::MutexGuard<'static, Vec<Vec<Line>>> {
    // A panic elsewhere cannot leave the list half changed: every change is one call.
    POOL.lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl Deref for Scratch {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        let lines = &self.buffer[..self.len.div_ceil(LINE)];
        // SAFETY: a line is 16 values without padding, and the lines hold at least `len` of them.
        unsafe { std::slice::from_raw_parts(lines.as_ptr().cast(), self.len) }
    }
}

impl DerefMut for Scratch {
    fn deref_mut(&mut self) -> &mut [f32] {
        let lines = &mut self.buffer[..self.len.div_ceil(LINE)];
        // SAFETY: as above; the borrow of `self` makes this the only reference.
        unsafe { std::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), self.len) }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let buffer = std::mem::take(&mut self.buffer);
        if buffer.is_empty() {
            return;
        }
        let mut pool = lock();
        let at = pool.partition_point(|b| b.len() < buffer.len());
        pool.insert(at, buffer);
        if pool.len() > MAX_POOLED {
            pool.remove(0);
        }
    }
}

impl fmt::Debug for Scratch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scratch").field("len", &self.len).finish()
    }
}
