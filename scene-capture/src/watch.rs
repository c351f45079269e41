//! How a caller follows what happens, and stops it.

use std::fmt;

/// A part of the work that takes time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Frames are taken from the video; counted in pictures looked at.
    Frames,
    /// COLMAP finds features; counted in photos.
    Features,
    /// COLMAP compares photos; counted in photos or blocks of pairs.
    Matches,
    /// COLMAP finds poses; counted in photos.
    Poses,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Stage::Frames => "taking frames",
            Stage::Features => "finding features",
            // COLMAP counts squares of the table of all pairs, not photos.
            Stage::Matches => "comparing blocks of photos",
            Stage::Poses => "finding poses",
        })
    }
}

/// How far a stage is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// Parts done.
    pub done: usize,
    /// Parts in all, as far as is known.
    pub total: usize,
}

/// What a caller wants to hear, and whether it still wants the scene. `()` hears nothing and never
/// stops.
pub trait Watch {
    /// Something moved on. A stage may come again, when more has to be tried.
    fn progress(&self, _progress: Progress) {}

    /// A decision that a user should see.
    fn note(&self, _sentence: &str) {}

    /// Whether to stop, which is asked several times a second.
    fn interrupted(&self) -> bool {
        false
    }
}

impl Watch for () {}
