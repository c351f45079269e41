//! What a person sees while a run goes on, and how they stop it.
//!
//! On a terminal a bar with the time left; elsewhere, as in a log file, a line every ten seconds;
//! with `--quiet` nothing. All of it goes to standard error.

use crate::live::Live;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);
/// Time that an estimate of the rest must be based on.
const LEAST_BASIS: Duration = Duration::from_millis(500);
/// The bar is redrawn at most this often a second.
const DRAWS_PER_SECOND: u8 = 5;
const TEMPLATE: &str = "{prefix} {bar:24} {pos}/{len}  {wide_msg}";

/// The state of training, as far as it is worth a person's attention.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgressState {
    /// Steps done.
    pub step: u32,
    /// Of recent rays, in dB.
    pub psnr: f32,
    /// Mean change of the mattes since they were last looked at, 0..1; `None` between two looks.
    pub alpha_change: Option<f32>,
    /// Samples of both fields per second.
    pub samples_per_second: f32,
}

/// Shows how training goes.
#[derive(Debug)]
pub struct Progress {
    mode: Mode,
    steps: u32,
    training: Mutex<Training>,
    live: Option<Arc<Live>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Silent,
    Bar,
    Lines,
}

#[derive(Debug, Default)]
struct Training {
    meter: Option<Meter>,
    /// The last one looked at.
    alpha_change: Option<f32>,
}

impl Progress {
    /// Silent if `quiet`, else a bar on a terminal and lines elsewhere. `steps` are those of the
    /// whole run.
    #[must_use]
    pub fn new(quiet: bool, steps: u32) -> Self {
        let mode = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => Mode::Silent,
            (false, true) => Mode::Bar,
            (false, false) => Mode::Lines,
        };
        Self {
            mode,
            steps,
            training: Mutex::default(),
            live: None,
        }
    }

    /// Shows the same on a page.
    #[must_use]
    pub fn shown_on(self, live: Option<Arc<Live>>) -> Self {
        Self { live, ..self }
    }

    /// Says how many steps are done, where nothing else is known of them yet.
    pub fn tick(&self, step: u32) {
        if let Some(meter) = &mut lock(&self.training).meter {
            meter.tick(u64::from(step));
        }
    }

    /// Shows the state of training.
    pub fn update(&self, state: &ProgressState) {
        let mut training = lock(&self.training);
        training.alpha_change = state.alpha_change.or(training.alpha_change);
        let mut parts = vec![format!("PSNR {:.1} dB", state.psnr)];
        if let Some(change) = training.alpha_change {
            parts.push(format!("alpha change {:.2} %", 100.0 * change));
        }
        parts.push(format!("{} samples/s", short(state.samples_per_second)));
        let (done, total) = (u64::from(state.step), u64::from(self.steps));
        let meter = training
            .meter
            .get_or_insert_with(|| self.training_meter(done));
        meter.show(done, &parts);
        if done >= total {
            training.meter = None;
        }
    }

    /// Begins training, or goes on with it at `step`: what is said of its time counts from here.
    pub fn begin(&self, step: u32) {
        lock(&self.training).meter = Some(self.training_meter(u64::from(step)));
    }

    fn training_meter(&self, done: u64) -> Meter {
        let total = u64::from(self.steps);
        Meter::new(self.mode, "training", done, total, self.live.clone())
    }

    /// Says something without disturbing the bar; nothing if quiet.
    pub fn note(&self, text: &str) {
        if let Some(live) = &self.live {
            live.note(text);
        }
        if self.mode != Mode::Silent {
            self.print(text);
        }
    }

    /// Says something that matters even if quiet.
    pub fn warn(&self, text: &str) {
        self.print(&format!("warning: {text}"));
    }

    /// Begins a stage of `parts` parts other than training; it ends when it is dropped.
    #[must_use]
    pub fn stage(&self, label: &str, parts: usize) -> Stage {
        lock(&self.training).meter = None;
        Stage(Mutex::new(Meter::new(
            self.mode,
            label,
            0,
            parts as u64,
            self.live.clone(),
        )))
    }

    fn print(&self, text: &str) {
        match &lock(&self.training).meter {
            Some(meter) => meter.bar.suspend(|| line(text)),
            None => line(text),
        }
    }
}

