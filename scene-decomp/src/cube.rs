//! What the fields' GPU kernels share.

use gpu_tensors::{CubeTensor, add, zeros};

/// `(first, count)` of consecutive parts of `n` points, none larger than `size`.
pub(crate) fn chunks(n: usize, size: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n)
        .step_by(size)
        .map(move |first| (first, size.min(n - first)))
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
