//! What a gradient consists of, and how calls that run beside each other share it.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::BLOCK_VALUES;
use crate::layout::{BLOCK_ENTRIES, FEATURES, cut};

/// The gradient of one step so far, or a share of it.
pub(crate) struct Buffer {
    /// Entries of each level.
    levels: Arc<[usize]>,
    /// What has been added, `[entries, 2]`; empty before anything was.
    pub(crate) values: Vec<f32>,
    /// A flag (0 or 1) for each block; empty before anything was added.
    pub(crate) touched: Vec<u8>,
    /// What is yet to be added, in order.
    pub(super) waiting: Vec<Waiting>,
    /// What kernels of a device have added, `[entries, 2]`.
    #[cfg(feature = "cube")]
    pub(super) device: Option<gpu_tensors::CubeTensor>,
}

/// A backward pass whose share of the gradient waits.
pub(crate) struct Waiting {
    /// Levels that it adds to.
    pub(super) active: usize,
    pub(super) add: Box<Addition>,
}

/// Adds to a level's gradient, and marks its blocks.
type Addition = dyn Fn(usize, &mut [f32], &mut [u8]) + Send + Sync;

impl Waiting {
    /// Adds to `level`'s gradient `[entries, 2]`, and marks its blocks; whether there was anything to do.
    pub(crate) fn add(&self, level: usize, grad: &mut [f32], touched: &mut [u8]) -> bool {
        let adds = level < self.active;
        if adds {
            (self.add)(level, grad, touched);
        }
        adds
    }
}

impl Buffer {
    fn new(levels: Arc<[usize]>) -> Self {
        Self {
            levels,
            values: Vec::new(),
            touched: Vec::new(),
            waiting: Vec::new(),
            #[cfg(feature = "cube")]
            device: None,
        }
    }

    /// Takes what waits, with the number of entries of each level, if that is all there is.
    pub(crate) fn take_waiting(&mut self) -> Option<(Vec<Waiting>, &[usize])> {
        if self.waiting.is_empty() || self.touched.contains(&1) {
            return None;
        }
        Some((std::mem::take(&mut self.waiting), &self.levels))
    }

    /// Adds what waits.
    pub(crate) fn settle(&mut self) {
        let waiting = std::mem::take(&mut self.waiting);
        if !waiting.is_empty() {
            self.add(self.levels.len(), |level, grad, touched| {
                for pass in &waiting {
                    pass.add(level, grad, touched);
                }
            });
        }
    }

    /// Nothing is on a device in a build without any.
    #[cfg(not(feature = "cube"))]
    pub(super) fn come_home(&mut self) {}

    /// Makes the dense buffer if there is none.
    pub(super) fn allocate(&mut self) {
        if self.values.is_empty() {
            let entries: usize = self.levels.iter().sum();
            self.values = vec![0.0; entries * FEATURES];
            self.touched = vec![0; entries / BLOCK_ENTRIES];
        }
    }

    /// Has `add` add to the first `active` levels, in parallel.
    pub(super) fn add(&mut self, active: usize, add: impl Fn(usize, &mut [f32], &mut [u8]) + Sync) {
        self.allocate();
        let levels = self.levels[..active].iter();
        let values = cut(&mut self.values, levels.clone().map(|n| n * FEATURES));
        let touched = cut(&mut self.touched, levels.map(|n| n / BLOCK_ENTRIES));
        values
            .into_par_iter()
            .zip(touched)
            .with_max_len(1)
            .enumerate()
            .for_each(|(level, (grad, flags))| add(level, grad, flags));
    }

    /// Adds `added`, `[entries, 2]`, where its blocks are touched.
    fn add_touched(&mut self, added: &[f32], is_touched: &[u8]) {
        let blocks = self.values.chunks_exact_mut(BLOCK_VALUES);
        let blocks = blocks.zip(&mut self.touched);
        let added = added.chunks_exact(BLOCK_VALUES).zip(is_touched);
        for ((values, touched), (added, is_touched)) in blocks.zip(added) {
            if *is_touched != 0 {
                *touched = 1;
                for (value, added) in values.iter_mut().zip(added) {
                    *value += added;
                }
            }
        }
    }

    /// Takes back what was here before all that is.
    fn merge(&mut self, back: Self) {
        let newer = std::mem::replace(&mut self.waiting, back.waiting);
        self.waiting.extend(newer);
        if self.values.is_empty() {
            (self.values, self.touched) = (back.values, back.touched);
        } else {
            self.add_touched(&back.values, &back.touched);
        }
        #[cfg(feature = "cube")]
        if let Some(device) = back.device {
            self.merge_device(device);
        }
    }
}

/// The gradient that clones have in common.
///
/// The lock is held for moments alone. Whoever works on the gradient takes it out and brings it back: while rayon's workers
/// wait for levels they take up other tasks, and one of those may add to the same gradient.
pub(super) struct Shared {
    state: Mutex<State>,
    /// Signalled when nobody has anything any more.
    all_back: Condvar,
}

struct State {
    /// What nobody has.
    here: Buffer,
    /// Those who have something.
    at_work: usize,
}

/// What was taken out, which goes back when this is dropped.
pub(crate) struct Taken<'a> {
    from: &'a Shared,
    buffer: Buffer,
}

impl Shared {
    pub(super) fn new(levels: Arc<[usize]>) -> Self {
        Self {
            state: Mutex::new(State {
                here: Buffer::new(levels),
                at_work: 0,
            }),
            all_back: Condvar::new(),
        }
    }

    /// What is here, to be added to: nothing, where somebody else has it.
    pub(super) fn take(&self) -> Taken<'_> {
        self.take_from(self.lock())
    }

    /// All that there is, once nobody else is at work.
    pub(super) fn take_all(&self) -> Taken<'_> {
        let wait = self
            .all_back
            .wait_while(self.lock(), |state| state.at_work > 0);
        self.take_from(wait.unwrap_or_else(PoisonError::into_inner))
    }

    fn take_from(&self, mut state: MutexGuard<'_, State>) -> Taken<'_> {
        let nothing = Buffer::new(state.here.levels.clone());
        state.at_work += 1;
        Taken {
            from: self,
            buffer: std::mem::replace(&mut state.here, nothing),
        }
    }

    /// Has a pass wait; returns how many do.
    pub(super) fn defer(&self, pass: Waiting) -> usize {
        let mut state = self.lock();
        state.here.waiting.push(pass);
        state.here.waiting.len()
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic while somebody was at work leaves numbers behind that are wrong, but valid.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Deref for Taken<'_> {
    type Target = Buffer;

    fn deref(&self) -> &Buffer {
        &self.buffer
    }
}

impl DerefMut for Taken<'_> {
    fn deref_mut(&mut self) -> &mut Buffer {
        &mut self.buffer
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        let nothing = Buffer::new(self.buffer.levels.clone());
        let buffer = std::mem::replace(&mut self.buffer, nothing);
        let mut state = self.from.lock();
        state.at_work -= 1;
        if state.at_work == 0 {
            self.from.all_back.notify_all();
        }
        state.here.merge(buffer);
    }
}
