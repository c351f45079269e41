//! What a step does to a block of the table.

use pulp::{Arch, Simd, WithSimd};

use super::LazyAdamConfig;
use super::moments::{STATE, Stored};
use crate::sparse_grad::BLOCK_VALUES;

/// `beta^steps`, rounded once.
pub(super) fn power(beta: f64, steps: u32) -> f32 {
    beta.powi(steps.min(1 << 24) as i32) as f32
}

/// A step's numbers: the moments' decay by steps since a visit, and the update's factors.
pub(super) struct Rule {
    step: u32,
    betas: [f64; 2],
    /// `beta^k` for small `k`.
    decay: [[f32; Self::POWERS]; 2],
    /// `1 − beta`.
    pub(super) gain: [f32; 2],
    /// `rate / (1 − beta1^step)`.
    pub(super) rate: f32,
    /// `1 / sqrt(1 − beta2^step)`.
    pub(super) root: f32,
    pub(super) epsilon: f32,
    /// Makes moments round another way in each step.
    salt: u32,
}

impl Rule {
    /// Blocks that are visited at all are mostly visited again within this many steps.
    const POWERS: usize = 64;

    pub(super) fn new(config: &LazyAdamConfig, step: u32, learning_rate: f64) -> Self {
        let betas = [config.beta1, config.beta2];
        let correction = betas.map(|beta| 1.0 - beta.powi(step.min(1 << 24) as i32));
        Self {
            step,
            betas,
            decay: betas.map(|beta| std::array::from_fn(|k| power(beta, k as u32))),
            gain: betas.map(|beta| (1.0 - beta) as f32),
            rate: (learning_rate / correction[0]) as f32,
            root: (1.0 / correction[1].sqrt()) as f32,
            epsilon: config.epsilon as f32,
            salt: step.wrapping_mul(0x9E37_79B9),
        }
    }

    /// The decay of both moments after `steps` steps.
    #[inline(always)]
    fn decay(&self, steps: u32) -> [f32; 2] {
        let steps_index = steps as usize;
        if steps_index < Self::POWERS {
            [self.decay[0][steps_index], self.decay[1][steps_index]]
        } else {
            self.betas.map(|beta| power(beta, steps))
        }
    }

    /// Updates the blocks that are marked; their gradients and marks are zero afterwards.
    pub(super) fn update<T: Stored>(
        &self,
        parts: Parts<'_, T>,
        gradient: &mut [f32],
        touched: &mut [u8],
    ) {
        Arch::new().dispatch(Task {
            rule: self,
            parts,
            gradient,
            touched,
        });
    }

    /// Updates one block.
    #[inline(always)]
    fn apply<T: Stored>(
        &self,
        table: &mut [f32; BLOCK_VALUES],
        gradient: &mut [f32; BLOCK_VALUES],
        moments: &mut [T; STATE],
        steps: u32,
    ) {
        let [decay1, decay2] = self.decay(steps);
        for i in 0..BLOCK_VALUES {
            let g = gradient[i];
            let m = moments[i].value() * decay1 + self.gain[0] * g;
            let v = moments[BLOCK_VALUES + i].value() * decay2 + self.gain[1] * (g * g);
            let change = self.rate * m / (v.sqrt() * self.root + self.epsilon);
            moments[i] = T::rounded(m, self.salt);
            moments[BLOCK_VALUES + i] = T::rounded(v, self.salt);
            table[i] -= if g == 0.0 { 0.0 } else { change };
        }
        gradient.fill(0.0);
    }
}

/// What a step changes, of neighbouring blocks.
pub(super) struct Parts<'a, T> {
    /// `[blocks, 16]`.
    pub(super) table: &'a mut [f32],
    /// `[blocks, 2, 16]`.
    pub(super) moments: &'a mut [T],
    /// `[blocks]`.
    pub(super) visited: &'a mut [u32],
}

/// [`Rule::update`], as pulp wants a function with generic body to be written.
struct Task<'a, T> {
    rule: &'a Rule,
    parts: Parts<'a, T>,
    gradient: &'a mut [f32],
    touched: &'a mut [u8],
}

impl<T: Stored> WithSimd for Task<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let table = self.parts.table.as_chunks_mut().0;
        let gradient = self.gradient.as_chunks_mut().0;
        let moments = self.parts.moments.as_chunks_mut().0;
        let blocks = table.iter_mut().zip(gradient).zip(moments);
        for (((table, gradient), moments), (visited, touched)) in
            blocks.zip(self.parts.visited.iter_mut().zip(self.touched))
        {
            if *touched != 0 {
                *touched = 0;
                self.rule
                    .apply(table, gradient, moments, self.rule.step - *visited);
                *visited = self.rule.step;
            }
        }
    }
}
