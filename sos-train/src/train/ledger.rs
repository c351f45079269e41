//! The losses of a step, and their way from the device: those of some steps in one transfer.

use burn::Tensor;

/// The losses of a step, as numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct StepLosses {
    /// The sum that is differentiated.
    pub total: f32,
    /// Joint colour.
    pub colour: f32,
    /// BaCo alone, outside the object.
    pub background: f32,
    /// Eikonal, both fields.
    pub eikonal: f32,
    /// Sparsity.
    pub sparsity: f32,
    /// Masks, of the matte and of a semantic field's share.
    pub mask: f32,
    /// Sparse points.
    pub points: f32,
    /// Curvature.
    pub curvature: f32,
    /// Distortion.
    pub distortion: f32,
    /// Light from far away.
    pub far: f32,
    /// What hides the object.
    pub hidden: f32,
    /// Light from elsewhere than where rays are known to end.
    pub sight: f32,
    /// Mean squared error of the joint colour.
    pub mse: f32,
}

impl StepLosses {
    /// Each by its name in logs, before its weight; and their weighted sum, the `total`.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f32); 12] {
        // In full: a new loss does not compile before it has a name, or is left out on purpose.
        let Self {
            total,
            colour,
            background,
            eikonal,
            sparsity,
            mask,
            points,
            curvature,
            distortion,
            far,
            hidden,
            sight,
            mse: _,
        } = *self;
        [
            ("total", total),
            ("colour", colour),
            ("background", background),
            ("eikonal", eikonal),
            ("sparsity", sparsity),
            ("mask", mask),
            ("points", points),
            ("curvature", curvature),
            ("distortion", distortion),
            ("far", far),
            ("hidden", hidden),
            ("sight", sight),
        ]
    }

    /// Whether they are numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.total.is_finite() && self.mse.is_finite()
    }
}

/// Where a loss is written down.
pub(crate) type Entry = fn(&mut StepLosses) -> &mut f32;

/// A step's losses that are numbers on the device so far.
#[derive(Clone, Debug, Default)]
pub struct Ledger {
    values: Vec<Tensor<1>>,
    entries: Vec<Entry>,
}

impl Ledger {
    /// Adds a loss `[1]` to its entry.
    pub(super) fn note(&mut self, loss: &Tensor<1>, entry: Entry) {
        self.note_all(loss, [entry]);
    }

    /// Adds losses to their entries, one each.
    pub(super) fn note_all(
        &mut self,
        losses: &Tensor<1>,
        entries: impl IntoIterator<Item = Entry>,
    ) {
        let before = self.entries.len();
        self.entries.extend(entries);
        debug_assert_eq!(
            losses.dims(),
            [self.entries.len() - before],
            "Ledger: losses"
        );
        self.values.push(losses.clone().detach());
    }

    /// The sums of all entries. Waits for the device.
    #[must_use]
    pub fn read(self) -> StepLosses {
        Batch::of(vec![self]).mean()
    }
}

/// The losses of some steps, to be read in one transfer.
#[derive(Clone, Debug, Default)]
pub(super) struct Batch {
    steps: usize,
    /// One for each entry, where there is any.
    values: Option<Tensor<1>>,
    entries: Vec<Entry>,
}

impl Batch {
    /// Of these steps.
    pub(super) fn of(steps: Vec<Ledger>) -> Self {
        let count = steps.len();
        let (mut values, mut entries) = (Vec::new(), Vec::new());
        for step in steps {
            values.extend(step.values);
            entries.extend(step.entries);
        }
        Self {
            steps: count,
            values: (!values.is_empty()).then(|| Tensor::cat(values, 0)),
            entries,
        }
    }

    /// The sums of all entries, on average over the steps. Waits for the device.
    pub(super) fn mean(self) -> StepLosses {
        let mut losses = StepLosses::default();
        if let Some(values) = self.values {
            let values = values.into_data();
            for (entry, value) in self.entries.iter().zip(values.iter::<f32>()) {
                *entry(&mut losses) += value / self.steps as f32;
            }
        }
        losses
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    #[test]
    fn parts_of_a_loss_add_up() {
        let device = Device::flex().autodiff();
        let of = |value: f32| Tensor::<1>::from_floats([value], &device);
        let mut ledger = Ledger::default();
        ledger.note(&of(0.5), |losses| &mut losses.mask);
        ledger.note(&of(2.0), |losses| &mut losses.total);
        ledger.note(&of(0.25), |losses| &mut losses.mask);
        let losses = ledger.clone().read();
        assert_eq!((losses.mask, losses.total, losses.mse), (0.75, 2.0, 0.0));
        let mut other = Ledger::default();
        other.note(&of(1.0), |losses| &mut losses.total);
        let mean = Batch::of(vec![ledger, other]).mean();
        assert_eq!((mean.mask, mean.total), (0.375, 1.5));
        assert_eq!(Ledger::default().read().total, 0.0);
    }
}
