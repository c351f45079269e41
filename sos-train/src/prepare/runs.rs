//! A small number for each pixel, as runs of equal ones: labels change a few times a row.

/// A byte for each of a view's pixels, by row-major number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ByteRuns {
    /// The first pixel of each run.
    starts: Vec<u32>,
    /// Each run's byte.
    values: Vec<u8>,
}

impl ByteRuns {
    /// The bytes of all pixels, in order.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut runs = Self::default();
        for (i, &byte) in bytes.iter().enumerate() {
            if runs.values.last() != Some(&byte) {
                runs.starts.push(i as u32);
                runs.values.push(byte);
            }
        }
        // They stay as long as the view does.
        runs.starts.shrink_to_fit();
        runs.values.shrink_to_fit();
        runs
    }

    /// The byte of a pixel; beyond the last one the last one's. 0 without any.
    #[must_use]
    pub fn get(&self, pixel: u32) -> u8 {
        let after = self.starts.partition_point(|start| *start <= pixel);
        after.checked_sub(1).map_or(0, |run| self.values[run])
    }

    /// Bytes that this takes in memory.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        self.starts.len() * size_of::<u32>() + self.values.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_back() {
        for bytes in [
            &[][..],
            &[7],
            &[0, 0, 0],
            &[1, 1, 2, 2, 2, 1, 0, 0, 9],
            &[1, 2, 3, 4],
        ] {
            let runs = ByteRuns::of(bytes);
            let found: Vec<u8> = (0..bytes.len() as u32).map(|i| runs.get(i)).collect();
            assert_eq!(found, bytes);
        }
        assert_eq!(ByteRuns::default().get(3), 0);
        assert_eq!(ByteRuns::of(&[4; 1000]).in_memory(), 5);
    }
}
