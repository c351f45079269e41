//! Whose fault an error is, and what that makes of the exit code.

use crate::config::ConfigError;
use crate::export::ExportError;
use crate::live::LiveError;
use crate::prepare::error::PrepareError;
use crate::report::ReportError;
use crate::run_folder::RunError;
use scene_capture::CaptureError;
use std::path::{Path, PathBuf};

/// All went well.
pub const EXIT_OK: u8 = 0;
/// Something in here is broken.
pub const EXIT_INTERNAL: u8 = 1;
/// The input, the command line or the disk does not allow what was asked for.
pub const EXIT_BAD_INPUT: u8 = 2;
/// `sos doctor` found something that training cannot come to terms with.
pub const EXIT_FAILED_CHECK: u8 = 3;
/// Stopped by Ctrl-C.
pub const EXIT_INTERRUPTED: u8 = 130;

/// What each exit code says, for the manual.
pub const EXIT_CODES: [(u8, &str); 5] = [
    (EXIT_OK, "done"),
    (
        EXIT_BAD_INPUT,
        "the input, the command line or the disk does not allow it: one sentence with the file and the remedy",
    ),
    (
        EXIT_FAILED_CHECK,
        "sos doctor only: the scene could be read, and a check of it failed",
    ),
    (
        EXIT_INTERRUPTED,
        "stopped by Ctrl-C, with a checkpoint saved; before training, with nothing kept",
    ),
    (EXIT_INTERNAL, "a fault in the program"),
];

/// A file or folder the user gave is not what it should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {what}; {remedy}", path.display())]
pub struct InputError {
    /// The file or folder.
    pub path: PathBuf,
    /// What is wrong with it.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}

impl InputError {
    /// An error about `path`.
    #[must_use]
    pub fn new(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            path: path.to_path_buf(),
            what: what.into(),
            remedy: remedy.into(),
        }
    }
}

/// The exit code for an error: [`EXIT_INTERRUPTED`] if it is no more than Ctrl-C, [`EXIT_BAD_INPUT`]
/// if anything in its chain is about input, configuration or files, else [`EXIT_INTERNAL`].
#[must_use]
pub fn exit_code(error: &anyhow::Error) -> u8 {
    let stopped = |cause: &(dyn std::error::Error + 'static)| {
        matches!(cause.downcast_ref(), Some(CaptureError::Interrupted))
    };
    if error.chain().any(stopped) {
        return EXIT_INTERRUPTED;
    }
    let users = error.chain().any(|cause| {
        cause.is::<InputError>()
            || cause.is::<LiveError>()
            || cause.is::<PrepareError>()
            || cause.is::<ReportError>()
            || cause.is::<ConfigError>()
            || cause.is::<RunError>()
            || cause.is::<ExportError>()
            || cause.is::<io_colmap::ColmapError>()
            || cause.is::<scene_import::ImportError>()
            || cause.is::<CaptureError>()
            || cause.is::<scene_export::ExportError>()
            || cause.is::<sos_eval::EvalError>()
            || cause.is::<demo_scene::DemoError>()
    });
    if users { EXIT_BAD_INPUT } else { EXIT_INTERNAL }
}

/// An error with its causes as one line. A cause that the text so far quotes is not repeated.
#[must_use]
pub fn sentence(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        let cause = cause
            .to_string()
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ");
        if !text.contains(&cause) {
            if !text.is_empty() {
                text.push_str(": ");
            }
            text.push_str(&cause);
        }
    }
    text
}
