//! Overlap of two masks: intersection over union and pixel accuracy.

use crate::picture::{Mask, assert_same_size};

/// Pixel counts of a mask against the true mask; everything in this file is a ratio of these.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overlap {
    /// Inside both.
    pub both: usize,
    /// Inside the prediction only.
    pub only_pred: usize,
    /// Inside the truth only.
    pub only_truth: usize,
    /// Inside neither.
    pub neither: usize,
}

impl Overlap {
    /// Counts the pixels of two masks `[height, width]`.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn count(pred: &Mask, truth: &Mask) -> Self {
        assert_same_size("Overlap::count", pred, truth);
        let mut counts = [0_usize; 4];
        for (&p, &t) in pred.inside.iter().zip(&truth.inside) {
            counts[usize::from(p) * 2 + usize::from(t)] += 1;
        }
        Self {
            both: counts[3],
            only_pred: counts[2],
            only_truth: counts[1],
            neither: counts[0],
        }
    }

    /// Whether the prediction has pixels inside and pixels outside.
    pub fn tells_apart(&self) -> bool {
        self.both + self.only_pred > 0 && self.only_truth + self.neither > 0
    }

    /// What the prediction's complement would have.
    pub fn inverted(&self) -> Self {
        Self {
            both: self.only_truth,
            only_pred: self.neither,
            only_truth: self.both,
            neither: self.only_pred,
        }
    }

    /// Foreground `IoU = |P ∩ T| / |P ∪ T|`; 1 if both are empty.
    pub fn iou(&self) -> f64 {
        ratio(self.both, self.both + self.only_pred + self.only_truth)
    }

    /// Two-class `mIoU`: mean of the IoU of the foreground and of the background.
    pub fn miou(&self) -> f64 {
        let background = ratio(
            self.neither,
            self.neither + self.only_pred + self.only_truth,
        );
        0.5 * (self.iou() + background)
    }

    /// Pixel accuracy: the share of pixels on which both masks agree.
    pub fn accuracy(&self) -> f64 {
        let total = self.both + self.only_pred + self.only_truth + self.neither;
        ratio(self.both + self.neither, total)
    }
}

/// `part / whole`, and 1 for nothing out of nothing: two empty sets agree.
fn ratio(part: usize, whole: usize) -> f64 {
    if whole == 0 {
        1.0
    } else {
        part as f64 / whole as f64
    }
}

/// Foreground intersection over union of two masks, `|P ∩ T| / |P ∪ T|`; 1 if both are empty,
/// 0 if only one is.
///
/// ```
/// use sos_eval::{Plane, iou};
/// let left = Plane::from_fn(4, 1, |x, _| if x < 2 { 1.0 } else { 0.0 });
/// let middle = Plane::from_fn(4, 1, |x, _| if x == 1 || x == 2 { 0.9 } else { 0.2 });
/// assert_eq!(iou(&left.mask(0.5), &middle.mask(0.5)), 1.0 / 3.0);
/// ```
pub fn iou(pred: &Mask, truth: &Mask) -> f64 {
    Overlap::count(pred, truth).iou()
}
