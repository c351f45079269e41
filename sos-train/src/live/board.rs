//! The board between a run and its page.

use crate::export::LogRecord;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Somebody looks if the page asked for something as recently.
const LOOKING: Duration = Duration::from_secs(5);
/// A picture is drawn at the earliest after this many times the time that the last one took.
const PATIENCE: u32 = 5;
/// Views that can be looked at together.
const MOST_WANTED: usize = 12;
/// Notes that are kept.
const MOST_NOTES: usize = 100;

/// A view, as the page lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveView {
    /// The photo's name.
    pub name: String,
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Whether it has a start mask.
    pub masked: bool,
}

/// What a run is asked to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// Train on.
    GoOn,
    /// Wait.
    Pause,
    /// Save a checkpoint and end.
    Stop,
    /// Go straight to the final pictures.
    Finish,
}

/// What a run is doing and what it is asked to do; shared between its thread and the server's.
#[derive(Debug)]
pub struct Live {
    state: Mutex<State>,
    interrupt: Arc<AtomicBool>,
    paused: AtomicBool,
    finish: AtomicBool,
}

#[derive(Debug, Default)]
struct State {
    run: String,
    steps: u32,
    step: u32,
    stage: Option<StageState>,
    /// Whether there is an object by now that final pictures could show.
    may_finish: bool,
    views: Vec<LiveView>,
    records: Vec<Map<String, Value>>,
    notes: Vec<String>,
    pictures: BTreeMap<usize, Drawn>,
    wanted: Vec<usize>,
    looked: Option<Instant>,
    /// When a picture was last finished, and how long it took.
    drew: Option<(Instant, Duration)>,
}

#[derive(Debug)]
struct StageState {
    label: String,
    done: u64,
    total: u64,
    left: Option<String>,
}

#[derive(Debug)]
struct Drawn {
    step: u32,
    jpeg: Arc<Vec<u8>>,
}

impl Live {
    /// A board for the run in the folder `run`, of which the page says so; `interrupt` is what Ctrl-C
    /// sets too.
    #[must_use]
    pub fn new(run: String, interrupt: Arc<AtomicBool>) -> Self {
        Self {
            state: Mutex::new(State {
                run,
                ..State::default()
            }),
            interrupt,
            paused: AtomicBool::new(false),
            finish: AtomicBool::new(false),
        }
    }

    /// What the run is asked to do now.
    #[must_use]
    pub fn wish(&self) -> Wish {
        if self.interrupt.load(Ordering::Relaxed) {
            Wish::Stop
        } else if self.finish.load(Ordering::Relaxed) {
            Wish::Finish
        } else if self.paused.load(Ordering::Relaxed) {
            Wish::Pause
        } else {
            Wish::GoOn
        }
    }

    /// Asks the run for something. `false` if that is not possible now.
    pub fn ask(&self, wish: Wish) -> bool {
        match wish {
            Wish::GoOn => self.paused.store(false, Ordering::Relaxed),
            Wish::Pause => self.paused.store(true, Ordering::Relaxed),
            Wish::Stop => self.interrupt.store(true, Ordering::SeqCst),
            Wish::Finish => {
                if !self.state().may_finish {
                    return false;
                }
                self.finish.store(true, Ordering::Relaxed);
            }
        }
        true
    }

    /// States what the run has to go by: its views, all steps, and the log so far of a resumed run.
    pub fn introduce(&self, views: Vec<LiveView>, steps: u32, log: Vec<Map<String, Value>>) {
        let mut state = self.state();
        state.wanted = spread(views.len(), 3);
        state.views = views;
        state.steps = steps;
        state.records = log;
    }

    /// States what is being done, and how far that is.
    pub fn stage(&self, label: &str, done: u64, total: u64, left: Option<String>) {
        self.state().stage = Some(StageState {
            label: label.to_owned(),
            done,
            total,
            left,
        });
    }

    /// Adds a line to the log.
    pub fn record(&self, record: &LogRecord) {
        if let Ok(Value::Object(line)) = serde_json::to_value(record) {
            self.state().records.push(line);
        }
    }

    /// Adds a sentence.
    pub fn note(&self, text: &str) {
        let mut state = self.state();
        if state.notes.len() < MOST_NOTES {
            state.notes.push(text.to_owned());
        }
    }

    /// States how far training is, and whether there is an object that final pictures could show.
    pub(crate) fn at_step(&self, step: u32, may_finish: bool) {
        let mut state = self.state();
        state.step = step;
        state.may_finish = may_finish;
    }

    /// The view to draw now, if somebody waits for one.
    pub(crate) fn next_picture(&self) -> Option<usize> {
        let state = self.state();
        let looking = state.looked.is_some_and(|at| at.elapsed() < LOOKING);
        let rested = state
            .drew
            .is_none_or(|(at, took)| at.elapsed() >= took * PATIENCE);
        if !looking || !rested {
            return None;
        }
        let age = |view: usize| state.pictures.get(&view).map(|drawn| drawn.step);
        let oldest = state.wanted.iter().copied().min_by_key(|&view| age(view))?;
        (age(oldest) != Some(state.step)).then_some(oldest)
    }

