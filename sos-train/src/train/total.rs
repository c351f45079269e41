//! The sum of a step's losses.

use burn::Tensor;
use burn::tensor::{Device, TensorData};

use super::ledger::{Entry, Ledger};

/// Losses, what each weighs in the sum, and where it is written down.
#[derive(Debug)]
pub(super) struct Weighed {
    /// `[losses]`.
    pub(super) losses: Tensor<1>,
    /// 0 where a loss is only written down.
    pub(super) weights: Vec<f32>,
    pub(super) entries: Vec<Entry>,
}

impl Weighed {
    /// One loss, `[1]`.
    pub(super) fn one(loss: Tensor<1>, weight: f32, entry: Entry) -> Self {
        Self {
            losses: loss,
            weights: vec![weight],
            entries: vec![entry],
        }
    }
}

/// All of them so far.
#[derive(Debug, Default)]
pub(super) struct Total {
    losses: Vec<Tensor<1>>,
    weights: Vec<f32>,
    ledger: Ledger,
}

impl Total {
    pub(super) fn add(&mut self, these: Weighed) {
        self.ledger.note_all(&these.losses, these.entries);
        self.losses.push(these.losses);
        self.weights.extend(these.weights);
    }

    /// The sum, `[1]`, which is written down too. There must be a loss.
    pub(super) fn sum(mut self, device: &Device) -> (Tensor<1>, Ledger) {
        let count = self.weights.len();
        let weights = Tensor::from_data(TensorData::new(self.weights, [count]), device);
        let sum = (Tensor::cat(self.losses, 0) * weights).sum();
        self.ledger.note(&sum, |losses| &mut losses.total);
        (sum, self.ledger)
    }
}
