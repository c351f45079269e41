//! The spatial hash: which entry a grid node has on a level that is too fine for one each.

use serde::{Deserialize, Serialize};

/// The spatial hash's factors along x, y and z.
///
/// The first is 1, so that neighbours along x mostly share a cache line (Müller et al. 2022, eq. 4).
pub(crate) const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// What is hashed: how a node `(x, y, z)` of a fine level finds its entry.
///
/// Either way the entry is the exclusive or of three numbers, one for each axis, modulo the level's size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hash {
    /// Each node by itself, as published: `x ⊕ 2654435761·y ⊕ 805459861·z` (Müller et al. 2022, eq. 4). A cell's corners
    /// lie on four cache lines or more.
    #[default]
    Nodes,
    /// Blocks of 2x2x2 nodes, by the same formula; the eight entries of a block follow each other, and are a cache line.
    /// A cell's corners lie on 27/8 lines on average. Nodes that collide do so with their block.
    Blocks,
}

impl Hash {
    /// Base-2 logarithm of the nodes along each side of what is hashed as one.
    pub(crate) const fn block_shift(self) -> u32 {
        match self {
            Self::Nodes => 0,
            Self::Blocks => 1,
        }
    }

    /// What a node's position along `axis` adds, by exclusive or, to its entry; the level's mask is yet to be applied.
    #[inline(always)]
    pub(crate) const fn part(self, node: u32, axis: usize) -> u32 {
        let shift = self.block_shift();
        let within = node & ((1 << shift) - 1);
        ((node >> shift).wrapping_mul(PRIMES[axis]) << (3 * shift))
            | (within << (shift * axis as u32))
    }
}
