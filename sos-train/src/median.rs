//! The middle one of some numbers.

/// The middle value; sorts the list. `None` of an empty one.
pub(crate) fn median(values: &mut [f32]) -> Option<f32> {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}
