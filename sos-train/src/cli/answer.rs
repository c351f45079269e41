//! How a command answers: in a sentence or a table for people, in one JSON object for programs.

use serde::Serialize;
use std::io::Write as _;

/// Prints a result. A reader that has gone, as in `sos eval … | head`, is no error.
pub(super) fn answer(text: &str) {
    let _ = writeln!(std::io::stdout(), "{}", text.trim_end());
}

/// What the answer is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Voice {
    Sentence,
    /// Asked for, and so given even if all else is quiet.
    Json,
    Silence,
}

impl Voice {
    pub(super) fn of(json: bool, quiet: bool) -> Self {
        match (json, quiet) {
            (true, _) => Self::Json,
            (false, true) => Self::Silence,
            (false, false) => Self::Sentence,
        }
    }

    /// Gives one of both, or nothing.
    pub(super) fn answer(self, result: &impl Serialize, sentence: &str) -> anyhow::Result<()> {
        match self {
            Self::Json => answer(&serde_json::to_string_pretty(result)?),
            Self::Sentence => answer(sentence),
            Self::Silence => {}
        }
        Ok(())
    }
}
