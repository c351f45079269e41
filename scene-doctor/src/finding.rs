//! What a check comes back with, and all of them together.

use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;

/// How a check went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Nothing to do.
    Pass,
    /// Training works, and the result will be worse than it need be.
    Warn,
    /// Training cannot come to anything.
    Fail,
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Status::Pass => "pass",
            Status::Warn => "warn",
            Status::Fail => "FAIL",
        })
    }
}

/// The outcome of one check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The check's name, the same in every report.
    pub check: &'static str,
    /// How it went.
    pub status: Status,
    /// What was found, with numbers: a sentence without a full stop.
    pub says: String,
    /// What to do about it; none where there is nothing to do.
    pub remedy: Option<String>,
    /// What was measured, by name; units are at the end of the names.
    pub numbers: BTreeMap<&'static str, Value>,
    /// Names of the photos that it is about, worst first.
    pub photos: Vec<String>,
}

impl Finding {
    /// A check that found nothing wrong.
    #[must_use]
    pub fn pass(check: &'static str, says: impl Into<String>) -> Self {
        Self {
            check,
            status: Status::Pass,
            says: says.into(),
            remedy: None,
            numbers: BTreeMap::new(),
            photos: Vec::new(),
        }
    }

    /// The same finding as a warning, with what to do.
    #[must_use]
    pub fn warn(self, remedy: impl Into<String>) -> Self {
        Self {
            status: Status::Warn,
            remedy: Some(remedy.into()),
            ..self
        }
    }

    /// The same finding as a reason not to train, with what to do.
    #[must_use]
    pub fn fail(self, remedy: impl Into<String>) -> Self {
        Self {
            status: Status::Fail,
            remedy: Some(remedy.into()),
            ..self
        }
    }

    /// Adds a number; one that is not finite becomes null.
    #[must_use]
    pub fn number(mut self, name: &'static str, value: impl Into<Value>) -> Self {
        self.numbers.insert(name, value.into());
        self
    }

    /// Says which photos it is about.
    #[must_use]
    pub fn about(mut self, photos: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.photos = photos.into_iter().map(Into::into).collect();
        self
    }

    /// Finding and remedy in one line.
    #[must_use]
    pub fn line(&self) -> String {
        match &self.remedy {
            Some(remedy) => format!("{}: {}; {remedy}", self.check, self.says),
            None => format!("{}: {}", self.check, self.says),
        }
    }
}

/// All checks of a scene, in the order in which they are best read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The scene, as the user calls it.
    pub scene: String,
    /// The worst status of all checks.
    pub verdict: Status,
    /// One for each check that applies.
    pub checks: Vec<Finding>,
}

impl Report {
    /// Of checks that were made.
    #[must_use]
    pub fn new(scene: impl Into<String>, checks: Vec<Finding>) -> Self {
        let worst = checks.iter().map(|finding| finding.status).max();
        Self {
            scene: scene.into(),
            verdict: worst.unwrap_or(Status::Pass),
            checks,
        }
    }

    /// Adds a check that was made later.
    pub fn push(&mut self, finding: Finding) {
        self.verdict = self.verdict.max(finding.status);
        self.checks.push(finding);
    }

    /// The findings with this status.
    pub fn with(&self, status: Status) -> impl Iterator<Item = &Finding> {
        self.checks
            .iter()
            .filter(move |finding| finding.status == status)
    }

    /// The verdict as a sentence.
    #[must_use]
    pub fn summary(&self) -> String {
        let count = |status| self.with(status).count();
        let many = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        match (count(Status::Fail), count(Status::Warn)) {
            (0, 0) => "all checks passed; the scene is fit to train on".to_owned(),
            (0, warnings) => format!(
                "{}; the scene can be trained on, better after a look at {}",
                many(warnings, "warning"),
                if warnings == 1 { "it" } else { "them" }
            ),
            (failures, 0) => format!(
                "{} failed; training would come to nothing",
                many(failures, "check")
            ),
            (failures, warnings) => format!(
                "{} failed, {}; training would come to nothing",
                many(failures, "check"),
                many(warnings, "warning")
            ),
        }
    }
}

/// Up to five names, and how many more there are.
pub(crate) fn some_names(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// The middle value, of those that are not NaN; the upper one of two.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// For people: as many digits as they can use.
pub(crate) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent > 0.0 && percent < 1.0 {
        format!("{percent:.1} %")
    } else {
        format!("{percent:.0} %")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_check_is_the_verdict() {
        let mut report = Report::new("cat", vec![Finding::pass("cameras", "all is well")]);
        assert_eq!(report.verdict, Status::Pass);
        assert!(report.summary().starts_with("all checks passed"));
        report.push(Finding::pass("sharpness", "a is blurred").warn("leave it out"));
        assert_eq!(report.verdict, Status::Warn);
        assert!(report.summary().starts_with("1 warning;"));
        report.push(Finding::pass("parallax", "none").fail("move"));
        report.push(Finding::pass("x", "fine"));
        assert_eq!(report.verdict, Status::Fail);
        assert!(report.summary().starts_with("1 check failed, 1 warning;"));
        assert_eq!(
            report.checks[1].line(),
            "sharpness: a is blurred; leave it out"
        );
    }

    #[test]
    fn numbers_that_are_none_are_null() {
        let finding = Finding::pass("x", "y")
            .number("angle_deg", f64::NAN)
            .number("n", 3);
        assert_eq!(
            serde_json::to_value(&finding.numbers).unwrap_or_default()["angle_deg"],
            Value::Null
        );
        assert_eq!(finding.numbers["n"], 3);
    }

    #[test]
    fn long_lists_are_cut() {
        let names: Vec<String> = (0..7).map(|i| format!("{i}.jpg")).collect();
        assert_eq!(
            some_names(&names),
            "0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg and 2 more"
        );
        assert_eq!(some_names(&names[..1]), "0.jpg");
    }
}
