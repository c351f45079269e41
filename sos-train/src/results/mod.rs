//! What comes out of what kind of masks: a table over scenes with ground truth.
//!
//! A [`Start`] is what a run begins with. Each row sets side by side the start itself, the classical answer
//! to the same masks (their soft visual hull), and what the method made of them.

mod table;

use clap::ValueEnum as _;
use serde::{Serialize, Serializer};
use sos_eval::{AlphaScore, Fault, Report};

/// What runs begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// The rough masks that come with the scene.
    Own,
    /// The true ones with a fault.
    Fault(Fault),
    /// Photos alone.
    Nothing,
}

impl Start {
    /// All of them, in the table's order.
    pub fn every() -> impl Iterator<Item = Self> {
        let faults = Fault::ALL.into_iter().map(Self::Fault);
        std::iter::once(Self::Own)
            .chain(faults)
            .chain([Self::Nothing])
    }

    /// Its name, which is that of its folder.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Own => "own".to_owned(),
            Self::Nothing => "none".to_owned(),
            Self::Fault(fault) => fault
                .to_possible_value()
                .map_or_else(String::new, |value| value.get_name().to_owned()),
        }
    }

    /// The start of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::every().find(|start| start.name() == name)
    }

    /// What it is called in the table.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Own => "the scene's own masks",
            Self::Nothing => "no masks",
            Self::Fault(Fault::Eroded) => "eroded",
            Self::Fault(Fault::Dilated) => "dilated",
            Self::Fault(Fault::PartMissing) => "a part missing",
            Self::Fault(Fault::NeighbourIncluded) => "a neighbour included",
            Self::Fault(Fault::HalfMissing) => "half of the views have none",
            Self::Fault(Fault::SomeWrong) => "one view in five wrong",
        }
    }
}

impl Serialize for Start {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name())
    }
}

/// A scene's results from one start.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The scene's name.
    pub scene: String,
    /// What its runs began with.
    pub start: Start,
    /// Scores of the masks that the runs began with; none where they had none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masks: Option<AlphaScore>,
    /// Scores of these masks' soft visual hull.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hull: Option<AlphaScore>,
    /// A run per seed.
    pub runs: Vec<Run>,
}

/// A run and its scores.
#[derive(Debug, Clone, Serialize)]
pub struct Run {
    /// Its folder.
    pub folder: String,
    /// Its seed.
    pub seed: u64,
    /// Seconds in all, pictures included; none where the log does not say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Scores of the masks that it found, where it had none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found: Option<AlphaScore>,
    /// Scores of what it wrote.
    pub report: Report,
    /// Scores of mattes from places of which the run had no photos.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heldout: Option<AlphaScore>,
}

impl Row {
    /// A score of each run; none where one has none of it, or there is no run.
    pub(crate) fn of_runs(&self, score: impl Fn(&Run) -> Option<f64>) -> Option<Vec<f64>> {
        let values: Vec<f64> = self.runs.iter().map(score).collect::<Option<_>>()?;
        (!values.is_empty()).then_some(values)
    }

    fn mean(&self, score: impl Fn(&AlphaScore) -> f64) -> Option<f64> {
        let values = self.of_runs(|run| Some(score(&run.report.mean)))?;
        Some(values.iter().sum::<f64>() / values.len() as f64)
    }

    /// What of the start and its hull is not beaten by the mean of the runs, in IoU or boundary IoU.
    #[must_use]
    pub fn unbeaten(&self) -> Vec<&'static str> {
        let scores: [fn(&AlphaScore) -> f64; 2] = [|score| score.iou, |score| score.boundary_iou];
        let ahead = |other: &AlphaScore| {
            scores
                .iter()
                .any(|score| self.mean(score).is_some_and(|ours| ours <= score(other)))
        };
        [("the masks", &self.masks), ("their hull", &self.hull)]
            .into_iter()
            .filter(|(_, score)| score.as_ref().is_some_and(ahead))
            .map(|(name, _)| name)
            .collect()
    }
}

