//! Running a command so that Ctrl-C and exit codes arrive.

use std::{
    env,
    process::{Command, ExitCode},
};

use crate::cargo::CommandLine;

/// Says what is run, then becomes it: Ctrl-C and the exit code are the command's own.
///
/// Where a process cannot become another (not on Unix), waits for it and hands its code through.
pub(crate) fn become_command(line: CommandLine) -> ExitCode {
    announce(&line);
    let mut command = command(&line);
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        not_started(&line, &command.exec())
    }
    #[cfg(not(unix))]
    match command.status() {
        Ok(status) => exit_code(status),
        Err(error) => not_started(&line, &error),
    }
}

/// Says what is run, runs it to its end and gives its exit code.
pub(crate) fn wait_for(line: &CommandLine) -> ExitCode {
    announce(line);
    match command(line).status() {
        Ok(status) => exit_code(status),
        Err(error) => not_started(line, &error),
    }
}

/// Whether a program of that name is on the path.
pub(crate) fn is_installed(program: &str) -> bool {
    let file = format!("{program}{}", env::consts::EXE_SUFFIX);
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path).any(|folder| folder.join(&file).is_file())
}

fn command(line: &CommandLine) -> Command {
    let mut command = Command::new(&line.program);
    command
        .args(&line.arguments)
        .envs(line.environment.iter().copied());
    command
}

fn announce(line: &CommandLine) {
    eprintln!("> {}", shown(line));
}

/// The command line as one would type it; arguments with spaces are quoted.
fn shown(line: &CommandLine) -> String {
    let program = std::path::Path::new(&line.program)
        .file_stem()
        .unwrap_or(&line.program);
    let settings = line
        .environment
        .iter()
        .map(|(name, value)| format!("{name}={}", quoted(value)));
    let words = line
        .arguments
        .iter()
        .map(|argument| quoted(&argument.to_string_lossy()));
    let program = program.to_string_lossy().into_owned();
    settings
        .chain([program])
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}

fn quoted(text: &str) -> String {
    let plain = !text.is_empty() && !text.contains(|c: char| c.is_whitespace() || c == '"');
    if plain {
        text.to_owned()
    } else {
        format!("{text:?}")
    }
}

/// The child's exit code; 1 when a signal ended it.
fn exit_code(status: std::process::ExitStatus) -> ExitCode {
    match status.code() {
        Some(code) => ExitCode::from(u8::try_from(code).unwrap_or(1)),
        None => ExitCode::FAILURE,
    }
}

fn not_started(line: &CommandLine, error: &std::io::Error) -> ExitCode {
    eprintln!(
        "error: cannot start `{}`: {error}",
        line.program.to_string_lossy()
    );
    ExitCode::FAILURE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_shown_as_typed() {
        let mut line = CommandLine::new("/opt/rust/bin/cargo", &["doc", "my scene", ""]);
        line.environment.push(("RUSTDOCFLAGS", "-D warnings"));
        assert_eq!(
            shown(&line),
            r#"RUSTDOCFLAGS="-D warnings" cargo doc "my scene" """#
        );
    }

    #[test]
    fn a_program_that_is_not_there_is_not_installed() {
        assert!(!is_installed("no-program-has-this-name"));
    }

    #[cfg(unix)]
    #[test]
    fn the_exit_code_is_handed_through() {
        let code = |text| wait_for(&CommandLine::new("sh", &["-c", text]));
        assert_eq!(code("exit 0"), ExitCode::SUCCESS);
        assert_eq!(code("exit 7"), ExitCode::from(7));
        assert_eq!(code("kill -9 $$"), ExitCode::FAILURE);
        assert_eq!(
            wait_for(&CommandLine::new("/no/such/program", &[])),
            ExitCode::FAILURE
        );
    }
}
