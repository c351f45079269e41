//! How a command answers: in a sentence or a table for people, in one JSON object for programs.

use crate::run_folder::RunError;
use serde::Serialize;
use std::io::{ErrorKind, Write as _};
use std::path::Path;

/// Prints a result.
///
/// # Errors
/// [`RunError`] where it does not arrive.
pub(super) fn answer(text: &str) -> Result<(), RunError> {
    print(format!("{}\n", text.trim_end()).as_bytes())
}

/// Prints to standard output. A reader that has gone, as in `sos eval … | head`, is no error; a full disk is.
///
/// # Errors
/// [`RunError`] where it does not arrive.
pub(super) fn print(bytes: &[u8]) -> Result<(), RunError> {
    let mut out = std::io::stdout().lock();
    // What is left in the buffer would be lost in silence at the end.
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            let place = Path::new("standard output");
            Err(RunError::outside("write to", place, error))
        }
        _ => Ok(()),
    }
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
            Self::Json => answer(&serde_json::to_string_pretty(result)?)?,
            Self::Sentence => answer(sentence)?,
            Self::Silence => {}
        }
        Ok(())
    }
}
