//! Large working memory that kernels use over and over.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::Mutex;

/// Buffers that were handed back, smallest first.
static POOL: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());

/// The most buffers kept: more than the tasks of a training step hold at once.
const MAX_POOLED: usize = 256;

/// `f32` working memory from a pool; it returns there when dropped.
///
/// A fresh large allocation costs a page fault every 4 KiB, which in a training step takes as long
/// as the arithmetic on it. Steps of about the same size find their last buffers again here.
pub struct Scratch {
    buffer: Vec<f32>,
    len: usize,
}

impl Scratch {
    /// `len` values of arbitrary content.
    #[must_use]
    pub fn new(len: usize) -> Self {
        let mut pool = lock();
        let fitting = pool.iter().position(|b| b.len() >= len);
        let mut buffer = match fitting {
            // A buffer many times too large would starve whoever needs it next.
            Some(i) if pool[i].len() <= 4 * len.max(1024) => pool.remove(i),
            _ => Vec::new(),
        };
        drop(pool);
        if buffer.len() < len {
            // A quarter more, since steps vary: the next one shall fit as well.
            buffer = vec![0.0; len + len / 4];
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

fn lock() -> std::sync::MutexGuard<'static, Vec<Vec<f32>>> {
    // A panic elsewhere cannot leave the list half changed: every change is one call.
    POOL.lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl Deref for Scratch {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.buffer[..self.len]
    }
}

impl DerefMut for Scratch {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.buffer[..self.len]
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
