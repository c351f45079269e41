//! Where each level's entries lie in the table.

use crate::config::{GridConfig, GridConfigError, Interpolation, TableReads};
use crate::hash::Hash;

/// Features per table entry. Both of an entry's features are loaded as one 8-byte word.
pub const FEATURES: usize = 2;

/// Entries are handled in blocks of this many: 8 entries of 2 features are one 64-byte cache line.
/// Each level starts at a block and fills whole blocks.
pub const BLOCK_ENTRIES: usize = 8;

/// The most entries of a table: kernels on GPUs reach its values by 32-bit indices.
pub(crate) const MOST_ENTRIES: usize = u32::MAX as usize / FEATURES;

/// One level of a [`GridLayout`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LevelLayout {
    /// Cells per axis, `floor(base · b^level)`; there are `resolution + 1` grid nodes per axis.
    pub resolution: u32,
    /// Index of the level's first entry in the table.
    pub offset: usize,
    /// Number of entries; for a dense level rounded up to whole blocks, the rest is never used.
    pub entries: usize,
    /// How nodes are hashed into the entries; none where each has its own.
    pub hash: Option<Hash>,
}

/// All levels of a grid in one table `[entries, 2]`, row-major.
///
/// A level whose `(r+1)³` nodes fit into `T` entries is dense, with node `(x, y, z)` at
/// `x + (r+1)·(y + (r+1)·z)`. Others are hashed in 32-bit arithmetic, as [`enum@Hash`] says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GridLayout {
    /// The levels, coarsest first.
    pub levels: Vec<LevelLayout>,
    /// How corners are blended, the same on all levels.
    pub interpolation: Interpolation,
    /// What kernels on GPUs read.
    pub device_reads: TableReads,
}

impl GridLayout {
    /// Lays out the levels of `config`.
    ///
    /// # Panics
    /// When the configuration is not valid; [`GridLayout::try_new`] returns the error instead.
    pub fn new(config: &GridConfig) -> Self {
        match Self::try_new(config) {
            Ok(layout) => layout,
            Err(error) => panic!("GridLayout::new: {error}"),
        }
    }

    /// Lays out the levels of `config`.
    ///
    /// # Errors
    /// See [`GridConfig::validate`].
    pub fn try_new(config: &GridConfig) -> Result<Self, GridConfigError> {
        config.validate()?;
        let mut offset = 0;
        let levels = (0..config.levels)
            .map(|level| {
                let layout = LevelLayout::new(config, level, offset);
                offset += layout.entries;
                layout
            })
            .collect();
        Ok(Self {
            levels,
            interpolation: config.interpolation,
            device_reads: config.device_reads,
        })
    }

    /// Number of entries of the whole table.
    pub fn entries(&self) -> usize {
        self.levels
            .last()
            .map_or(0, |level| level.offset + level.entries)
    }

    /// A table's numbers, `per_entry` of each entry, cut into those of each level, coarsest first.
    ///
    /// # Panics
    /// When there are fewer numbers than that.
    pub fn split_levels_mut<'a, T>(
        &self,
        numbers: &'a mut [T],
        per_entry: usize,
    ) -> Vec<&'a mut [T]> {
        cut(
            numbers,
            self.levels.iter().map(|level| per_entry * level.entries),
        )
    }

    /// Number of features of an encoded point, `2 L`.
    pub fn features(&self) -> usize {
        FEATURES * self.levels.len()
    }

    /// Panics unless kernels on GPUs, which have the whole table and check nothing, stay inside it: each level is valid and
    /// begins where the one before it ends, and 32-bit indices reach the last value.
    #[cfg(any(feature = "cube", test))]
    pub(crate) fn check_for_kernels(&self) {
        let mut end = 0;
        for level in &self.levels {
            crate::cpu::check_level(level, FEATURES * level.entries);
            assert_eq!(
                level.offset, end,
                "hashgrid: not where the level before it ends: {level:?}"
            );
            end += level.entries;
        }
        // The table has as many entries as its layout says.
        assert_eq!(end, self.entries(), "hashgrid: entries of all levels");
        assert!(
            end <= MOST_ENTRIES,
            "hashgrid: kernels index a table of up to {MOST_ENTRIES} entries, not {end}"
        );
    }
}

/// `numbers` cut into parts of these lengths; what is behind them is in none.
///
/// # Panics
/// When there are fewer numbers than that.
pub(crate) fn cut<T>(numbers: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let mut rest = numbers;
    let part = |length| {
        let (part, behind) = std::mem::take(&mut rest).split_at_mut(length);
        rest = behind;
        part
    };
    lengths.map(part).collect()
}

impl LevelLayout {
    /// Lays out a level of a `config` of which all but the table's size is checked.
    pub(crate) fn new(config: &GridConfig, level: usize, offset: usize) -> Self {
        let table_size = 1_usize << config.log2_table_size;
        let resolution = resolution(config, level);
        let nodes = (u64::from(resolution) + 1).pow(3);
        let hash = (nodes > table_size as u64).then_some(config.hash);
        let entries = if hash.is_some() {
            table_size
        } else {
            (nodes as usize).next_multiple_of(BLOCK_ENTRIES)
        };
        Self {
            resolution,
            offset,
            entries,
            hash,
        }
    }
}

