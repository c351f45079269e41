//! What can be wrong with a configuration.

/// Why a configuration cannot be used. Each message names the key and what would be right.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The text is not TOML.
    #[error(
        "the configuration is not valid TOML ({reason}); repair the line, or start from a preset"
    )]
    Syntax {
        /// What the parser said, on one line.
        reason: String,
    },
    /// An assignment without `=`.
    #[error("{text:?} is not of the form key=value; write for example loss.mask=0.2")]
    Assignment {
        /// What was given.
        text: String,
    },
    /// A key that does not exist.
    #[error("there is no setting {key:?}; {remedy}")]
    UnknownKey {
        /// The key as given, with its section.
        key: String,
        /// The nearest valid keys.
        remedy: String,
    },
    /// A value of the wrong kind, or out of its range.
    #[error("{key} = {value} cannot be used: {reason}")]
    Value {
        /// The key with its section.
        key: String,
        /// The value as given.
        value: String,
        /// What would be right.
        reason: String,
    },
    /// Any of these, in a file.
    #[error("line {line}: {error}")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What is wrong there.
        error: Box<ConfigError>,
    },
    /// Any of these, in a file of another version of this program.
    #[error(
        "{error} (it was written by sos {written_by}, and this is sos {}; go on with that version, or start again with this one)",
        env!("CARGO_PKG_VERSION")
    )]
    OtherVersion {
        /// The version that wrote the file.
        written_by: String,
        /// What is wrong in it.
        error: Box<ConfigError>,
    },
    /// A setting that a run in progress cannot change.
    #[error(
        "{key} is {saved} in the run to be resumed and cannot become {wanted}; leave it out, or start a new run with --force or another --out"
    )]
    FixedOnResume {
        /// The key with its section.
        key: String,
        /// Its value in the run.
        saved: String,
        /// The value asked for.
        wanted: String,
    },
}
