//! A step that makes a gradient and uses it up level by level.
//!
//! A level's gradient is written in no order and read once. Of a whole table it would travel to memory and
//! back in between; one level's stays in the cache, and the same memory serves the next.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::moments::{STATE, Stored};
use super::rule::{Parts, Rule};
use crate::layout::{BLOCK_ENTRIES, FEATURES, cut};
use crate::sparse_grad::Waiting;
use crate::step_clock::{SCATTER, UPDATE};

/// A level's gradient, and a flag for each block. Zero at rest.
#[derive(Default)]
struct LevelGradient {
    values: Vec<f32>,
    touched: Vec<u8>,
}

/// As many as were ever in use at once; of all tables, so that one stays warm.
static POOL: Mutex<Vec<LevelGradient>> = Mutex::new(Vec::new());

impl LevelGradient {
    /// One at rest, for at least so many entries.
    fn take(entries: usize) -> Self {
        let kept = POOL.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut gradient = kept.unwrap_or_default();
        if gradient.touched.len() < entries / BLOCK_ENTRIES {
            gradient.values.resize(entries * FEATURES, 0.0);
            gradient.touched.resize(entries / BLOCK_ENTRIES, 0);
        }
        gradient
    }

    /// Keeps it for the next level; it is at rest.
    fn keep(self) {
        let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
        pool.push(self);
    }
}

/// Adds what is `waiting` to each level's gradient, and updates the level; `levels` are the levels'
/// entries.
pub(super) fn step<T: Stored>(
    rule: &Rule,
    waiting: &[Waiting],
    levels: &[usize],
    parts: Parts<'_, T>,
) {
    let blocks = levels.iter().map(|entries| entries / BLOCK_ENTRIES);
    cut(parts.table, levels.iter().map(|entries| entries * FEATURES))
        .into_par_iter()
        .zip(cut(parts.moments, blocks.clone().map(|n| n * STATE)))
        .zip(cut(parts.visited, blocks))
        .with_max_len(1)
        .enumerate()
        .for_each(|(level, ((table, moments), visited))| {
            let parts = Parts {
                table,
                moments,
                visited,
            };
            let entries = levels[level];
            let mut gradient = LevelGradient::take(entries);
            let values = &mut gradient.values[..entries * FEATURES];
            let touched = &mut gradient.touched[..entries / BLOCK_ENTRIES];
            let lap = SCATTER.lap();
            let passes = waiting.iter().map(|pass| pass.add(level, values, touched));
            let any = passes.fold(false, |any, adds| any | adds);
            drop(lap);
            if any {
                let _lap = UPDATE.lap();
                rule.update(parts, values, touched);
            }
            gradient.keep();
        });
}
