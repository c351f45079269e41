//! The mean of numbers that come one by one.

#[derive(Default)]
pub(crate) struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    pub(crate) fn add(&mut self, value: f32) {
        self.sum += f64::from(value);
        self.count += 1;
    }

    /// Of at least so many; `None` of fewer.
    pub(crate) fn get(&self, fewest: usize) -> Option<f32> {
        (self.count >= fewest.max(1)).then(|| (self.sum / self.count as f64) as f32)
    }
}
