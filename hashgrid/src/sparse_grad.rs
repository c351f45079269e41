//! A table's gradient that knows where it is not zero.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use crate::layout::{BLOCK_ENTRIES, FEATURES, GridLayout};

/// Values of a block: 8 entries of 2 features, one cache line.
pub(crate) const BLOCK_VALUES: usize = BLOCK_ENTRIES * FEATURES;

/// Passes that may wait for the step; with more, they are added up.
const MOST_WAITING: usize = 16;

/// Where the backward passes of a step add up a table's gradient.
///
/// A batch of rays hits a fraction of a table's entries. Nothing of the table's size is allocated,
/// zeroed or walked through in a step:
///
/// - A pass that [`SparseGrad::defer_levels`] is told of waits for the step. Then [`LazyAdam`](crate::LazyAdam)
///   takes one level after the other: all passes add to a level's gradient in a buffer
///   that stays in the cache, and the level is updated.
/// - Whatever is added before that, and all that waits as soon as somebody wants to see it, goes to
///   one dense buffer, made when first needed, which is zero at rest, with a flag for each block of 8
///   entries that has been hit since. Whoever uses it up ([`LazyAdam`](crate::LazyAdam),
///   [`SparseGrad::drain`]) zeroes what was hit.
///
/// Clones share all of it: one goes into the op, one to the optimiser. A call holds a lock until
/// it returns, so a closure given to one must not call another on the same gradient.
#[derive(Clone)]
pub struct SparseGrad {
    shared: Arc<Mutex<Buffer>>,
    entries: usize,
}

/// The gradient of one step so far.
pub(crate) struct Buffer {
    /// Entries of each level.
    levels: Vec<usize>,
    /// What has been added, `[entries, 2]`; empty before anything was.
    pub(crate) values: Vec<f32>,
    /// A flag (0 or 1) for each block; empty before anything was added.
    pub(crate) touched: Vec<u8>,
    /// What is yet to be added, in order.
    waiting: Vec<Waiting>,
    /// What kernels of a device have added, `[entries, 2]`.
    #[cfg(feature = "cube")]
    device: Option<gpu_tensors::CubeTensor>,
}

/// A backward pass whose share of the gradient waits.
pub(crate) struct Waiting {
    /// Levels that it adds to.
    active: usize,
    add: Box<Addition>,
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

    /// Makes the dense buffer if there is none.
    fn allocate(&mut self) {
        if self.values.is_empty() {
            let entries: usize = self.levels.iter().sum();
            self.values = vec![0.0; entries * FEATURES];
            self.touched = vec![0; entries / BLOCK_ENTRIES];
        }
    }

    /// Has `add` add to the first `active` levels, in parallel.
    fn add(&mut self, active: usize, add: impl Fn(usize, &mut [f32], &mut [u8]) + Sync) {
        self.allocate();
        let (mut values, mut touched) = (&mut self.values[..], &mut self.touched[..]);
        let mut levels = Vec::with_capacity(active);
        for entries in &self.levels[..active] {
            let (grad, rest) = values.split_at_mut(entries * FEATURES);
            let (flags, rest_of_flags) = touched.split_at_mut(entries / BLOCK_ENTRIES);
            levels.push((grad, flags));
            (values, touched) = (rest, rest_of_flags);
        }
        levels
            .into_par_iter()
            .with_max_len(1)
            .enumerate()
            .for_each(|(level, (grad, flags))| add(level, grad, flags));
    }
}

impl SparseGrad {
    /// A zero gradient for a table of this layout.
    #[must_use]
    pub fn new(layout: &GridLayout) -> Self {
        let buffer = Buffer {
            levels: layout.levels.iter().map(|level| level.entries).collect(),
            values: Vec::new(),
            touched: Vec::new(),
            waiting: Vec::new(),
            #[cfg(feature = "cube")]
            device: None,
        };
        Self {
            shared: Arc::new(Mutex::new(buffer)),
            entries: layout.entries(),
        }
    }

    /// Number of entries of the table.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Adds to the first `active` levels, one parallel task for each: `add(level, grad)` receives
    /// the level's gradient `[entries, 2]`.
    ///
    /// What was touched is found afterwards by looking for values that are not zero;
    /// [`SparseGrad::accumulate_levels_marked`] saves that pass, which takes longer than a scatter.
    ///
    /// # Panics
    /// When the layout is not the one this was made for, or has fewer levels than `active`.
    pub fn accumulate_levels(
        &self,
        layout: &GridLayout,
        active: usize,
        add: impl Fn(usize, &mut [f32]) + Sync,
    ) {
        self.accumulate_levels_marked(layout, active, |level, grad, touched| {
            add(level, grad);
            for (block, touched) in grad.chunks_exact(BLOCK_VALUES).zip(touched) {
                *touched |= u8::from(block.iter().any(|value| *value != 0.0));
            }
        });
    }

