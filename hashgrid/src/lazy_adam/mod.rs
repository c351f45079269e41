//! Adam for a table of which a step touches a part.

mod by_levels;
#[cfg(feature = "cube")]
mod cube;
mod moments;
mod rule;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::grid::HashGrid;
use crate::layout::{BLOCK_ENTRIES, FEATURES, GridLayout};
use crate::sparse_grad::{BLOCK_VALUES, Buffer, SparseGrad};
use crate::update::TableUpdate;
use moments::{Moments, STATE, Stored};
use rule::{Parts, Rule, power};

pub use moments::MomentPrecision;

/// Blocks handled by one task at a time.
const TASK_BLOCKS: usize = 4096;

/// Adam's constants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LazyAdamConfig {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the second moment's root. Gradients of a table are tiny: this must be, too.
    pub epsilon: f64,
    /// How a CPU keeps both moments.
    #[serde(default)]
    pub moments: MomentPrecision,
}

impl Default for LazyAdamConfig {
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.99,
            epsilon: 1e-15,
            moments: MomentPrecision::Single,
        }
    }
}

/// Adam (Kingma and Ba 2015) that only visits what a [`SparseGrad`] has touched.
///
/// - A value whose gradient is zero is left alone (as Müller et al. 2022, appendix A, do).
/// - Moments are those of an Adam that was given the zeros: a block remembers the step of its last
///   visit, and the decay of the steps it was not visited in is made up for when it is.
/// - Bias is corrected by the number of steps, not by the number of visits.
///
/// ```
/// use hashgrid::{GridConfig, GridLayout, LazyAdam, SparseGrad};
///
/// let layout = GridLayout::new(&GridConfig { levels: 2, ..Default::default() });
/// let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
/// let mut table = vec![0.0; 2 * layout.entries()];
/// gradient.accumulate_levels(&layout, 1, |_, grad| grad[3] = 0.5);
/// adam.step(&mut table, &gradient, 0.01);
/// assert!((table[3] + 0.01).abs() < 1e-6); // A first step has the length of the rate.
/// assert_eq!(gradient.touched_blocks(), 0);
/// ```
#[derive(Clone, Debug)]
pub struct LazyAdam {
    config: LazyAdamConfig,
    steps: u32,
    blocks: usize,
    /// `[blocks, 2, 16]`; empty while they are on a device.
    moments: Moments,
    /// The step of each block's last visit; empty while they are on a device.
    visited: Vec<u32>,
    #[cfg(feature = "cube")]
    device: Option<cube::DeviceMoments>,
}

/// Why an optimiser's state can't be restored.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RestoreError {
    /// The state belongs to a table of another size.
    #[error("the optimiser's state has {found} values, but this table's has {expected}")]
    Length {
        /// Number of values given.
        found: usize,
        /// Number of values wanted.
        expected: usize,
    },
    /// The last part of the state does not hold step numbers up to the current one.
    #[error("the optimiser's state holds a step of {found}, but there were {steps}")]
    Step {
        /// What is there in place of a step number.
        found: String,
        /// The number of steps given.
        steps: u32,
    },
}

impl LazyAdam {
    /// The default constants, before the first step.
    #[must_use]
    pub fn new(layout: &GridLayout) -> Self {
        Self::with_config(layout, LazyAdamConfig::default())
    }

    /// Before the first step.
    #[must_use]
    pub fn with_config(layout: &GridLayout, config: LazyAdamConfig) -> Self {
        let blocks = layout.entries() / BLOCK_ENTRIES;
        Self {
            config,
            steps: 0,
            blocks,
            moments: Moments::zeros(config.moments, blocks * STATE),
            visited: vec![0; blocks],
            #[cfg(feature = "cube")]
            device: None,
        }
    }

    /// Number of steps done.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// One step down the gradient, which is at rest afterwards.
    ///
    /// `table` is `[entries, 2]`. A step counts even when nothing was touched. It waits for passes that are being added to the
    /// gradient, as [`SparseGrad`] says.
    ///
    /// # Panics
    /// When the table or the gradient is of another size than the optimiser's.
    pub fn step(&mut self, table: &mut [f32], gradient: &SparseGrad, learning_rate: f64) {
        self.check(table.len(), gradient);
        #[cfg(feature = "cube")]
        self.bring_home();
        self.steps += 1;
        let rule = Rule::new(&self.config, self.steps, learning_rate);
        let visited = &mut self.visited[..];
        match &mut self.moments {
            Moments::Single(moments) => descend(&rule, gradient, table, moments, visited),
            Moments::Half(moments) => descend(&rule, gradient, table, moments, visited),
        }
    }

    /// [`LazyAdam::step`] on a grid's own table, where it is, and in place when nobody else holds
    /// that tensor.
    ///
    /// # Panics
    /// As [`LazyAdam::step`].
    pub fn step_grid(&mut self, grid: &mut HashGrid, gradient: &SparseGrad, learning_rate: f64) {
        grid.update_table_by(&mut Step {
            adam: self,
            gradient,
            learning_rate,
        });
    }

