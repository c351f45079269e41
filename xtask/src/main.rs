//! The commands of this workspace, `cargo xtask TASK`: each hands over to cargo or to one of the
//! workspace's programs. Everything after the task's name goes to that program unchanged.
//!
//! - `task.rs`: which tasks there are and how a command line names one;
//! - `cargo.rs`: the command line that a task stands for;
//! - `check.rs`: the checks that come before the tests, cheapest first;
//! - `process.rs`: running a command so that Ctrl-C and exit codes arrive.
//!
//! The working directory stays the user's, so that paths mean what they say: cargo is told where the
//! workspace is.

mod cargo;
mod check;
mod process;
mod task;

use std::{env, ffi::OsString, process::ExitCode};

use cargo::Workspace;
use task::{HELP, Request, Task};

fn main() -> ExitCode {
    let workspace = Workspace::of_this_program();
    match task::parse(env::args_os().skip(1)) {
        Ok(Request::Help) => {
            println!("{HELP}");
            ExitCode::SUCCESS
        }
        Ok(Request::Run(Task::Check, arguments)) => match refuse_arguments("check", &arguments) {
            Some(refusal) => refusal,
            None => check::run(&workspace),
        },
        Ok(Request::Run(Task::Ci, arguments)) => match refuse_arguments("ci", &arguments) {
            Some(refusal) => refusal,
            None => ci(&workspace),
        },
        Ok(Request::Run(task, arguments)) => match workspace.run(task, arguments) {
            Ok(command) => process::become_command(command),
            Err(refusal) => usage_error(&refusal),
        },
        Err(error) => usage_error(&format!("{error}\n\n{HELP}")),
    }
}

/// All that a change must pass: the checks, then the tests.
fn ci(workspace: &Workspace) -> ExitCode {
    let checked = check::run(workspace);
    if checked != ExitCode::SUCCESS {
        return checked;
    }
    match workspace.run(Task::Test, Vec::new()) {
        Ok(command) => process::become_command(command),
        Err(refusal) => usage_error(&refusal),
    }
}

/// Tasks that run several programs have no one to pass arguments to.
fn refuse_arguments(task: &str, arguments: &[OsString]) -> Option<ExitCode> {
    let first = arguments.first()?.to_string_lossy();
    Some(usage_error(&format!(
        "`cargo xtask {task}` takes no arguments, but was given `{first}`; \
         `cargo xtask test` takes those of cargo test"
    )))
}

fn usage_error(message: &str) -> ExitCode {
    eprintln!("error: {message}");
    ExitCode::from(2)
}
