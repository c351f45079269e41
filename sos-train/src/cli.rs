//! The program `sos`: what it is asked, what it answers, how it ends.
//!
//! Results go to standard output; notes, progress and errors to standard error. The exit code is 0,
//! 2 for input that cannot be used (one sentence with the file and the remedy), 3 where a check of
//! `sos doctor` failed, 130 after Ctrl-C, and 1 for a fault in here.

mod ablate;
mod answer;
mod args;
mod capture;
mod degrade;
mod doctor;
mod evaluate;
mod export;
mod hull;
mod import;
mod input;
mod kept_run;
mod manual;
mod render;
mod results;
mod resumed;
mod train;

pub use args::{
    AblateArgs, CaptureArgs, Command, CompareArgs, DegradeArgs, DoctorArgs, EvalArgs, ExportArgs,
    HullArgs, ImportArgs, RenderArgs, ReportArgs, ResultsArgs, SettingArgs, Sos, TableArgs,
    TrainArgs,
};

use crate::devices::Devices;
use crate::error::{EXIT_INTERNAL, EXIT_OK, exit_code, sentence};
use crate::progress::{AtInterrupt, await_ending, watch_interrupt};
use answer::Voice;
use clap::Parser as _;
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

/// What the last panic said, and where.
static PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Runs the program with the process's arguments.
#[must_use]
pub fn run() -> ExitCode {
    let Sos { command, .. } = Sos::parse();
    catch_panics();
    // Where the system refuses, Ctrl-C ends the program as it always does.
    let _ = watch_interrupt(AtInterrupt::End);
    // Nothing is used after a panic but the message.
    let code = match catch_unwind(AssertUnwindSafe(|| execute(&command))) {
        Ok(Ok(code)) => code,
        Ok(Err(error)) => {
            await_ending();
            let code = exit_code(&error);
            let text = sentence(&error);
            complain(&if code == EXIT_INTERNAL {
                bug(&text)
            } else {
                text
            });
            code
        }
        Err(_) => {
            let said = PANIC.lock().unwrap_or_else(PoisonError::into_inner).take();
            complain(&bug(said.as_deref().unwrap_or("no reason given")));
            EXIT_INTERNAL
        }
    };
    ExitCode::from(code)
}

fn execute(command: &Command) -> anyhow::Result<u8> {
    match command {
        Command::Train(args) => train::train(args),
        Command::Import(args) => import::import(args).map(|()| EXIT_OK),
        Command::Capture(args) => capture::capture(args).map(|()| EXIT_OK),
        Command::Doctor(args) => doctor::doctor(args),
        Command::Export(args) => export::export(args).map(|()| EXIT_OK),
        Command::Render(args) => render::render(args),
        Command::Eval(args) => evaluate::eval(args).map(|()| EXIT_OK),
        Command::Compare(args) => evaluate::compare(args).map(|()| EXIT_OK),
        Command::Hull(args) => hull::write(args).map(|()| EXIT_OK),
        Command::Degrade(args) => degrade::write(args).map(|()| EXIT_OK),
        Command::Ablate(args) => ablate::ablate(args),
        Command::Results(args) => results::results(args),
        Command::Report(args) => evaluate::report(args).map(|()| EXIT_OK),
        Command::Devices { json } => devices(*json).map(|()| EXIT_OK),
        Command::Completions { shell } => manual::completions(*shell).map(|()| EXIT_OK),
        Command::Man { out } => manual::pages(out.as_deref()).map(|()| EXIT_OK),
        Command::DemoScene { out, json } => input::write_demo(out, *json).map(|()| EXIT_OK),
    }
}

fn devices(json: bool) -> anyhow::Result<()> {
    let devices = Devices::find();
    Voice::of(json, false).answer(&devices, &devices.to_string())
}

/// Keeps panics off the screen: `run` reports them. With RUST_BACKTRACE they are shown as usual
/// too.
fn catch_panics() {
    let usual = take_hook();
    set_hook(Box::new(move |info| {
        let place = info
            .location()
            .map(|at| format!(" at {}:{}", at.file(), at.line()));
        let what = info.payload_as_str().unwrap_or("no reason given");
        let text = what.split_whitespace().collect::<Vec<_>>().join(" ");
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) =
            Some(format!("{text}{}", place.unwrap_or_default()));
        if std::env::var_os("RUST_BACKTRACE").is_some() {
            usual(info);
        }
    }));
}

fn bug(what: &str) -> String {
    format!(
        "internal fault ({what}); please report it at {}/issues with the command and the run's log.jsonl",
        env!("CARGO_PKG_REPOSITORY")
    )
}

fn complain(text: &str) {
    let _ = writeln!(std::io::stderr(), "error: {text}");
}

/// The command as the user types it; a wrapper such as `cargo xtask` says how it was called.
fn program() -> String {
    std::env::var("SOS_INVOKED_AS").unwrap_or_else(|_| "sos".to_owned())
}

/// The same for commands that a wrapper has no task of its own for: it takes them after `sos`.
fn whole_program() -> String {
    std::env::var("SOS_INVOKED_AS").map_or_else(|_| "sos".to_owned(), |name| name + " sos")
}