/// The whole table.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// What all runs were given, in the words of the command line; empty for the defaults.
    pub settings: String,
    /// Scene by scene.
    pub rows: Vec<Row>,
    /// Mean of IoU gained over the masks, over the rows with masks; none without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_gain: Option<f64>,
}

impl Results {
    /// Of `rows`.
    #[must_use]
    pub fn new(settings: String, rows: Vec<Row>) -> Self {
        let gain = |row: &Row| Some(row.mean(|score| score.iou)? - row.masks?.iou);
        let gains: Vec<f64> = rows.iter().filter_map(gain).collect();
        let mean_gain = (!gains.is_empty()).then(|| gains.iter().sum::<f64>() / gains.len() as f64);
        Self {
            settings,
            rows,
            mean_gain,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use std::collections::BTreeSet;

    fn score(iou: f64, boundary_iou: f64) -> AlphaScore {
        AlphaScore {
            iou,
            miou: iou,
            acc: iou,
            boundary_iou,
            sad: 1.0,
            mse: 1.0,
            grad: 1.0,
            conn: 1.0,
        }
    }

    fn row(masks: Option<AlphaScore>, hull: Option<AlphaScore>, runs: &[AlphaScore]) -> Row {
        let run = |(seed, mean): (usize, &AlphaScore)| Run {
            folder: format!("own/seed{seed}"),
            seed: seed as u64,
            seconds: None,
            found: None,
            report: serde_json::from_value(serde_json::json!({ "views": [], "mean": mean }))
                .unwrap(),
            heldout: None,
        };
        Row {
            scene: "a|b".to_owned(),
            start: Start::Own,
            masks,
            hull,
            runs: runs.iter().enumerate().map(run).collect(),
        }
    }

    #[test]
    fn starts_are_found_by_names_of_their_own() {
        let names: BTreeSet<String> = Start::every().map(Start::name).collect();
        assert_eq!(names.len(), 8);
        for start in Start::every() {
            assert_eq!(Start::named(&start.name()), Some(start));
        }
        assert_eq!(
            Start::named("half-missing"),
            Some(Start::Fault(Fault::HalfMissing))
        );
        assert_eq!(Start::named("all"), None);
    }

    #[test]
    fn what_is_not_beaten_is_named() {
        let runs = [score(0.9, 0.7), score(0.8, 0.9)];
        // Ahead of the mean of 0.85, 0.8 in neither, in one, in none.
        assert!(
            row(Some(score(0.8, 0.7)), None, &runs)
                .unbeaten()
                .is_empty()
        );
        let behind = row(Some(score(0.8, 0.85)), Some(score(0.86, 0.1)), &runs);
        assert_eq!(behind.unbeaten(), ["the masks", "their hull"]);
        // As good is not better.
        let alike = row(Some(score(0.5, 0.5)), None, &[score(0.5, 0.6)]);
        assert_eq!(alike.unbeaten(), ["the masks"]);
    }

    #[test]
    fn the_gain_is_over_rows_with_masks() {
        let rows = vec![
            row(
                Some(score(0.8, 0.5)),
                None,
                &[score(0.9, 0.9), score(1.0, 0.9)],
            ),
            row(None, None, &[score(0.1, 0.1)]),
            row(Some(score(0.5, 0.5)), None, &[score(0.55, 0.9)]),
        ];
        let results = Results::new(String::new(), rows);
        assert!((results.mean_gain.unwrap() - 0.1).abs() < 1e-12);
        // Every row is there, with how far its runs lie apart, and a bar in a name is no column.
        let page = results.markdown();
        assert!(page.contains("0.950 ± 0.071"), "{page}");
        assert_eq!(page.matches("a\\|b").count(), 3, "{page}");
        assert!(
            results
                .table()
                .lines()
                .filter(|line| line.starts_with("a|b"))
                .count()
                == 3
        );
        assert_eq!(Results::new(String::new(), Vec::new()).mean_gain, None);
    }
}
