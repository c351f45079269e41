//! The grid as a Burn module: a table, and where things are in it.

use std::sync::Arc;

use burn::Tensor;
use burn::module::{Module, Param, ParamId};
use burn::tensor::Device;
use tensor_slices::matrix;

use crate::config::GridConfig;
use crate::encode::{encode, encode_with_jacobian};
use crate::layout::{FEATURES, GridLayout};
use crate::update::{OnHost, TableUpdate, update_in_place};

/// Half the width of the interval that entries start in (Müller et al. 2022, section 4).
const INITIAL: f32 = 1e-4;

/// A trainable multi-resolution hash grid over `[0, 1]³`.
#[derive(Module, Debug)]
pub struct HashGrid {
    /// All levels' entries, `[entries, 2]`.
    pub table: Param<Tensor<2>>,
    #[module(skip)]
    layout: Arc<GridLayout>,
}

impl HashGrid {
    /// Entries uniform in `(−1e-4, 1e-4)`; a seed gives the same bits on every device.
    ///
    /// # Panics
    /// When the configuration is not valid: see [`GridConfig::validate`].
    #[must_use]
    pub fn new(config: &GridConfig, seed: u64, device: &Device) -> Self {
        let layout = GridLayout::new(config);
        let entries = layout.entries();
        let values = (0..(FEATURES * entries) as u64)
            .map(|i| INITIAL * signed_unit(seed, i))
            .collect();
        Self {
            table: Param::from_tensor(matrix(values, [entries, FEATURES], device)),
            layout: Arc::new(layout),
        }
    }

    /// Where each level's entries are.
    #[must_use]
    pub fn layout(&self) -> &Arc<GridLayout> {
        &self.layout
    }

    /// See [`encode()`]: `points` `[n, 3]` to `[n, 2 L]`.
    #[must_use]
    pub fn forward(&self, points: Tensor<2>, active_levels: usize) -> Tensor<2> {
        encode(points, self.table.val(), &self.layout, active_levels)
    }

    /// See [`encode_with_jacobian`]: `points` `[n, 3]` to `([n, 2 L], [n, 2 L, 3])`.
    #[must_use]
    pub fn forward_with_jacobian(
        &self,
        points: Tensor<2>,
        active_levels: usize,
    ) -> (Tensor<2>, Tensor<3>) {
        encode_with_jacobian(points, self.table.val(), &self.layout, active_levels)
    }

    /// Changes the table's values `[entries, 2]`: on a CPU backend in place when nobody else holds
    /// the tensor; from other devices they travel to the host and back.
    pub fn update_table(&mut self, update: impl FnOnce(&mut [f32])) {
        let mut update = Some(update);
        self.update_table_by(&mut OnHost(|values: &mut [f32]| {
            if let Some(update) = update.take() {
                update(values);
            }
        }));
    }

    /// Has `update` change the table where it is.
    pub(crate) fn update_table_by(&mut self, update: &mut dyn TableUpdate) {
        // A parameter lends its tensor only as a clone, which would make the memory shared.
        let placeholder = Tensor::zeros([1, FEATURES], &self.table.val().device());
        let placeholder = Param::initialized(ParamId::new(), placeholder);
        let table = std::mem::replace(&mut self.table, placeholder);
        self.table = table.map(|table| update_in_place(table, update));
    }
}

/// A number in `(−1, 1)` for the `index`-th value of a seed's sequence: SplitMix64's mixing of a
/// counter (Steele et al. 2014), of which the upper bits are used.
fn signed_unit(seed: u64, index: u64) -> f32 {
    let mut z = seed
        .wrapping_mul(0xD134_2543_DE82_EF95)
        .wrapping_add(index.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    // The middles of 2^23 intervals: exact in an f32, and never -1 or 1.
    ((z >> 41) as f32 + 0.5) / (1 << 22) as f32 - 1.0
}
