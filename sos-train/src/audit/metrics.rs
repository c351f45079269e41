//! `metrics.json`: scores against the truth, where it is known, and the audit, which needs none.

use crate::run_folder::{RunError, RunFolder};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::Write as _;

/// What the audit says of one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AuditedView {
    /// The photo's name.
    pub name: String,
    /// Overlap (IoU at one half) of start mask and matte; `None` without a start mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_iou: Option<f64>,
    /// Share of agreeing looks between this view and its neighbours, 0..1; `None` where there was none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<f64>,
    /// The same of the start masks, where the run found a surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_consistency: Option<f64>,
    /// Sum of the view's uncertainty over the area of its matte.
    pub uncertainty: f64,
}

/// What the audit says of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunAudit {
    /// Mean over the views that have one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<f64>,
    /// Mean of the start masks' consistency.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_consistency: Option<f64>,
    /// Mean over the views that have a start mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_iou: Option<f64>,
    /// In the model's order.
    pub views: Vec<AuditedView>,
}

impl RunAudit {
    /// Means over views.
    #[must_use]
    pub fn of(views: Vec<AuditedView>) -> Self {
        Self {
            consistency: mean(views.iter().filter_map(|view| view.consistency)),
            mask_consistency: mean(views.iter().filter_map(|view| view.mask_consistency)),
            mask_iou: mean(views.iter().filter_map(|view| view.mask_iou)),
            views,
        }
    }

    /// The audit of a photo.
    #[must_use]
    pub fn view(&self, photo: &str) -> Option<&AuditedView> {
        self.views.iter().find(|view| view.name == photo)
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// All that is known about how good a run is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Against ground truth, with their keys at the top.
    #[serde(flatten)]
    pub scores: Option<sos_eval::Report>,
    /// Without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<RunAudit>,
}

impl Metrics {
    /// What `metrics.json` holds. Scores are an extra: of a file that is not there, or of other
    /// origin, nothing is taken.
    #[must_use]
    pub fn read(run: &RunFolder) -> Self {
        fs::read(run.metrics_path())
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
            .unwrap_or_default()
    }

    /// Writes `metrics.json`.
    ///
    /// # Errors
    /// [`RunError::Io`].
    pub fn write(&self, run: &RunFolder) -> Result<(), RunError> {
        run.write(&run.metrics_path(), |out| {
            serde_json::to_writer_pretty(&mut *out, self)?;
            writeln!(out)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_audit_without_truth_reads_back() {
        let view = |name: &str, consistency| AuditedView {
            name: name.to_owned(),
            mask_iou: None,
            consistency,
            mask_consistency: None,
            uncertainty: 0.25,
        };
        let audit = RunAudit::of(vec![view("a", Some(0.5)), view("b", None)]);
        assert_eq!((audit.consistency, audit.mask_iou), (Some(0.5), None));
        let metrics = Metrics {
            scores: None,
            audit: Some(audit),
        };
        let text = serde_json::to_string(&metrics).unwrap_or_default();
        assert_eq!(serde_json::from_str::<Metrics>(&text).ok(), Some(metrics));
        assert!(text.starts_with("{\"audit\":"), "{text}");
    }
}