/// A stage of a run other than training. Can be shared between threads.
#[derive(Debug)]
pub struct Stage(Mutex<Meter>);

impl Stage {
    /// Counts one more part as done.
    pub fn advance(&self) {
        let mut meter = lock(&self.0);
        let done = meter.done + 1;
        meter.show(done, &[]);
    }

    /// Says how many parts are done.
    pub fn reach(&self, done: usize) {
        lock(&self.0).show(done as u64, &[]);
    }
}

/// How far something is. When dropped, it leaves a line with the time it took.
#[derive(Debug)]
struct Meter {
    mode: Mode,
    label: String,
    bar: ProgressBar,
    /// Where this session started: a resumed run has not done the rest now.
    first: u64,
    done: u64,
    total: u64,
    begun: Instant,
    last_line: Option<Instant>,
    /// What was said last beside the position.
    parts: Vec<String>,
    live: Option<Arc<Live>>,
}

impl Meter {
    fn new(mode: Mode, label: &str, first: u64, total: u64, live: Option<Arc<Live>>) -> Self {
        if let Some(live) = &live {
            live.stage(label, first, total, None);
        }
        let bar = if mode == Mode::Bar {
            let target = ProgressDrawTarget::stderr_with_hz(DRAWS_PER_SECOND);
            let bar = ProgressBar::with_draw_target(Some(total), target);
            // A test makes sure that the template is valid.
            let style = ProgressStyle::with_template(TEMPLATE)
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style.progress_chars("━╸─"));
            bar.set_prefix(label.to_owned());
            bar.set_position(first);
            bar
        } else {
            ProgressBar::hidden()
        };
        Self {
            mode,
            label: label.to_owned(),
            bar,
            first,
            done: first,
            total,
            begun: Instant::now(),
            last_line: None,
            parts: Vec::new(),
            live,
        }
    }

    fn show(&mut self, done: u64, parts: &[String]) {
        self.done = done;
        self.parts = parts.to_vec();
        let left = self.left();
        if let Some(live) = &self.live {
            live.stage(&self.label, done, self.total, left.clone());
        }
        let parts: Vec<&str> = left.iter().chain(parts).map(String::as_str).collect();
        match self.mode {
            Mode::Silent => {}
            Mode::Bar => {
                self.bar.set_position(done);
                self.bar.set_message(parts.join(", "));
            }
            Mode::Lines => {
                if self
                    .last_line
                    .is_none_or(|last| last.elapsed() >= LINE_EVERY)
                {
                    self.last_line = Some(Instant::now());
                    let count = format!("{} {done}/{}", self.label, self.total);
                    line(&[&[count.as_str()], parts.as_slice()].concat().join(", "));
                }
            }
        }
    }

    /// The same where nothing else is new: what was said beside the position still holds. A line comes where the last one
    /// is long ago.
    fn tick(&mut self, done: u64) {
        self.done = done;
        match self.mode {
            Mode::Silent => {}
            Mode::Bar => self.bar.set_position(done),
            Mode::Lines => {
                if self.last_line.unwrap_or(self.begun).elapsed() >= LINE_EVERY {
                    let parts = std::mem::take(&mut self.parts);
                    self.show(done, &parts);
                }
            }
        }
    }

    /// "4 min 10 s left", once there is something to go by.
    fn left(&self) -> Option<String> {
        let done = self.done.checked_sub(self.first).filter(|done| *done > 0)?;
        let elapsed = self.begun.elapsed();
        // The first part's number may come before its work.
        if elapsed < LEAST_BASIS {
            return None;
        }
        let seconds =
            elapsed.as_secs_f64() / done as f64 * self.total.saturating_sub(self.done) as f64;
        Some(format!(
            "{} left",
            duration(Duration::try_from_secs_f64(seconds).ok()?)
        ))
    }
}

impl Drop for Meter {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if self.mode != Mode::Silent {
            let time = duration(self.begun.elapsed());
            line(&format!(
                "{} {}/{}, {time}",
                self.label, self.done, self.total
            ));
        }
    }
}