    /// Adds to the first `active` levels, one parallel task for each: `add(level, grad, touched)`
    /// receives the level's gradient `[entries, 2]` and its flags, one for each
    /// [`BLOCK_ENTRIES`] entries, and sets to 1 those of the blocks it changes.
    /// [`scatter_level`](crate::cpu::scatter_level) does.
    ///
    /// # Panics
    /// When the layout is not the one this was made for, or has fewer levels than `active`.
    pub fn accumulate_levels_marked(
        &self,
        layout: &GridLayout,
        active: usize,
        add: impl Fn(usize, &mut [f32], &mut [u8]) + Sync,
    ) {
        self.check(layout);
        self.lock().add(active, add);
    }

    /// [`SparseGrad::accumulate_levels_marked`] when the gradient is next used: by
    /// [`LazyAdam`](crate::LazyAdam), which has each level's gradient in its cache then, or by anyone who
    /// wants to see it. Passes are added in the order of these calls.
    ///
    /// # Panics
    /// When the layout is not the one this was made for; `add` is not called for more levels than there
    /// are.
    pub fn defer_levels(
        &self,
        layout: &GridLayout,
        active: usize,
        add: impl Fn(usize, &mut [f32], &mut [u8]) + Send + Sync + 'static,
    ) {
        self.check(layout);
        let mut buffer = self.lock_as_is();
        buffer.waiting.push(Waiting {
            active,
            add: Box::new(add),
        });
        if buffer.waiting.len() > MOST_WAITING {
            buffer.settle();
        }
    }

    fn check(&self, layout: &GridLayout) {
        assert_eq!(
            layout.entries(),
            self.entries,
            "SparseGrad: entries of the layout"
        );
    }

    /// Calls `visit(first entry, values)` for each touched block, in order; `values` are those of
    /// [`BLOCK_ENTRIES`] entries.
    pub fn for_each_touched(&self, mut visit: impl FnMut(usize, &[f32])) {
        let buffer = self.lock();
        for (b, values) in buffer.values.chunks_exact(BLOCK_VALUES).enumerate() {
            if buffer.touched[b] != 0 {
                visit(b * BLOCK_ENTRIES, values);
            }
        }
    }

    /// [`SparseGrad::for_each_touched`], and zeroes what it visits: the gradient is then at rest.
    pub fn drain(&self, mut visit: impl FnMut(usize, &[f32])) {
        let mut buffer = self.lock();
        let Buffer {
            values, touched, ..
        } = &mut *buffer;
        let blocks = values
            .chunks_exact_mut(BLOCK_VALUES)
            .zip(touched)
            .enumerate();
        for (b, (values, touched)) in blocks {
            if *touched != 0 {
                visit(b * BLOCK_ENTRIES, values);
                values.fill(0.0);
                *touched = 0;
            }
        }
    }

    /// Number of blocks touched since the gradient was last at rest.
    #[must_use]
    pub fn touched_blocks(&self) -> usize {
        self.lock()
            .touched
            .iter()
            .map(|flag| usize::from(*flag))
            .sum()
    }

    /// A copy of the whole gradient, `[entries, 2]`.
    #[must_use]
    pub fn to_dense(&self) -> Vec<f32> {
        let mut buffer = self.lock();
        buffer.allocate();
        buffer.values.clone()
    }

    /// The host's memory, with everything added that there is.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Buffer> {
        let mut buffer = self.lock_on_host();
        buffer.settle();
        buffer
    }

    /// The host's memory, with everything added that devices have; the rest may wait.
    pub(crate) fn lock_on_host(&self) -> MutexGuard<'_, Buffer> {
        #[allow(unused_mut)]
        let mut buffer = self.lock_as_is();
        #[cfg(feature = "cube")]
        buffer.bring_home();
        buffer
    }

    fn lock_as_is(&self) -> MutexGuard<'_, Buffer> {
        // A panic while the lock was held leaves numbers behind that are wrong, but valid.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// On a device the gradient is dense: kernels add to it with atomics, and
