//! Where the time of [`LazyAdam`](crate::LazyAdam)'s steps goes when backward passes have waited for them.

use tensor_slices::Stopwatch;

/// Adding up the gradients of those passes, which is the end of backward; of all threads together.
pub static SCATTER: Stopwatch = Stopwatch::new();
/// Updating tables in those steps; of all threads together.
pub static UPDATE: Stopwatch = Stopwatch::new();
