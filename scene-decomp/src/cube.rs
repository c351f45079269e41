//! What the fields' GPU kernels share.

use gpu_tensors::{CubeTensor, add, zeros};

/// `(first, count)` of consecutive parts of `n` points, none larger than `size`.
pub(crate) fn chunks(n: usize, size: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n)
        .step_by(size)
        .map(move |first| (first, size.min(n - first)))
}

/// Panics unless 32-bit indices, which kernels have, reach all numbers of `n` rows, points of three or others of so many
/// `columns`.
pub(crate) fn expect_reachable(op: &str, n: usize, columns: usize) {
    let numbers = n as u128 * columns.max(3) as u128;
    assert!(
        numbers <= u128::from(u32::MAX),
        "{op}: {n} points are {numbers} numbers, more than 32-bit indices reach; ask in smaller batches"
    );
}

/// A sum of tensors, zeros when there is nothing to add.
pub(crate) struct Sum<const D: usize> {
    like: CubeTensor,
    shape: [usize; D],
    value: Option<CubeTensor>,
}

impl<const D: usize> Sum<D> {
    /// The empty sum.
    pub(crate) fn new(like: &CubeTensor, shape: [usize; D]) -> Self {
        Self {
            like: like.clone(),
            shape,
            value: None,
        }
    }

    /// Adds a term.
    pub(crate) fn add(&mut self, term: CubeTensor) {
        self.value = Some(match self.value.take() {
            Some(value) => add(value, term),
            None => term,
        });
    }

    /// The sum.
    pub(crate) fn value(self) -> CubeTensor {
        let Self { like, shape, value } = self;
        value.unwrap_or_else(|| zeros(&like, shape))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_beyond_32_bit_indices_are_refused() {
        let refused = |n: usize, columns: usize| {
            std::panic::catch_unwind(|| expect_reachable("op", n, columns)).is_err()
        };
        assert!(!refused((1 << 28) - 1, 16));
        assert!(refused(1 << 28, 16));
        // Points are three numbers each, whatever is asked of them.
        assert!(!refused((1 << 32) / 3, 1));
        assert!(refused((1 << 32) / 3 + 1, 1));
    }
}