    /// Shows a picture of a view.
    pub(crate) fn show(&self, view: usize, step: u32, jpeg: Vec<u8>, took: Duration) {
        let mut state = self.state();
        state.drew = Some((Instant::now(), took));
        let jpeg = Arc::new(jpeg);
        state.pictures.insert(view, Drawn { step, jpeg });
    }

    /// Somebody looks, at these views if any are given. What the page shows.
    pub(super) fn look(&self, views: &[usize]) -> Value {
        let wish = self.wish();
        let mut state = self.state();
        state.looked = Some(Instant::now());
        let count = state.views.len();
        let wanted: Vec<usize> = views.iter().copied().filter(|v| *v < count).collect();
        if !wanted.is_empty() {
            state.wanted = wanted;
            state.wanted.truncate(MOST_WANTED);
        }
        let last = state.records.iter().rev().find(|r| r.contains_key("psnr"));
        let known = |key: &str| last.and_then(|record| record.get(key)).cloned();
        json!({
            "run": state.run,
            "step": state.step,
            "steps": state.steps,
            "stage": state.stage.as_ref().map(|stage| json!({
                "label": stage.label, "done": stage.done, "total": stage.total, "left": stage.left,
            })),
            "wish": match wish {
                Wish::GoOn => "go on",
                Wish::Pause => "pause",
                Wish::Stop => "stop",
                Wish::Finish => "finish",
            },
            "may_finish": state.may_finish,
            "psnr": known("psnr"),
            "samples_per_second": known("samples_per_second"),
            "alpha_change": state.records.iter().rev()
                .find_map(|r| r.get("alpha_change").filter(|v| !v.is_null())),
            "records": state.records.len(),
            "wanted": state.wanted,
            "pictures": state.pictures.iter()
                .map(|(view, drawn)| (view.to_string(), Value::from(drawn.step)))
                .collect::<Map<_, _>>(),
            "views": state.views.iter().map(|view| json!({
                "name": view.name, "width": view.width, "height": view.height, "masked": view.masked,
            })).collect::<Vec<_>>(),
            "notes": state.notes,
        })
    }

    /// The curves as SVG.
    pub(super) fn curves(&self) -> String {
        // Drawn without the lock: training does not wait for it.
        let records = self.state().records.clone();
        crate::report::plots(&records)
    }

    /// A view's picture, as a JPEG file.
    pub(super) fn picture(&self, view: usize) -> Option<Arc<Vec<u8>>> {
        let state = self.state();
        Some(Arc::clone(&state.pictures.get(&view)?.jpeg))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// `wanted` of `count`, evenly spread.
fn spread(count: usize, wanted: usize) -> Vec<usize> {
    let wanted = wanted.min(count);
    (0..wanted).map(|i| i * count / wanted).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn live() -> Live {
        let live = Live::new("runs/x".to_owned(), Arc::new(AtomicBool::new(false)));
        let view = |i: usize| LiveView {
            name: format!("{i}.jpg"),
            width: 4,
            height: 3,
            masked: i > 0,
        };
        live.introduce((0..5).map(view).collect(), 100, Vec::new());
        live
    }

    #[test]
    fn nothing_is_drawn_for_nobody() {
        let live = live();
        live.at_step(1, false);
        assert_eq!(live.next_picture(), None);
        let _ = live.look(&[4, 2, 99]);
        assert_eq!(live.next_picture(), Some(4));
        live.show(4, 1, vec![1], Duration::ZERO);
        assert_eq!(live.next_picture(), Some(2));
        // A slow picture makes the next one wait.
        live.show(2, 1, vec![1], Duration::from_secs(60));
        live.at_step(2, false);
        assert_eq!(live.next_picture(), None);
    }

    #[test]
    fn all_views_have_their_turn_and_none_is_drawn_twice() {
        let live = live();
        let mut drawn = Vec::new();
        live.at_step(7, false);
        let _ = live.look(&[0, 1, 3]);
        while let Some(view) = live.next_picture() {
            drawn.push(view);
            live.show(view, 7, Vec::new(), Duration::ZERO);
        }
        assert_eq!(drawn, [0, 1, 3]);
    }

    #[test]
    fn wishes_are_heard() {
        let live = live();
        assert_eq!(live.wish(), Wish::GoOn);
        assert!(live.ask(Wish::Pause));
        assert_eq!(live.wish(), Wish::Pause);
        assert!(live.ask(Wish::GoOn));
        assert_eq!(live.wish(), Wish::GoOn);
        assert!(!live.ask(Wish::Finish), "there is no object yet");
        live.at_step(50, true);
        assert!(live.ask(Wish::Finish));
        assert_eq!(live.wish(), Wish::Finish);
        assert!(live.ask(Wish::Stop));
        assert_eq!(live.wish(), Wish::Stop);
        assert!(live.interrupt.load(Ordering::Relaxed));
    }
}
