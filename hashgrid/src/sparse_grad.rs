//! A table's gradient that knows where it is not zero.

mod buffer;
#[cfg(feature = "cube")]
mod cube;

use std::fmt;
use std::sync::Arc;

use crate::layout::{BLOCK_ENTRIES, FEATURES, GridLayout};
use buffer::Shared;
pub(crate) use buffer::{Buffer, Taken, Waiting};

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
/// Clones share all of it: one goes into the op, one to the optimiser.
///
/// Passes may add beside each other, from tasks of one rayon pool too. One that finds another at work adds to a dense buffer of
/// its own, which joins the other's once it is done: the last bits of sums then depend on who came when. Calls that show the
/// gradient or use it up wait until nobody is at work. From a closure given to one of these methods, or from a rayon task
/// beside those that add, they might wait for themselves: do not make them there.
#[derive(Clone)]
pub struct SparseGrad {
    shared: Arc<Shared>,
    entries: usize,
}

impl SparseGrad {
    /// A zero gradient for a table of this layout.
    #[must_use]
    pub fn new(layout: &GridLayout) -> Self {
        let levels = layout.levels.iter().map(|level| level.entries).collect();
        Self {
            shared: Arc::new(Shared::new(levels)),
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
        let mut buffer = self.shared.take();
        buffer.come_home();
        buffer.settle();
        buffer.add(active, add);
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
        let pass = Waiting {
            active,
            add: Box::new(add),
        };
        if self.shared.defer(pass) > MOST_WAITING {
            self.shared.take().settle();
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
        let buffer = self.take_settled();
        for (b, values) in buffer.values.chunks_exact(BLOCK_VALUES).enumerate() {
            if buffer.touched[b] != 0 {
                visit(b * BLOCK_ENTRIES, values);
            }
        }
    }

    /// [`SparseGrad::for_each_touched`], and zeroes what it visits: the gradient is then at rest.
    pub fn drain(&self, mut visit: impl FnMut(usize, &[f32])) {
        let mut buffer = self.take_settled();
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
        self.take_settled()
            .touched
            .iter()
            .map(|flag| usize::from(*flag))
            .sum()
    }

    /// A copy of the whole gradient, `[entries, 2]`.
    #[must_use]
    pub fn to_dense(&self) -> Vec<f32> {
        let mut buffer = self.take_settled();
        buffer.allocate();
        buffer.values.clone()
    }

    /// All of the gradient on the host, with everything added that there is.
    fn take_settled(&self) -> Taken<'_> {
        let mut buffer = self.take_on_host();
        buffer.settle();
        buffer
    }

    /// All of the gradient on the host, with everything added that devices have; the rest may wait.
    pub(crate) fn take_on_host(&self) -> Taken<'_> {
        let mut buffer = self.shared.take_all();
        buffer.come_home();
        buffer
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
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::{Barrier, mpsc};
    use std::time::Duration;

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

    /// Far longer than any of this takes.
    const LONG: Duration = Duration::from_secs(10);

    /// A worker that waits for a level of its pass, which another one has, takes up a second pass meanwhile.
    fn passes_beside_each_other(second: impl Fn(&SparseGrad, &GridLayout) + Send + Sync + 'static) {
        let layout = small();
        let gradient = SparseGrad::new(&layout);
        let (second, first) = (Arc::new(second), gradient.clone());
        let (tell, finished) = mpsc::channel();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2);
        let pool = pool.build().unwrap();
        pool.spawn(move || {
            let layout = small();
            let worker = rayon::current_thread_index();
            let both = Barrier::new(2);
            first.accumulate_levels(&layout, 2, |_, grad| {
                // Each worker has one of the levels.
                both.wait();
                grad[0] += 1.0;
                if rayon::current_thread_index() != worker {
                    let (second, gradient) = (second.clone(), first.clone());
                    let (tell, finished) = mpsc::channel();
                    rayon::spawn(move || {
                        second(&gradient, &small());
                        let _ = tell.send(());
                    });
                    // Until the first worker has done it: this one is busy. It ends even where that one never does.
                    let _ = finished.recv_timeout(LONG);
                }
            });
            let _ = tell.send(());
        });
        let ended = finished.recv_timeout(2 * LONG);
        assert!(ended.is_ok(), "a pass waits for itself");
        let dense = gradient.to_dense();
        assert_eq!(dense[0], 2.0);
        assert_eq!(dense[FEATURES * layout.levels[1].offset], 2.0);
        assert_eq!(dense.iter().sum::<f32>(), 4.0);
        assert_eq!(gradient.touched_blocks(), 2);
    }

    #[test]
    fn passes_that_are_added_may_run_beside_each_other() {
        passes_beside_each_other(|gradient, layout| {
            gradient.accumulate_levels(layout, 2, |_, grad| grad[0] += 1.0);
        });
    }

    #[test]
    fn passes_that_wait_may_be_settled_beside_another() {
        passes_beside_each_other(|gradient, layout| {
            for pass in 0..=MOST_WAITING {
                gradient.defer_levels(layout, 2, move |_, grad, touched| {
                    grad[0] += f32::from(u8::from(pass == 0));
                    touched[0] = 1;
                });
            }
        });
    }

    #[test]
    fn whoever_looks_waits_for_who_is_at_work() {
        let layout = small();
        let gradient = SparseGrad::new(&layout);
        let (begin, begun) = mpsc::channel();
        std::thread::scope(|threads| {
            threads.spawn(|| {
                gradient.accumulate_levels(&layout, 1, |_, grad| {
                    let _ = begin.send(());
                    std::thread::sleep(Duration::from_millis(50));
                    grad[0] = 1.0;
                });
            });
            begun.recv_timeout(LONG).unwrap();
            assert_eq!(gradient.touched_blocks(), 1);
        });
    }
}
