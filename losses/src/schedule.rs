//! What weight a loss, or the learning rate, has at a training step.

use serde::{Deserialize, Serialize};

/// A number that depends on the training step.
///
/// ```
/// use losses::Schedule;
///
/// // A mask loss of 0.1 until step 2000, then linearly to 0 at step 6000.
/// let mask = Schedule::RampToZero { value: 0.1, from: 2000, to: 6000 };
/// assert_eq!(mask.at(1000), 0.1);
/// assert!((mask.at(4000) - 0.05).abs() < 1e-12);
/// assert_eq!(mask.at(7000), 0.0);
///
/// // A learning rate of 0.01 after 500 steps of warm-up, then exponentially to 10 % at the end.
/// let rate = Schedule::WarmUpDecay { peak: 0.01, warm_up: 500, end: 20_000, final_ratio: 0.1 };
/// assert!((rate.at(249) - 0.005).abs() < 1e-12);
/// assert!((rate.at(20_000) - 0.001).abs() < 1e-12);
/// ```
///
/// In a configuration file:
///
/// ```
/// # use losses::Schedule;
/// let text = r#"{"kind": "ramp-to-zero", "value": 0.1, "from": 2000, "to": 6000}"#;
/// let read: Schedule = serde_json::from_str(text).expect("a schedule");
/// assert_eq!(read, Schedule::RampToZero { value: 0.1, from: 2000, to: 6000 });
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Schedule {
    /// The same at every step.
    Constant {
        /// The number.
        value: f64,
    },
    /// `value` up to step `from`, then linearly down to 0 at step `to`, and 0 from there on.
    RampToZero {
        /// The number before the ramp.
        value: f64,
        /// The last step with the full value.
        from: u64,
        /// The first step with 0. At or before `from`, the value drops to 0 after `from`.
        to: u64,
    },
    /// Linearly up to `peak` within `warm_up` steps, then
    /// `peak * final_ratio ^ ((step - warm_up) / (end - warm_up))`, and the last value after `end`.
    ///
    /// The step number `i` of the warm-up has `peak (i + 1) / warm_up`: the very first is not wasted.
    WarmUpDecay {
        /// The largest value, reached at the end of the warm-up.
        peak: f64,
        /// The number of steps of the warm-up; 0 for none.
        warm_up: u64,
        /// The step at which the decay is complete.
        end: u64,
        /// The final value over the peak; positive.
        final_ratio: f64,
    },
    /// Straight lines between knots; constant before the first and after the last.
    PiecewiseLinear {
        /// Where the lines meet.
        knots: Knots,
    },
}

/// A corner of [`Schedule::PiecewiseLinear`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Knot {
    /// The training step.
    pub step: u64,
    /// The value at that step.
    pub value: f64,
}

/// At least one [`Knot`], at increasing steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Knot>", into = "Vec<Knot>")]
pub struct Knots(Vec<Knot>);

/// Why knots make no schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScheduleError {
    /// There are none.
    #[error("a piecewise linear schedule needs at least one knot")]
    NoKnots,
    /// Steps do not increase.
    #[error("knots must be at increasing steps, but step {next} follows step {previous}")]
    Unordered {
        /// A step.
        previous: u64,
        /// The step after it, which is not larger.
        next: u64,
    },
}

impl Schedule {
    /// The value at `step`, counted from 0.
    pub fn at(&self, step: u64) -> f64 {
        match *self {
            Self::Constant { value } => value,
            Self::RampToZero { value, from, to } => {
                let start = Knot { step: from, value };
                if step <= from {
                    value
                } else {
                    between(
                        start,
                        Knot {
                            step: to,
                            value: 0.0,
                        },
                        step,
                    )
                }
            }
            Self::WarmUpDecay {
                peak,
                warm_up,
                end,
                final_ratio,
            } => {
                if step < warm_up {
                    peak * (step + 1) as f64 / warm_up as f64
                } else {
                    peak * final_ratio.powf(progress(warm_up, end, step))
                }
            }
            Self::PiecewiseLinear { ref knots } => knots.at(step),
        }
    }

    /// The same schedule for a run that is `factor` times as long: every step number is multiplied.
    ///
    /// Knots that fall on one step after rounding are merged; the later one counts.
    #[must_use]
    pub fn stretched(&self, factor: f64) -> Self {
        let stretch = |step: u64| (step as f64 * factor).round() as u64;
        match self.clone() {
            Self::Constant { value } => Self::Constant { value },
            Self::RampToZero { value, from, to } => Self::RampToZero {
                value,
                from: stretch(from),
                to: stretch(to),
            },
            Self::WarmUpDecay {
                peak,
                warm_up,
                end,
                final_ratio,
            } => Self::WarmUpDecay {
                peak,
                warm_up: stretch(warm_up),
                end: stretch(end),
                final_ratio,
            },
            Self::PiecewiseLinear {
                knots: Knots(mut knots),
            } => {
                knots
                    .iter_mut()
                    .for_each(|knot| knot.step = stretch(knot.step));
                knots.dedup_by(|later, kept| {
                    let same = later.step == kept.step;
                    if same {
                        *kept = *later;
                    }
                    same
                });
                Self::PiecewiseLinear {
                    knots: Knots(knots),
                }
            }
        }
    }
}

impl Knots {
    /// Checks that there is a knot and that steps increase.
    ///
    /// ```
    /// use losses::{Knot, Knots, Schedule};
    ///
    /// let knots = Knots::new(vec![Knot { step: 100, value: 0.0 }, Knot { step: 300, value: 1.0 }])?;
    /// assert_eq!(Schedule::PiecewiseLinear { knots }.at(150), 0.25);
    /// # Ok::<(), losses::ScheduleError>(())
    /// ```
    pub fn new(knots: Vec<Knot>) -> Result<Self, ScheduleError> {
        if knots.is_empty() {
            return Err(ScheduleError::NoKnots);
        }
        match knots.windows(2).find(|pair| pair[0].step >= pair[1].step) {
            Some(pair) => Err(ScheduleError::Unordered {
                previous: pair[0].step,
                next: pair[1].step,
            }),
            None => Ok(Self(knots)),
        }
    }

    /// The knots, in order.
    pub fn as_slice(&self) -> &[Knot] {
        &self.0
    }

    fn at(&self, step: u64) -> f64 {
        let after = self.0.partition_point(|knot| knot.step <= step);
        match (after.checked_sub(1), self.0.get(after)) {
            (Some(before), Some(&end)) => between(self.0[before], end, step),
            (Some(before), None) => self.0[before].value,
            (None, first) => first.map_or(0.0, |knot| knot.value),
        }
    }
}

impl TryFrom<Vec<Knot>> for Knots {
    type Error = ScheduleError;

    fn try_from(knots: Vec<Knot>) -> Result<Self, ScheduleError> {
        Self::new(knots)
    }
}

impl From<Knots> for Vec<Knot> {
    fn from(knots: Knots) -> Self {
        knots.0
    }
}

/// The value on the line from `start` to `end`, and that of `end` beyond it.
fn between(start: Knot, end: Knot, step: u64) -> f64 {
    let t = progress(start.step, end.step, step);
    start.value * (1.0 - t) + end.value * t
}

/// How far `step` has come from `start` to `end`, in [0, 1]; 1 where the way has no length.
fn progress(start: u64, end: u64, step: u64) -> f64 {
    if step >= end {
        1.0
    } else {
        step.saturating_sub(start) as f64 / (end - start) as f64
    }
}