/// `floor(base · b^level)` with `b^(L−1) = finest / base`.
fn resolution(config: &GridConfig, level: usize) -> u32 {
    let (base, finest) = (
        f64::from(config.base_resolution),
        f64::from(config.finest_resolution),
    );
    if level == 0 {
        return config.base_resolution;
    }
    let exponent = level as f64 / (config.levels - 1) as f64;
    // The small summand keeps levels that are whole numbers (the finest one) from falling below.
    (base * (finest / base).powf(exponent) + 1e-6).floor() as u32
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_grid() {
        let layout = GridLayout::new(&GridConfig::default());
        assert_eq!(layout.levels.len(), 16);
        assert_eq!(layout.levels[0].resolution, 16);
        assert_eq!(layout.levels[1].resolution, 22);
        assert_eq!(layout.levels[15].resolution, 2048);
        let hashed: Vec<bool> = layout
            .levels
            .iter()
            .map(|level| level.hash.is_some())
            .collect();
        assert_eq!(hashed.iter().position(|h| *h), Some(5));
        assert_eq!(layout.features(), 32);
        let mut next = 0;
        for level in &layout.levels {
            assert_eq!(level.offset, next);
            assert_eq!(level.entries % BLOCK_ENTRIES, 0);
            next += level.entries;
        }
        assert_eq!(layout.entries(), next);
    }

    #[test]
    fn levels_are_cut_where_they_begin() {
        let layout = GridLayout::new(&GridConfig {
            levels: 3,
            finest_resolution: 40,
            log2_table_size: 14,
            ..GridConfig::default()
        });
        let mut numbers: Vec<usize> = (0..FEATURES * layout.entries()).collect();
        let parts = layout.split_levels_mut(&mut numbers, FEATURES);
        assert_eq!(parts.len(), 3);
        for (part, level) in parts.iter().zip(&layout.levels) {
            assert_eq!(part.len(), FEATURES * level.entries);
            assert_eq!(part[0], FEATURES * level.offset);
        }
    }

    #[test]
    fn a_single_level_is_the_coarsest() {
        let layout = GridLayout::new(&GridConfig {
            levels: 1,
            ..GridConfig::default()
        });
        assert_eq!(layout.levels.len(), 1);
        assert_eq!(layout.levels[0].resolution, 16);
    }

    #[test]
    fn bad_configurations_are_named() {
        let bad = |change: fn(&mut GridConfig)| {
            let mut config = GridConfig::default();
            change(&mut config);
            GridLayout::try_new(&config).unwrap_err()
        };
        assert_eq!(bad(|c| c.levels = 0), GridConfigError::NoLevels);
        assert_eq!(bad(|c| c.features = 4), GridConfigError::Features(4));
        assert_eq!(
            bad(|c| c.log2_table_size = 40),
            GridConfigError::TableSize(40)
        );
        assert_eq!(
            bad(|c| c.finest_resolution = 8),
            GridConfigError::Resolution {
                base: 16,
                finest: 8
            }
        );
        // Each of 2^26 entries.
        let large = |levels| GridConfig {
            levels,
            base_resolution: 1024,
            log2_table_size: 26,
            ..GridConfig::default()
        };
        assert_eq!(large(31).validate(), Ok(()));
        for levels in [32, usize::MAX] {
            let error = large(levels).validate().unwrap_err();
            assert_eq!(error, GridConfigError::Entries(levels));
        }
    }

    fn is_refused(change: impl FnOnce(&mut GridLayout)) -> bool {
        let mut layout = GridLayout::new(&GridConfig {
            levels: 3,
            log2_table_size: 10,
            ..GridConfig::default()
        });
        change(&mut layout);
        std::panic::catch_unwind(|| layout.check_for_kernels()).is_err()
    }

    #[test]
    fn kernels_are_given_levels_that_lie_in_their_table_alone() {
        assert!(!is_refused(|_| {}));
        assert!(!is_refused(|layout| layout.levels.truncate(2)));
        assert!(!is_refused(|layout| layout.levels.clear()));
        // The table would end with what was the first level.
        assert!(is_refused(|layout| layout.levels.reverse()));
        assert!(is_refused(|layout| layout.levels[1].offset += 8));
        assert!(is_refused(|layout| layout.levels[2].offset += 1 << 32));
        assert!(is_refused(|layout| layout.levels[1].entries -= 1));
        assert!(is_refused(|layout| {
            let level = LevelLayout {
                entries: 1 << 30,
                offset: 0,
                ..layout.levels[2].clone()
            };
            let at = |offset| LevelLayout {
                offset,
                ..level.clone()
            };
            layout.levels = vec![at(0), at(1 << 30)];
        }));
    }
}