    fn check(&self, table: usize, gradient: &SparseGrad) {
        let values = self.blocks * BLOCK_VALUES;
        assert_eq!(
            table, values,
            "LazyAdam::step: number of the table's values"
        );
        assert_eq!(
            gradient.entries() * FEATURES,
            values,
            "LazyAdam::step: number of the gradient's values"
        );
    }

    /// The host's state, wherever it is now.
    #[cfg(not(feature = "cube"))]
    fn host_state(&self) -> (Vec<f32>, &[u32]) {
        (self.moments.values(), &self.visited)
    }

    /// First and second moments as of now, each `[entries, 2]`, with all decay applied.
    #[must_use]
    pub fn moments(&self) -> [Vec<f32>; 2] {
        let LazyAdamConfig { beta1, beta2, .. } = self.config;
        let (moments, visited) = self.host_state();
        [(beta1, 0), (beta2, BLOCK_VALUES)].map(|(beta, first)| {
            let blocks = moments.chunks_exact(STATE).zip(visited.iter());
            blocks
                .flat_map(|(state, visited)| {
                    let decay = power(beta, self.steps - visited);
                    state[first..first + BLOCK_VALUES]
                        .iter()
                        .map(move |value| value * decay)
                })
                .collect()
        })
    }

    /// Everything to be saved besides [`LazyAdam::steps`]: all blocks' moments (16 first, 16 second ones), then the step of
    /// each block's last visit.
    ///
    /// On a CPU a continuation has the same bits. On a GPU, where entries remember their own last visit, a block's moments
    /// are as of the last one of any of its entries: the decay that this applies early rounds otherwise than later.
    #[must_use]
    pub fn state(&self) -> Vec<f32> {
        let (moments, visited) = self.host_state();
        // Whole numbers are exact in an f32 up to 2^24 steps.
        let steps = visited.iter().map(|step| *step as f32);
        moments.iter().copied().chain(steps).collect()
    }

    /// Goes back to what [`LazyAdam::state`] and [`LazyAdam::steps`] returned.
    ///
    /// # Errors
    /// When this is not the state of a table of this size after this many steps.
    pub fn restore(&mut self, state: &[f32], steps: u32) -> Result<(), RestoreError> {
        let expected = self.blocks * (STATE + 1);
        if state.len() != expected {
            return Err(RestoreError::Length {
                found: state.len(),
                expected,
            });
        }
        let (moments, visited) = state.split_at(self.blocks * STATE);
        let wrong = |step: &&f32| !(**step >= 0.0 && **step <= steps as f32 && step.fract() == 0.0);
        if let Some(step) = visited.iter().find(wrong) {
            return Err(RestoreError::Step {
                found: step.to_string(),
                steps,
            });
        }
        self.moments = Moments::of(self.config.moments, moments);
        self.visited = visited.iter().map(|step| *step as u32).collect();
        self.steps = steps;
        #[cfg(feature = "cube")]
        {
            self.device = None;
        }
        Ok(())
    }
}

/// A step on a table in the host's memory.
fn descend<T: Stored>(
    rule: &Rule,
    gradient: &SparseGrad,
    table: &mut [f32],
    moments: &mut [T],
    visited: &mut [u32],
) {
    let mut buffer = gradient.take_on_host();
    if let Some((waiting, levels)) = buffer.take_waiting() {
        let parts = Parts {
            table,
            moments,
            visited,
        };
        by_levels::step(rule, &waiting, levels, parts);
        return;
    }
    buffer.settle();
    let Buffer {
        values, touched, ..
    } = &mut *buffer;
    table
        .par_chunks_mut(TASK_BLOCKS * BLOCK_VALUES)
        .zip(values.par_chunks_mut(TASK_BLOCKS * BLOCK_VALUES))
        .zip(moments.par_chunks_mut(TASK_BLOCKS * STATE))
        .zip(visited.par_chunks_mut(TASK_BLOCKS))
        .zip(touched.par_chunks_mut(TASK_BLOCKS))
        .for_each(|((((table, gradient), moments), visited), touched)| {
            let parts = Parts {
                table,
                moments,
                visited,
            };
            rule.update(parts, gradient, touched);
        });
}

/// A step on a grid's table, wherever it is.
struct Step<'a> {
    adam: &'a mut LazyAdam,
    gradient: &'a SparseGrad,
    learning_rate: f64,
}

impl TableUpdate for Step<'_> {
    fn on_slice(&mut self, table: &mut [f32]) {
        self.adam.step(table, self.gradient, self.learning_rate);
    }

    #[cfg(feature = "cube")]
    fn on_device(&mut self, table: gpu_tensors::CubeTensor) -> gpu_tensors::CubeTensor {
        self.adam
            .check(table.meta.shape().num_elements(), self.gradient);
        let table = gpu_tensors::own(table);
        self.gradient.use_up_on_device(&table, |gradient| {
            self.adam
                .step_on_device(&table, gradient, self.learning_rate);
        });
        table
    }
}