/// [`LazyAdam`](crate::LazyAdam) zeroes what it uses up.
#[cfg(feature = "cube")]
impl SparseGrad {
    /// Hands the gradient `[entries, 2]` on the device of `like` to `add`, which may change it.
    ///
    /// What lies on the host or on another device goes there first.
    pub fn accumulate_on_device<R>(
        &self,
        like: &gpu_tensors::CubeTensor,
        add: impl FnOnce(&gpu_tensors::CubeTensor) -> R,
    ) -> R {
        let mut buffer = self.lock_as_is();
        buffer.settle();
        let shape = [self.entries, FEATURES];
        if buffer
            .device
            .as_ref()
            .is_some_and(|d| d.device != like.device)
        {
            buffer.bring_home();
        }
        let gradient = match buffer.device.take() {
            Some(gradient) => gradient,
            None if buffer.touched.contains(&1) => {
                let gradient = gpu_tensors::from_slice(like, &buffer.values, shape);
                buffer.values.fill(0.0);
                buffer.touched.fill(0);
                gradient
            }
            None => gpu_tensors::zeros(like, shape),
        };
        let out = add(&gradient);
        buffer.device = Some(gradient);
        out
    }
}

#[cfg(feature = "cube")]
impl Buffer {
    /// Adds what a device holds to the host's values.
    fn bring_home(&mut self) {
        let Some(device) = self.device.take() else {
            return;
        };
        let added = gpu_tensors::read(&device);
        self.allocate();
        let blocks = self.values.chunks_exact_mut(BLOCK_VALUES);
        let blocks = blocks.zip(added.chunks_exact(BLOCK_VALUES));
        for ((values, added), touched) in blocks.zip(&mut self.touched) {
            if added.iter().any(|value| *value != 0.0) {
                *touched = 1;
                for (value, added) in values.iter_mut().zip(added) {
                    *value += added;
                }
            }
        }
    }
}

impl fmt::Debug for SparseGrad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SparseGrad")
            .field("entries", &self.entries)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::GridConfig;

    fn small() -> GridLayout {
        GridLayout::new(&GridConfig {
            levels: 3,
            log2_table_size: 10,
            ..Default::default()
        })
    }

    #[test]
    fn both_ways_of_marking_agree_and_draining_restores_rest() {
        let layout = small();
        let (found, marked) = (SparseGrad::new(&layout), SparseGrad::new(&layout));
        let x = [0.1, 0.5, 0.9];
        let d = [1.0, -2.0, 3.0];
        let scatter =
            move |layout: &GridLayout, l: usize, grad: &mut [f32], touched: Option<&mut [u8]>| {
                let rows = crate::cpu::ScatterRows {
                    position: [&x; 3],
                    d_value: [&d; 2],
                    normal_part: None,
                    prefetch_offset: 0,
                };
                crate::cpu::scatter_level(layout, l, &rows, grad, touched);
            };
        for _ in 0..2 {
            found.accumulate_levels(&layout, 2, |l, grad| scatter(&layout, l, grad, None));
            marked.accumulate_levels_marked(&layout, 2, |l, grad, touched| {
                scatter(&layout, l, grad, Some(touched));
            });
        }
        assert_eq!(found.to_dense(), marked.to_dense());
        assert!(marked.touched_blocks() >= found.touched_blocks());
        let (mut sum, mut visited) = (0.0, 0);
        found.for_each_touched(|entry, values| {
            assert_eq!(entry % BLOCK_ENTRIES, 0);
            assert!(entry < layout.levels[2].offset);
            visited += 1;
            sum += values.iter().sum::<f32>();
        });
        assert_eq!(visited, found.touched_blocks());
        // Weights of a cell's corners add up to 1: 2 passes, 2 levels, 2 features, sum of d = 2.
        assert!((sum - 16.0).abs() < 1e-4);
        let waits = SparseGrad::new(&layout);
        for _ in 0..2 {
            let inner = layout.clone();
            waits.defer_levels(&layout, 2, move |l, grad, touched| {
                scatter(&inner, l, grad, Some(touched));
            });
        }
        assert_eq!(waits.to_dense(), marked.to_dense());
        assert_eq!(waits.touched_blocks(), marked.touched_blocks());
        let clone = marked.clone();
        clone.drain(|_, _| {});
        assert_eq!(marked.touched_blocks(), 0);
        assert!(marked.to_dense().iter().all(|value| *value == 0.0));
    }
}
