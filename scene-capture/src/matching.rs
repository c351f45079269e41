//! Which photos are compared with which.

use crate::source::Source;

/// Up to that many photos, each is compared with every other: 31 000 pairs. More take too long on
/// a CPU.
const ALL_PAIRS_UP_TO: usize = 250;
/// Neighbours compared in a row of frames, which are made to overlap.
const FRAMES_OVERLAP: usize = 10;
/// Neighbours compared in a large set of photos, which are likely to be in order.
const PHOTOS_OVERLAP: usize = 20;
/// Blocks of photos that are compared at a time, each of which is a step of progress.
const BLOCKS: usize = 10;
const SMALLEST_BLOCK: usize = 5;
/// With a smaller share of the photos, more comparisons may help.
pub(crate) const ENOUGH: f64 = 0.6;

/// A way of choosing pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Matcher {
    /// All pairs, in blocks of so many photos.
    Exhaustive { block: usize },
    /// Each photo with so many that follow by name, and some further on, at distances of powers
    /// of two.
    Sequential { overlap: usize },
    /// Photos taken near each other, by their EXIF positions.
    Spatial,
}

impl Matcher {
    /// COLMAP's command.
    pub(crate) fn command(self) -> &'static str {
        match self {
            Matcher::Exhaustive { .. } => "exhaustive_matcher",
            Matcher::Sequential { .. } => "sequential_matcher",
            Matcher::Spatial => "spatial_matcher",
        }
    }

    fn all_pairs(photos: usize) -> Self {
        Matcher::Exhaustive {
            block: photos.div_ceil(BLOCKS).max(SMALLEST_BLOCK),
        }
    }
}

/// What to try, one after the other: the next only if the one before gave too few poses. Each is a
/// list of matchers; pairs that were compared are not compared again.
pub(crate) fn attempts(source: &Source, photos: usize, positions: bool) -> Vec<Vec<Matcher>> {
    let few = photos <= ALL_PAIRS_UP_TO;
    match source {
        Source::Video(_) => {
            let row = vec![Matcher::Sequential {
                overlap: FRAMES_OVERLAP,
            }];
            if few {
                vec![row, vec![Matcher::all_pairs(photos)]]
            } else {
                vec![row]
            }
        }
        Source::Photos(_) if few => vec![vec![Matcher::all_pairs(photos)]],
        Source::Photos(_) => {
            let mut matchers = vec![Matcher::Sequential {
                overlap: PHOTOS_OVERLAP,
            }];
            if positions {
                matchers.push(Matcher::Spatial);
            }
            vec![matchers]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn comparisons_suit_the_source() {
        let photos = Source::Photos(PathBuf::new());
        let video = Source::Video(PathBuf::new());
        let all = |block| vec![Matcher::Exhaustive { block }];
        let row = |overlap| Matcher::Sequential { overlap };
        assert_eq!(attempts(&photos, 30, true), [all(5)]);
        assert_eq!(attempts(&photos, 250, false), [all(25)]);
        assert_eq!(attempts(&photos, 251, false), [vec![row(20)]]);
        assert_eq!(
            attempts(&photos, 251, true),
            [vec![row(20), Matcher::Spatial]]
        );
        assert_eq!(attempts(&video, 120, false), [vec![row(10)], all(12)]);
        assert_eq!(attempts(&video, 400, false), [vec![row(10)]]);
    }
}
