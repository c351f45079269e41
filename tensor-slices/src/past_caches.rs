//! Writing what nobody reads soon.

/// Copies each pair's second slice to its first, past the caches where the machine can.
///
/// An ordinary store fetches the line that it overwrites first, and takes another one's place in the cache. Of rows that
/// only a later pass reads, and more of them than the caches hold, that is twice the traffic.
///
/// # Panics
/// When the lengths of a pair differ.
pub fn copy_past_caches<const N: usize>(pairs: [(&mut [f32], &[f32]); N]) {
    // Before anything is written: a panic afterwards would leave out the fence.
    for (to, from) in &pairs {
        assert_eq!(to.len(), from.len(), "copy_past_caches: lengths");
    }
    for (to, from) in pairs {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{__m128, _mm_loadu_ps, _mm_stream_ps};
            // SAFETY: a vector is four values, whatever they are.
            let (before, vectors, after) = unsafe { to.align_to_mut::<__m128>() };
            let (first, rest) = from.split_at(before.len());
            let (middle, last) = rest.split_at(rest.len() - after.len());
            before.copy_from_slice(first);
            after.copy_from_slice(last);
            for (vector, four) in vectors.iter_mut().zip(middle.as_chunks::<4>().0) {
                // SAFETY: `four` has a vector's values, and `vector` its alignment. SSE is part of x86-64.
                unsafe {
                    _mm_stream_ps(
                        std::ptr::from_mut(vector).cast(),
                        _mm_loadu_ps(four.as_ptr()),
                    );
                }
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        to.copy_from_slice(from);
    }
    #[cfg(target_arch = "x86_64")]
    // SAFETY: as above. Nobody may read what was written before this, and nobody can: it was borrowed.
    unsafe {
        std::arch::x86_64::_mm_sfence();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "copy_past_caches: lengths")]
    fn lengths_that_differ_are_refused() {
        copy_past_caches([(&mut [0.0; 2], &[1.0; 2]), (&mut [0.0; 2], &[1.0; 3])]);
    }

    #[test]
    fn every_value_arrives_wherever_slices_begin() {
        let from: Vec<f32> = (0..70).map(|i| i as f32).collect();
        for (start, len) in [(0, 64), (1, 61), (3, 2), (5, 0), (2, 4)] {
            let (mut one, mut other) = (vec![-1.0; 70], vec![-1.0; 70]);
            copy_past_caches([
                (&mut one[start..start + len], &from[..len]),
                (&mut other[..len], &from[start..start + len]),
            ]);
            for i in 0..70 {
                let expected = if (start..start + len).contains(&i) {
                    (i - start) as f32
                } else {
                    -1.0
                };
                assert_eq!(one[i], expected, "value {i} of {len} from {start}");
                let expected = if i < len { (start + i) as f32 } else { -1.0 };
                assert_eq!(other[i], expected, "value {i} of {len}, from {start}");
            }
        }
    }
}
