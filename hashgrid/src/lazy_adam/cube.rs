//! The step on the GPU: one thread per entry.
//!
//! An entry remembers the step of its own last visit here, not of its block's: neighbouring threads
//! then read neighbouring gradients, and one that finds zeros is done. The moments are the same.

use gpu_tensors::{CubeTensor, buffer, cubecl, from_slice, read, units_for};

use super::moments::{Moments, STATE};
use super::rule::{Rule, power};
use super::{LazyAdam, LazyAdamConfig};
use crate::layout::{BLOCK_ENTRIES, FEATURES, MOST_ENTRIES};
use crate::sparse_grad::BLOCK_VALUES;
use cubecl::prelude::*;

/// Moments on the device.
#[derive(Debug)]
pub(crate) struct DeviceMoments {
    /// `[entries, 2]`.
    first: CubeTensor,
    /// `[entries, 2]`.
    second: CubeTensor,
    /// The step of each entry's last visit, `[entries]`: whole numbers, exact up to 2^24 steps.
    visited: CubeTensor,
}

impl Clone for DeviceMoments {
    /// A copy with memory of its own: steps change it in place.
    fn clone(&self) -> Self {
        Self {
            first: gpu_tensors::copy(&self.first),
            second: gpu_tensors::copy(&self.second),
            visited: gpu_tensors::copy(&self.visited),
        }
    }
}

impl DeviceMoments {
    /// The host's state (see [`LazyAdam`]) where `like` is.
    fn upload(like: &CubeTensor, moments: &[f32], visited: &[u32]) -> Self {
        let entries = visited.len() * BLOCK_ENTRIES;
        let half = |first: usize| -> Vec<f32> {
            moments
                .chunks_exact(STATE)
                .flat_map(|state| &state[first..first + BLOCK_VALUES])
                .copied()
                .collect()
        };
        let of_entries: Vec<f32> = visited
            .iter()
            .flat_map(|step| [*step as f32; BLOCK_ENTRIES])
            .collect();
        Self {
            first: from_slice(like, &half(0), [entries, FEATURES]),
            second: from_slice(like, &half(BLOCK_VALUES), [entries, FEATURES]),
            visited: from_slice(like, &of_entries, [entries]),
        }
    }

    /// The host's state: a block's moments as of the last visit of any of its entries.
    fn download(&self, config: &LazyAdamConfig) -> (Vec<f32>, Vec<u32>) {
        let (first, second) = (read(&self.first), read(&self.second));
        let visited = read(&self.visited);
        let blocks = visited.len() / BLOCK_ENTRIES;
        let mut moments = vec![0.0; blocks * STATE];
        let mut last = vec![0; blocks];
        for (b, state) in moments.chunks_exact_mut(STATE).enumerate() {
            let entries = &visited[b * BLOCK_ENTRIES..(b + 1) * BLOCK_ENTRIES];
            last[b] = entries.iter().fold(0, |most, step| most.max(*step as u32));
            for i in 0..BLOCK_VALUES {
                let behind = last[b] - entries[i / FEATURES] as u32;
                let at = b * BLOCK_VALUES + i;
                state[i] = first[at] * power(config.beta1, behind);
                state[BLOCK_VALUES + i] = second[at] * power(config.beta2, behind);
            }
        }
        (moments, last)
    }
}

impl LazyAdam {
    /// [`LazyAdam::step`] on the device that `table` is on, in place; `gradient` is `[entries, 2]`,
    /// and zero afterwards.
    ///
    /// # Panics
    /// When 32-bit indices do not reach all of the table's values.
    pub(crate) fn step_on_device(
        &mut self,
        table: &CubeTensor,
        gradient: &CubeTensor,
        learning_rate: f64,
    ) {
        let entries = self.blocks * BLOCK_ENTRIES;
        assert!(
            entries <= MOST_ENTRIES,
            "LazyAdam: a kernel indexes a table of up to {MOST_ENTRIES} entries, not {entries}"
        );
        self.steps += 1;
        let moments = match self.device.take() {
            Some(moments) => moments,
            None => {
                let moments = DeviceMoments::upload(table, &self.moments.values(), &self.visited);
                // The device's are the ones that count from now on.
                self.moments = Moments::zeros(self.config.moments, 0);
                self.visited = Vec::new();
                moments
            }
        };
        let rule = Rule::new(&self.config, self.steps, learning_rate);
        let client = &table.client;
        let (count, dim) = units_for(client, entries);
        // SAFETY: threads beyond the entries return at once; `step_grid` has checked the sizes.
        unsafe {
            step_kernel::launch_unchecked(
                client,
                count,
                dim,
                buffer(table),
                buffer(gradient),
                buffer(&moments.first),
                buffer(&moments.second),
                buffer(&moments.visited),
                entries as u32,
                self.steps as f32,
                self.config.beta1.ln() as f32,
                self.config.beta2.ln() as f32,
                rule.gain[0],
                rule.gain[1],
                rule.rate,
                rule.root,
                rule.epsilon,
            );
        }
        self.device = Some(moments);
    }

    /// The host's state, wherever it is now.
    pub(super) fn host_state(&self) -> (Vec<f32>, Vec<u32>) {
        match &self.device {
            Some(moments) => moments.download(&self.config),
            None => (self.moments.values(), self.visited.clone()),
        }
    }

    /// Makes the host's state the one that counts.
    pub(super) fn bring_home(&mut self) {
        if let Some(moments) = self.device.take() {
            let (moments, visited) = moments.download(&self.config);
            self.moments = Moments::of(self.config.moments, &moments);
            self.visited = visited;
        }
    }
}

/// One thread per entry: both of its values, if either has a gradient.
#[cube(launch_unchecked)]
fn step_kernel(
    table: &mut [f32],
    gradient: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    visited: &mut [f32],
    entries: u32,
    step: f32,
    log_beta1: f32,
    log_beta2: f32,
    gain1: f32,
    gain2: f32,
    rate: f32,
    root: f32,
    epsilon: f32,
) {
    let entry = ABSOLUTE_POS;
    if entry < entries as usize {
        let at = 2 * entry;
        let (g0, g1) = (gradient[at], gradient[at + 1]);
        if g0 != 0.0f32 || g1 != 0.0f32 {
            let idle = step - visited[entry];
            let decay1 = (idle * log_beta1).exp();
            let decay2 = (idle * log_beta2).exp();
            #[unroll]
            for f in 0..2usize {
                let g = gradient[at + f];
                let m = first[at + f] * decay1 + gain1 * g;
                let v = second[at + f] * decay2 + gain2 * (g * g);
                let change = rate * m / (v.sqrt() * root + epsilon);
                first[at + f] = m;
                second[at + f] = v;
                table[at + f] -= select(g == 0.0f32, 0.0f32, change);
                gradient[at + f] = 0.0f32;
            }
            visited[entry] = step;
        }
    }
}
