//! Sets of pixels as runs along rows: an outline's inside takes a few bytes a row, however large.

use serde::{Deserialize, Serialize};

/// A set of a view's pixels, by row-major number.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PixelSpans {
    /// The first pixel of each run, and how many pixels there are in earlier ones.
    starts: Vec<(u32, u32)>,
    len: u32,
}

impl PixelSpans {
    /// How many pixels there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len as usize
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Adds a pixel of a higher number than those that are there.
    pub(crate) fn push(&mut self, pixel: u32) {
        let follows = self
            .starts
            .last()
            .is_some_and(|(start, before)| start + (self.len - before) == pixel);
        if !follows {
            self.starts.push((pixel, self.len));
        }
        self.len += 1;
    }

    /// The pixels of both.
    #[must_use]
    pub fn united(&self, other: &Self) -> Self {
        let mut pixels: Vec<u32> = self.iter().chain(other.iter()).collect();
        pixels.sort_unstable();
        pixels.dedup();
        let mut both = Self::default();
        for pixel in pixels {
            both.push(pixel);
        }
        both
    }

    /// The pixel that `n` others come before; the last one where `n` is too large. 0 without any.
    #[must_use]
    pub fn nth(&self, n: usize) -> u32 {
        let n = (n as u32).min(self.len.saturating_sub(1));
        let run = self.starts.partition_point(|(_, before)| *before <= n);
        run.checked_sub(1)
            .map_or(0, |run| self.starts[run].0 + n - self.starts[run].1)
    }

    /// All of them, in order.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.runs().flat_map(|(first, last)| first..=last)
    }

    /// First and last pixel of each run, in order.
    pub fn runs(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let ends = self.starts.iter().skip(1).map(|(_, before)| *before);
        let ends = ends.chain(std::iter::once(self.len));
        self.starts
            .iter()
            .zip(ends)
            .map(|(&(start, before), end)| (start, start + (end - before) - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_come_back_in_their_order() {
        let pixels = [3u32, 4, 5, 9, 20, 21];
        let mut spans = PixelSpans::default();
        assert!(spans.is_empty());
        assert_eq!(spans.runs().count(), 0);
        for pixel in pixels {
            spans.push(pixel);
        }
        assert_eq!(spans.len(), pixels.len());
        let found: Vec<u32> = (0..spans.len()).map(|n| spans.nth(n)).collect();
        assert_eq!(found, pixels);
        assert_eq!(spans.iter().collect::<Vec<u32>>(), pixels);
        let runs: Vec<(u32, u32)> = spans.runs().collect();
        assert_eq!(runs, [(3, 5), (9, 9), (20, 21)]);
    }
}