/// What the first Ctrl-C leads to from now on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtInterrupt {
    /// The program ends at once, and folders that it is writing are gone.
    End,
    /// What has been done so far is dropped.
    LeaveNothing,
    /// Training ends with a checkpoint.
    SaveCheckpoint,
}

/// What the first Ctrl-C leads to.
static FIRST: Mutex<AtInterrupt> = Mutex::new(AtInterrupt::End);
/// Whether the program is about to end, and whatever goes wrong on the way is because of that.
static ENDING: AtomicBool = AtomicBool::new(false);

impl AtInterrupt {
    /// Has the first Ctrl-C announce this from now on.
    pub(crate) fn announce(self) {
        *lock(&FIRST) = self;
    }
}

/// Waits for the end if the program is about to end.
pub(crate) fn await_ending() {
    while ENDING.load(Ordering::SeqCst) {
        std::thread::park();
    }
}

fn end() -> ! {
    ENDING.store(true, Ordering::SeqCst);
    draft_folder::abandon_all();
    std::process::exit(i32::from(crate::error::EXIT_INTERRUPTED));
}

/// A flag that the first Ctrl-C (or SIGTERM) sets, unless the program ends by that; the second ends it. It is the same for
/// every call in a process.
///
/// # Errors
/// If the system refuses, or another handler is installed already.
pub fn watch_interrupt(then: AtInterrupt) -> Result<Arc<AtomicBool>, ctrlc::Error> {
    static FLAG: Mutex<Option<Arc<AtomicBool>>> = Mutex::new(None);
    then.announce();
    let mut known = lock(&FLAG);
    if let Some(flag) = &*known {
        return Ok(Arc::clone(flag));
    }
    let flag = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&flag);
    ctrlc::set_handler(move || {
        let first = *lock(&FIRST);
        if set.swap(true, Ordering::SeqCst) {
            if first == AtInterrupt::SaveCheckpoint {
                line("stopped at once; the run is as of its last checkpoint");
            }
            end();
        }
        match first {
            AtInterrupt::End => {
                line("stopped");
                end();
            }
            AtInterrupt::LeaveNothing => line("stopping; nothing is kept"),
            AtInterrupt::SaveCheckpoint => line(
                "stopping after this step, which takes up to a minute where the object is carved out, and saving a checkpoint; \
                 Ctrl-C again stops at once",
            ),
        }
    })?;
    *known = Some(Arc::clone(&flag));
    Ok(flag)
}

/// A time as a person says it.
#[must_use]
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    let whole = seconds.round() as u64;
    match whole {
        0..10 => format!("{seconds:.1} s"),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

/// 1.2 M, 350 k.
pub(crate) fn short(value: f32) -> String {
    match value {
        v if v >= 1e6 => format!("{:.1} M", v / 1e6),
        v if v >= 1e3 => format!("{:.0} k", v / 1e3),
        v => format!("{v:.0}"),
    }
}

/// A closed standard error is no reason to stop a run.
fn line(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_rates_read_well() {
        for (seconds, text) in [
            (0.04, "0.0 s"),
            (9.4, "9.4 s"),
            (59.4, "59 s"),
            (59.6, "1 min 00 s"),
            (250.0, "4 min 10 s"),
            (3700.0, "1 h 01 min"),
        ] {
            assert_eq!(duration(Duration::from_secs_f64(seconds)), text);
        }
        assert_eq!(short(1_234_567.0), "1.2 M");
        assert_eq!(short(350_000.0), "350 k");
    }

    #[test]
    fn the_template_is_valid() {
        assert!(ProgressStyle::with_template(TEMPLATE).is_ok());
    }

    #[test]
    fn a_resumed_run_judges_the_time_left_by_this_session() {
        let mut meter = Meter::new(Mode::Silent, "training", 900, 1000, None);
        assert_eq!(meter.left(), None);
        meter.begun -= Duration::from_secs(10);
        meter.done = 910;
        assert_eq!(meter.left().as_deref(), Some("1 min 30 s left"));
    }
}
