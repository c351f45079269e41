//! Programs: found, asked, run with their lines read as they come, ended with us.

use crate::error::CaptureError;
use crate::watch::Watch;
use std::collections::VecDeque;
use std::ffi::{OsStr, OsString};
use std::io::{BufRead as _, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

/// How often the watch is asked whether to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Lines kept to say why a program failed.
const LAST_LINES: usize = 40;
/// What a failure says is cut there.
const LONGEST_REASON: usize = 300;

/// A program on this machine.
#[derive(Debug, Clone)]
pub(crate) struct Program {
    pub(crate) path: PathBuf,
    /// Words before those of a call: the script, where the program is an interpreter.
    before: Vec<&'static str>,
    environment: Vec<(&'static str, OsString)>,
}

impl Program {
    pub(crate) fn at(path: &Path) -> Self {
        Self {
            path: path.to_path_buf(),
            before: Vec::new(),
            environment: Vec::new(),
        }
    }

    /// A script that is handed to its interpreter as an argument.
    pub(crate) fn script(interpreter: &Path, before: Vec<&'static str>) -> Self {
        Self {
            before,
            ..Self::at(interpreter)
        }
    }

    /// On the search path.
    pub(crate) fn find(name: &str, remedy: &'static str) -> Result<Self, CaptureError> {
        let path = which::which(name).map_err(|_| CaptureError::Missing {
            what: format!("the program {name} was not found on the PATH"),
            remedy,
        })?;
        Ok(Self::at(&path))
    }

    pub(crate) fn with_environment(mut self, key: &'static str, value: impl AsRef<OsStr>) -> Self {
        self.environment.push((key, value.as_ref().to_os_string()));
        self
    }

    /// Everything that a short command prints, on either stream, however it ends.
    pub(crate) fn ask(&self, arguments: &[&str]) -> Result<String, CaptureError> {
        let output = self
            .command()
            .args(arguments)
            .stdin(Stdio::null())
            .output()
            .map_err(|e| CaptureError::io("start", &self.path, e))?;
        Ok(String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr))
    }

    /// How a program that says little ends, what it prints, and the lines of its standard error.
    pub(crate) fn answer(
        &self,
        arguments: &[OsString],
    ) -> Result<(ExitStatus, String, Vec<String>), CaptureError> {
        let (mut running, lines) = self.start(arguments, false)?;
        let mut text = Vec::new();
        if let Some(mut output) = running.child.stdout.take() {
            output
                .read_to_end(&mut text)
                .map_err(|e| CaptureError::io("read", &self.path, e))?;
        }
        let status = running.end(&())?;
        let text = String::from_utf8_lossy(&text).into_owned();
        Ok((status, text, lines.iter().collect()))
    }

    /// Runs the program to its end, and hands over its lines.
    ///
    /// Returns how it ended and what it said last. It is killed when the watch says so.
    pub(crate) fn run(
        &self,
        arguments: &[OsString],
        watch: &dyn Watch,
        mut on_line: impl FnMut(&str),
    ) -> Result<Ended, CaptureError> {
        let (mut running, lines) = self.start(arguments, true)?;
        let mut last = LastLines::default();
        loop {
            if watch.interrupted() {
                return Err(CaptureError::Interrupted);
            }
            match lines.recv_timeout(LOOK_EVERY) {
                Ok(line) => {
                    on_line(&line);
                    last.push(line);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let status = running.end(watch)?;
        Ok(Ended { status, last })
    }

    /// Starts the program. The lines are those of standard error, and of standard output if
    /// `with_output`; without, that is left to be read.
    pub(crate) fn start(
        &self,
        arguments: &[OsString],
        with_output: bool,
    ) -> Result<(Running, Receiver<String>), CaptureError> {
        let mut child = self
            .command()
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| CaptureError::io("start", &self.path, e))?;
        let (sender, lines) = channel();
        if let Some(errors) = child.stderr.take() {
            send_lines(errors, sender.clone());
        }
        if with_output && let Some(output) = child.stdout.take() {
            send_lines(output, sender);
        }
        let program = self.path.clone();
        Ok((Running { child, program }, lines))
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.path);
        command.args(&self.before);
        for (key, value) in &self.environment {
            command.env(key, value);
        }
        command
    }

    /// What went wrong, from a program's last words.
    pub(crate) fn failed(
        &self,
        task: &'static str,
        ended: &Ended,
        remedy: impl Into<String>,
    ) -> CaptureError {
        CaptureError::Failed {
            program: self.path.clone(),
            task,
            what: ended.reason(),
            remedy: remedy.into(),
        }
    }
}

/// Sends text line by line until it ends or nobody listens. A carriage return ends a line too, as
/// where a counter is overwritten.
fn send_lines(from: impl Read + Send + 'static, to: Sender<String>) {
    thread::spawn(move || {
        for line in BufReader::new(from).split(b'\n') {
            let Ok(line) = line else { return };
            for part in line.split(|byte| *byte == b'\r') {
                if !part.is_empty() && to.send(String::from_utf8_lossy(part).into_owned()).is_err()
                {
                    return;
                }
            }
        }
    });
}

/// A program that runs, and is killed when this is dropped.
#[derive(Debug)]
pub(crate) struct Running {
    pub(crate) child: Child,
    program: PathBuf,
}

impl Running {
    /// Waits for a program that has closed its output, which does not take long.
    pub(crate) fn end(&mut self, watch: &dyn Watch) -> Result<ExitStatus, CaptureError> {
        let status = loop {
            let ended = self.child.try_wait();
            match ended.map_err(|e| CaptureError::io("wait for", &self.program, e))? {
                Some(status) => break status,
                None if watch.interrupted() => return Err(CaptureError::Interrupted),
                None => thread::sleep(LOOK_EVERY),
            }
        };
        // Ctrl-C reaches a program of the same terminal too, maybe before us.
        if watch.interrupted() || was_interrupted(status) {
            return Err(CaptureError::Interrupted);
        }
        Ok(status)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended; then there is nothing to do, and nobody to tell.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(unix)]
fn was_interrupted(status: ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt as _;
    // SIGINT and SIGTERM.
    matches!(status.signal(), Some(2 | 15))
}

#[cfg(not(unix))]
fn was_interrupted(status: ExitStatus) -> bool {
    // STATUS_CONTROL_C_EXIT.
    status.code() == Some(0xC000_013A_u32 as i32)
}

/// How a program ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    pub(crate) last: LastLines,
}

impl Ended {
    fn reason(&self) -> String {
        self.last
            .reason()
            .unwrap_or_else(|| format!("{} without a word", self.status))
    }
}

/// The end of what a program said.
#[derive(Debug, Default)]
pub(crate) struct LastLines(VecDeque<String>);

impl LastLines {
    pub(crate) fn push(&mut self, line: String) {
        if line.trim().is_empty() {
            return;
        }
        if self.0.len() == LAST_LINES {
            self.0.pop_front();
        }
        self.0.push_back(line);
    }

    /// The last line that complains, else the last.
    pub(crate) fn reason(&self) -> Option<String> {
        const COMPLAINTS: [&str; 6] =
            ["error", "fail", "invalid", "cannot", "could not", "no such"];
        let complains = |line: &&String| {
            let line = line.to_lowercase();
            COMPLAINTS.iter().any(|word| line.contains(word))
        };
        let line = self.0.iter().rev().find(complains).or(self.0.back())?;
        let text = without_log_prefix(line.trim());
        let text = text.trim_start_matches("ERROR:").trim();
        Some(text.chars().take(LONGEST_REASON).collect())
    }

    /// Whether any line contains the text.
    pub(crate) fn mention(&self, text: &str) -> bool {
        self.0.iter().any(|line| line.contains(text))
    }
}

/// Without what Google's logging library puts before each message:
/// `E20260808 20:28:58.123456 12345 mapper.cc:271] `.
fn without_log_prefix(line: &str) -> &str {
    let mut letters = line.chars();
    let level = letters.next().is_some_and(|letter| "IWEF".contains(letter));
    if level
        && letters.next().is_some_and(|c| c.is_ascii_digit())
        && let Some((_, message)) = line.split_once("] ")
    {
        return message;
    }
    line
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn reason(lines: &[&str]) -> Option<String> {
        let mut last = LastLines::default();
        for line in lines {
            last.push((*line).to_owned());
        }
        last.reason()
    }

    #[test]
    fn the_last_complaint_is_the_reason() {
        assert_eq!(reason(&[" ", ""]), None);
        assert_eq!(reason(&["one", "two", ""]).as_deref(), Some("two"));
        assert_eq!(
            reason(&[
                "ERROR: Failed to parse options - unrecognised option '--foo'.",
                "bye"
            ])
            .as_deref(),
            Some("Failed to parse options - unrecognised option '--foo'.")
        );
        assert_eq!(
            reason(&["E20260808 20:28:58.123456 12345 mapper.cc:271] Check failed: x > 0"])
                .as_deref(),
            Some("Check failed: x > 0")
        );
        assert_eq!(reason(&["In [3] there"]).as_deref(), Some("In [3] there"));
        assert_eq!(
            reason(&["fail ".repeat(200).as_str()]).unwrap().len(),
            LONGEST_REASON
        );
    }

    #[test]
    fn a_program_that_is_not_there_says_how_to_get_it() {
        let error = Program::find("no-such-program-anywhere", "build one").unwrap_err();
        let said = "the program no-such-program-anywhere was not found on the PATH; build one";
        assert_eq!(error.to_string(), said);
        let error = Program::at(Path::new("/no/such")).ask(&[]).unwrap_err();
        assert!(error.to_string().starts_with("cannot start /no/such"));
    }
}
