//! The middle one of some numbers.

use std::cmp::Ordering;

/// Floating-point numbers in their total order.
pub(crate) trait Ordered: Copy {
    fn order(&self, other: &Self) -> Ordering;
}

impl Ordered for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Ordered for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// The middle value; sorts the list. `None` of an empty one.
pub(crate) fn median<T: Ordered>(values: &mut [T]) -> Option<T> {
    values.sort_by(T::order);
    values.get(values.len() / 2).copied()
}
