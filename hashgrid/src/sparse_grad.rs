//! A table's gradient that knows where it is not zero.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use crate::layout::{BLOCK_ENTRIES, FEATURES, GridLayout};

/// Values of a block: 8 entries of 2 features, one cache line.
pub(crate) const BLOCK_VALUES: usize = BLOCK_ENTRIES * FEATURES;

/// Where the backward passes of a step add up a table's gradient.
///
/// A batch of rays hits a fraction of a table's entries. This keeps one dense buffer for the whole
/// run, which is zero at rest, and a flag for each block of 8 entries that has been hit since.
/// Nothing of the table's size is allocated, zeroed or walked through in a step; whoever uses the
/// gradient up ([`LazyAdam`](crate::LazyAdam), [`SparseGrad::drain`]) zeroes what was hit.
///
/// Clones share the buffer: one goes into the op, one to the optimiser. A call holds a lock until
/// it returns, so a closure given to one must not call another on the same gradient.
#[derive(Clone)]
pub struct SparseGrad {
    shared: Arc<Mutex<Buffer>>,
    entries: usize,
}

/// The gradient `[entries, 2]` and a flag (0 or 1) for each block.
pub(crate) struct Buffer {
    pub(crate) values: Vec<f32>,
    pub(crate) touched: Vec<u8>,
    /// What kernels of a device have added, `[entries, 2]`.
    #[cfg(feature = "cube")]
    device: Option<gpu_tensors::CubeTensor>,
}

impl SparseGrad {
    /// A zero gradient for a table of this layout.
    #[must_use]
    pub fn new(layout: &GridLayout) -> Self {
        let entries = layout.entries();
        let buffer = Buffer {
            values: vec![0.0; entries * FEATURES],
            touched: vec![0; entries / BLOCK_ENTRIES],
            #[cfg(feature = "cube")]
            device: None,
        };
        Self {
            shared: Arc::new(Mutex::new(buffer)),
            entries,
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
    /// [`scatter_level_marked`](crate::cpu::scatter_level_marked) does.
    ///
    /// # Panics
    /// When the layout is not the one this was made for, or has fewer levels than `active`.
    pub fn accumulate_levels_marked(
        &self,
        layout: &GridLayout,
        active: usize,
        add: impl Fn(usize, &mut [f32], &mut [u8]) + Sync,
    ) {
        assert_eq!(
            layout.entries(),
            self.entries,
            "SparseGrad::accumulate_levels: entries of the layout"
        );
        let mut buffer = self.lock();
        let Buffer {
            values, touched, ..
        } = &mut *buffer;
        let (mut values, mut touched) = (values.as_mut_slice(), touched.as_mut_slice());
        let mut levels = Vec::with_capacity(active);
        for level in &layout.levels[..active] {
            let (grad, rest) = values.split_at_mut(level.entries * FEATURES);
            let (flags, rest_of_flags) = touched.split_at_mut(level.entries / BLOCK_ENTRIES);
            levels.push((grad, flags));
            (values, touched) = (rest, rest_of_flags);
        }
        levels
            .into_par_iter()
            .with_max_len(1)
            .enumerate()
            .for_each(|(level, (grad, flags))| add(level, grad, flags));
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
        self.lock().values.clone()
    }

    /// The host's memory, with everything in it that devices have added.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Buffer> {
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
        for _ in 0..2 {
            found.accumulate_levels(&layout, 2, |l, grad| {
                crate::cpu::scatter_level(&layout, l, &x, &x, &x, [&d, &d], None, grad);
            });
            marked.accumulate_levels_marked(&layout, 2, |l, grad, touched| {
                let d = [&d[..], &d[..]];
                crate::cpu::scatter_level_marked(&layout, l, &x, &x, &x, d, None, grad, touched);
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
        let clone = marked.clone();
        clone.drain(|_, _| {});
        assert_eq!(marked.touched_blocks(), 0);
        assert!(marked.to_dense().iter().all(|value| *value == 0.0));
    }
}
