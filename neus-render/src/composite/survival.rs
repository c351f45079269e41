//! How much light every sample of some rays lets through, many at once.
//!
//! Half of compositing is the polynomials of these logarithms. They depend on the sample alone, so that they are
//! taken ahead of the way along the ray, in vector code; the results are those of one after the other.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::cpu::Batch;
use super::opacity::Kernel;
use super::{background_column, object_column};

/// `log(1 - a)` of all samples of consecutive rays, without matte values.
pub(super) struct Logs {
    object: Vec<f32>,
    /// The first one's row.
    object_start: usize,
    background: Vec<f32>,
    background_start: usize,
}

impl Logs {
    pub(super) fn of(batch: &Batch<'_>, rays: Range<usize>) -> Self {
        let packing = batch.packing;
        let [of_object, of_background] = batch.kernels();
        let rows = |offsets: &[u32]| offsets[rays.start] as usize..offsets[rays.end] as usize;
        let object = rows(packing.object_offsets());
        let background = rows(packing.background_offsets());
        let dt = packing.dt();
        Self {
            object_start: object.start,
            background_start: background.start,
            object: logs(
                &of_object,
                &batch.object[object.start * batch.object_width..],
                batch.object_width,
                &packing.object()[object],
                dt,
            ),
            background: logs(
                &of_background,
                &batch.background[background.start * batch.background_width..],
                batch.background_width,
                &packing.background()[background],
                dt,
            ),
        }
    }

    #[inline]
    pub(super) fn object(&self, row: usize) -> f32 {
        self.object[row - self.object_start]
    }

    #[inline]
    pub(super) fn background(&self, row: usize) -> f32 {
        self.background[row - self.background_start]
    }
}

/// Of the samples in `intervals`, whose lengths are in `dt`; rows of `values` begin with distance and slope.
fn logs(kernel: &Kernel, values: &[f32], width: usize, intervals: &[u32], dt: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; intervals.len()];
    Arch::new().dispatch(LogSurvivals {
        kernel,
        values,
        width,
        intervals,
        dt,
        out: &mut out,
    });
    out
}

/// Samples taken together.
const LANES: usize = 16;

/// [`logs`]'s arguments, as pulp wants a function with generic body to be written.
struct LogSurvivals<'a> {
    kernel: &'a Kernel,
    values: &'a [f32],
    width: usize,
    intervals: &'a [u32],
    dt: &'a [f32],
    out: &'a mut [f32],
}

impl WithSimd for LogSurvivals<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let intervals = self.intervals.chunks(LANES);
        let rows = self.values.chunks(LANES * self.width);
        for ((out, intervals), rows) in self.out.chunks_mut(LANES).zip(intervals).zip(rows) {
            let (mut sdf, mut slope, mut length) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            let rows = rows.chunks_exact(self.width);
            for (i, (row, interval)) in rows.zip(intervals).enumerate() {
                const { assert!(object_column::SDF == background_column::SDF) };
                const { assert!(object_column::SLOPE == background_column::SLOPE) };
                sdf[i] = row[object_column::SDF];
                slope[i] = row[object_column::SLOPE];
                length[i] = self.dt[*interval as usize];
            }
            let mut logs = [0.0; LANES];
            for i in 0..LANES {
                logs[i] = self.kernel.log_survival(sdf[i], slope[i], length[i]);
            }
            out.copy_from_slice(&logs[..out.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::alpha::NeusParameters;
    use crate::composite::Transparency;
    use crate::random::unit_float;

    #[test]
    fn many_at_once_are_as_one_by_one() {
        let neus = NeusParameters {
            sharpness: 40.0,
            cos_anneal: 0.7,
            epsilon: 1e-5,
        };
        let dt = [0.01, 0.02, 0.3];
        for transparency in [Transparency::Sdf, Transparency::Density] {
            let kernel = Kernel::new(transparency, neus);
            for n in [0, 1, 15, 16, 17, 40] {
                let values: Vec<f32> = (0..6 * n as u64)
                    .map(|i| 2.0 * unit_float(3, i) - 1.0)
                    .collect();
                let intervals: Vec<u32> = (0..n as u32).map(|i| i % 3).collect();
                let expected: Vec<f32> = values
                    .chunks_exact(6)
                    .zip(&intervals)
                    .map(|(row, i)| kernel.log_survival(row[0], row[1], dt[*i as usize]))
                    .collect();
                assert_eq!(logs(&kernel, &values, 6, &intervals, &dt), expected);
            }
        }
    }
}
