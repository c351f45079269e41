//! What a grid is made of: the numbers a user chooses.

use serde::{Deserialize, Serialize};

use crate::hash::Hash;
use crate::layout::{LevelLayout, MOST_ENTRIES};

/// How a point's value is blended from the eight corners of its cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Interpolation {
    /// Trilinear: the weight along an axis is the fraction `t` itself. The gradient with respect
    /// to the position jumps at cell borders.
    #[default]
    Linear,
    /// The weight is `t² (3 − 2t)`: the position gradient is continuous, and zero at corners.
    Smoothstep,
}

/// What kernels on GPUs read of a table.
///
/// The table itself, which the optimiser changes, and all arithmetic are single precision either way, and so is
/// everything on the CPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TableReads {
    /// The table.
    #[default]
    Single,
    /// A copy of it in half precision (IEEE's binary16, rounded to nearest even), which each op makes once: twice as
    /// many entries in a cache. Values are within 2^-11 of themselves or 2^-25, and infinite from 65 520 on.
    Half,
}

/// The shape of a multi-resolution hash grid (Müller et al. 2022, table 1).
///
/// The default is the paper's: 16 levels of 2 features, 16 to 2048 cells per axis, `2^19` entries
/// per level at most, trilinear, nodes hashed one by one.
///
/// ```
/// let config = hashgrid::GridConfig { levels: 8, ..Default::default() };
/// assert!(config.validate().is_ok());
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridConfig {
    /// Number of levels `L`.
    pub levels: usize,
    /// Features per entry; the kernels are written for 2.
    pub features: usize,
    /// Cells per axis of the coarsest level.
    pub base_resolution: u32,
    /// Cells per axis of the finest level; those between grow geometrically. A single level is the coarsest one: then this
    /// is not read, though it must not be below [`base_resolution`](Self::base_resolution).
    pub finest_resolution: u32,
    /// Base-2 logarithm of the most entries a level may have, `T = 2^log2_table_size`.
    pub log2_table_size: u32,
    /// How corners are blended.
    pub interpolation: Interpolation,
    /// How nodes are hashed on levels that are too fine for an entry each.
    #[serde(default)]
    pub hash: Hash,
    /// What kernels on GPUs read.
    #[serde(default)]
    pub device_reads: TableReads,
}

impl Default for GridConfig {
    fn default() -> Self {
        Self {
            levels: 16,
            features: 2,
            base_resolution: 16,
            finest_resolution: 2048,
            log2_table_size: 19,
            interpolation: Interpolation::Linear,
            hash: Hash::Nodes,
            device_reads: TableReads::Single,
        }
    }
}

/// Why a [`GridConfig`] can't be built.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GridConfigError {
    /// A grid needs at least one level.
    #[error("a hash grid needs at least one level")]
    NoLevels,
    /// The kernels handle two features per entry.
    #[error("hash grid entries have 2 features, not {0}")]
    Features(usize),
    /// Resolutions must grow, start at one cell, and stay exact in single precision.
    #[error(
        "hash grid resolutions must satisfy 1 <= base <= finest <= 2^20, not {base} and {finest}"
    )]
    Resolution {
        /// The coarsest level's cells per axis.
        base: u32,
        /// The finest level's cells per axis.
        finest: u32,
    },
    /// Table indices are 32 bit, and a level has at least one block of entries.
    #[error("the log2 of a hash table's size must be within 6..=26, not {0}")]
    TableSize(u32),
    /// So many levels have more values in all than 32 bits count.
    #[error(
        "the {0} levels of a hash grid must have fewer than 2^31 entries in all: choose fewer levels or smaller ones"
    )]
    Entries(usize),
}

impl GridConfig {
    /// Checks that the numbers describe a grid the kernels can handle.
    ///
    /// # Errors
    /// The first rule that is broken.
    pub fn validate(&self) -> Result<(), GridConfigError> {
        let (base, finest) = (self.base_resolution, self.finest_resolution);
        if self.levels == 0 {
            return Err(GridConfigError::NoLevels);
        }
        if self.features != crate::FEATURES {
            return Err(GridConfigError::Features(self.features));
        }
        if base < 1 || finest < base || finest > 1 << 20 {
            return Err(GridConfigError::Resolution { base, finest });
        }
        if !(6..=26).contains(&self.log2_table_size) {
            return Err(GridConfigError::TableSize(self.log2_table_size));
        }
        // Level by level, which ends soon whatever their number: each has entries.
        let mut entries = 0;
        for level in 0..self.levels {
            entries += LevelLayout::new(self, level, 0).entries;
            if entries > MOST_ENTRIES {
                return Err(GridConfigError::Entries(self.levels));
            }
        }
        Ok(())
    }
}
