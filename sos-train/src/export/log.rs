//! `log.jsonl`: what happened, one JSON object per line.
//!
//! Two kinds of lines: [`LogRecord`]s, and events, which have a key `event`:
//! ```text
//! {"step":0,"event":"start","device":"Flex on 8 threads"}
//! {"step":100,"seconds":9.1,"psnr":21.4,…,"losses":{"colour":0.012,…}}
//! {"step":100,"event":"note","text":"the masks are white = object"}
//! {"step":6000,"event":"end","seconds":702.5}
//! ```

use crate::run_folder::{RunError, RunFolder};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The state of training at one step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LogRecord {
    /// Steps done.
    pub step: u32,
    /// Seconds of training so far, over all sessions of the run.
    pub seconds: f64,
    /// Of the rays since the last record, in dB.
    pub psnr: f32,
    /// NeuS' b of the object.
    pub sharpness: f32,
    /// NeuS' b of the background, where it has one.
    pub sharpness_background: Option<f32>,
    /// Samples of both fields per second.
    pub samples_per_second: f32,
    /// Rays of the step.
    pub rays: u32,
    /// Hash levels that are on.
    pub levels: u32,
    /// Of the hash tables.
    pub learning_rate: f32,
    /// Share of the occupancy grid's cells that are not empty.
    pub occupied: Option<f32>,
    /// Mean change of the mattes since they were last looked at.
    pub alpha_change: Option<f32>,
    /// Every loss by name, before its weight, and as `total` their sum with weights, which is what is trained.
    pub losses: BTreeMap<String, f32>,
}

/// The log of a run, open for writing. Every line is handed to the system at once.
#[derive(Debug)]
pub struct TrainLog {
    /// None while the file is written anew.
    file: Option<File>,
    path: PathBuf,
}

impl TrainLog {
    /// A log for a new run.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn create(run: &RunFolder) -> Result<Self, RunError> {
        let path = run.log_path();
        run.write(&path, |_| Ok(()))?;
        Self::append(path)
    }

    /// The log of a run that goes on from its checkpoint at `step`: lines from beyond it, which
    /// will be written anew, lines that say it has come to its end, and a line a crash cut short are dropped.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn resume(run: &RunFolder, step: u32) -> Result<Self, RunError> {
        let path = run.log_path();
        rewrite(run, &path, |line| {
            let event = line.get("event").and_then(Value::as_str);
            let ended = matches!(event, Some("export" | "end"));
            !ended && step_of(line) <= u64::from(step)
        })?;
        Self::append(path)
    }

    /// Drops the records from beyond `step`, which a run has gone back to. What it has found out on the way it still knows,
    /// and does not say again: notes stay.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn go_back(&mut self, run: &RunFolder, step: u32) -> Result<(), RunError> {
        // Not every system renames onto a file that is open.
        self.file = None;
        rewrite(run, &self.path, |line| {
            line.get("event").is_some() || step_of(line) <= u64::from(step)
        })?;
        *self = Self::append(self.path.clone())?;
        Ok(())
    }

    /// Appends a record.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn record(&mut self, record: &LogRecord) -> Result<(), RunError> {
        self.line(record)
    }

    /// Appends an event with further keys and values.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn event<'a>(
        &mut self,
        step: u32,
        event: &str,
        details: impl IntoIterator<Item = (&'a str, Value)>,
    ) -> Result<(), RunError> {
        let mut object = Map::new();
        object.insert("step".to_owned(), step.into());
        object.insert("event".to_owned(), event.into());
        object.extend(
            details
                .into_iter()
                .map(|(key, value)| (key.to_owned(), value)),
        );
        self.line(&object)
    }

    /// Appends a sentence for the report: something detected, decided or gone wrong.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn note(&mut self, step: u32, text: &str) -> Result<(), RunError> {
        self.event(step, "note", [("text", text.into())])
    }

    fn append(path: PathBuf) -> Result<Self, RunError> {
        match OpenOptions::new().append(true).create(true).open(&path) {
            Ok(file) => Ok(Self {
                file: Some(file),
                path,
            }),
            Err(source) => Err(RunError::io("write", &path, source)),
        }
    }

    fn line(&mut self, value: &impl Serialize) -> Result<(), RunError> {
        serde_json::to_vec(value)
            .map_err(io::Error::from)
            .and_then(|mut line| {
                line.push(b'\n');
                // One call per line: it is written whole or, at worst, cut by a full disk.
                let file = self.file.as_mut();
                file.ok_or_else(|| io::Error::other("it is closed"))?
                    .write_all(&line)
            })
            .map_err(|source| RunError::io("write", &self.path, source))
    }
}

/// The step that a line is of.
fn step_of(line: &Value) -> u64 {
    line.get("step").and_then(Value::as_u64).unwrap_or(0)
}

/// Writes a log anew with the lines that are JSON and to be kept.
fn rewrite(run: &RunFolder, path: &Path, is_kept: impl Fn(&Value) -> bool) -> Result<(), RunError> {
    let text = read_or_empty(path)?;
    let mut kept = text
        .lines()
        .filter(|line| serde_json::from_str(line).is_ok_and(|line| is_kept(&line)));
    run.write(path, |out| {
        kept.try_for_each(|line| writeln!(out, "{line}"))
    })
}

/// All lines of a run's log that are JSON objects; none if there is no log.
///
/// # Errors
/// [`RunError::Io`] if the log cannot be read.
pub fn read_log(run: &RunFolder) -> Result<Vec<Map<String, Value>>, RunError> {
    Ok(read_or_empty(&run.log_path())?
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect())
}

fn read_or_empty(path: &Path) -> Result<String, RunError> {
    match fs::read(path) {
        Ok(bytes) => Ok(String::from_utf8_lossy(&bytes).into_owned()),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(String::new()),
        Err(source) => Err(RunError::io("read", path, source)),
    }
}
