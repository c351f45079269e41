//! Losses that are sums over pixels, gathered for one pass.

use burn::Tensor;
use burn::tensor::Device;
use losses::{RowLoss, RowTerm, mean_weights, row_losses};
use tensor_slices::matrix;

use super::ledger::Entry;
use super::total::Weighed;

/// Terms and what is known of each pixel.
#[derive(Debug)]
pub(super) struct PixelLosses {
    rays: usize,
    /// What is known, column by column.
    known: Vec<Vec<f32>>,
    terms: Vec<RowTerm>,
    /// Of each term in the sum.
    weights: Vec<f32>,
    entries: Vec<Entry>,
    /// The known column of equal weights, once there is one.
    mean: Option<usize>,
}

impl PixelLosses {
    pub(super) fn new(rays: usize) -> Self {
        Self {
            rays,
            known: Vec::new(),
            terms: Vec::new(),
            weights: Vec::new(),
            entries: Vec::new(),
            mean: None,
        }
    }

    /// Something known of each pixel; returns its column.
    ///
    /// # Panics
    /// When it is not of as many pixels.
    pub(super) fn know(&mut self, values: impl IntoIterator<Item = f32>) -> usize {
        let column: Vec<f32> = values.into_iter().collect();
        assert_eq!(column.len(), self.rays, "PixelLosses: pixels");
        self.known.push(column);
        self.known.len() - 1
    }

    /// Weights for a mean over pixels; returns their column.
    pub(super) fn know_weights(&mut self, weights: impl IntoIterator<Item = f32>) -> usize {
        self.know(mean_weights(weights.into_iter().collect()))
    }

    /// The weights of a plain mean.
    pub(super) fn mean(&mut self) -> usize {
        if let Some(column) = self.mean {
            return column;
        }
        let column = self.know_weights(vec![1.0; self.rays]);
        self.mean = Some(column);
        column
    }

    /// A loss, the known column of pixels' weights, and what it weighs in the sum: 0 where it is only written down.
    pub(super) fn add(&mut self, loss: RowLoss, pixels: usize, weight: f32, entry: Entry) {
        self.terms.push(RowTerm {
            loss,
            weight: pixels,
        });
        self.weights.push(weight);
        self.entries.push(entry);
    }

    /// All losses of the pixels' `rows`.
    pub(super) fn of(self, rows: Tensor<2>, device: &Device) -> Weighed {
        let width = self.known.len();
        let mut known = vec![0.0; width * self.rays];
        for (column, values) in self.known.iter().enumerate() {
            for (row, value) in known.chunks_exact_mut(width).zip(values) {
                row[column] = *value;
            }
        }
        let known = matrix(known, [self.rays, width], device);
        Weighed {
            losses: row_losses(rows, known, self.terms),
            weights: self.weights,
            entries: self.entries,
        }
    }
}
