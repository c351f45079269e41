//! What the allocator does with memory that training no longer needs for the moment.

use libmimalloc_sys::{mi_option_get, mi_option_set, mi_option_t};

/// `mi_option_purge_delay`: the bindings have no name for it.
const PURGE_DELAY: mi_option_t = 15;
/// Its value unless the environment (`MIMALLOC_PURGE_DELAY`) sets another.
const USUAL_DELAY_MS: core::ffi::c_long = 1000;

/// Tells mimalloc to keep what is freed instead of returning it to the system.
///
/// Every step needs as much memory as the one before. Returned pages come back one fault at a time,
/// zeroed, which took a tenth of a step.
pub fn keep_freed_memory() {
    // SAFETY: both calls read or write one entry of a table that has more than 15 of them. They are
    // not thread safe: a program calls this first thing.
    unsafe {
        if mi_option_get(PURGE_DELAY) == USUAL_DELAY_MS {
            mi_option_set(PURGE_DELAY, -1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_option_is_the_one_meant() {
        if std::env::var_os("MIMALLOC_PURGE_DELAY").is_none() {
            // SAFETY: as above; no other test touches options.
            let (before, after) = unsafe {
                let before = mi_option_get(PURGE_DELAY);
                keep_freed_memory();
                (before, mi_option_get(PURGE_DELAY))
            };
            assert_eq!((before, after), (USUAL_DELAY_MS, -1));
        }
    }
}
