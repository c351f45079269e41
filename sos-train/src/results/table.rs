//! The table as text and as Markdown.

use super::{Results, Row, Run};
use crate::ablation::Spread;
use sos_eval::AlphaScore;
use std::fmt::Write as _;

/// Names of what [`cells`] gives.
const HEADINGS: [&str; 9] = [
    "scene", "start", "masks", "hull", "result", "SAD", "plate", "mesh", "held out",
];

/// What the columns are, for readers of the page.
const LEGEND: &str = "\
IoU at alpha 0.5 and boundary IoU (a band of 2 % of the diagonal), means over all views, a missing mask \
counting as empty; with several seeds mean ± standard deviation of each. Masks: what the run began with; without any, \
what it found. Hull: these masks' soft visual hull. SAD in thousands. Plate: PSNR in dB where seen. Mesh: chamfer distance in % of \
the object's size. Held out: mattes of views that are in no run.";

impl Results {
    /// The table as aligned text.
    #[must_use]
    pub fn table(&self) -> String {
        let lines: Vec<[String; 9]> = std::iter::once(HEADINGS.map(str::to_owned))
            .chain(self.rows.iter().map(cells))
            .collect();
        let width = |column: usize| {
            let widths = lines.iter().map(|line| line[column].chars().count());
            widths.max().unwrap_or(0)
        };
        let widths: [usize; 9] = std::array::from_fn(width);
        let mut out = String::new();
        for line in &lines {
            for (cell, width) in line.iter().zip(widths) {
                // Writing to a string cannot fail, here and below.
                let _ = write!(out, "{cell:width$}  ");
            }
            out.truncate(out.trim_end().len());
            out.push('\n');
        }
        for remark in self.remarks() {
            let _ = writeln!(out, "{remark}");
        }
        out
    }

    /// A page of Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut out = "# Results\n\n".to_owned();
        if !self.settings.is_empty() {
            let _ = writeln!(out, "All runs with `{}`.\n", self.settings);
        }
        let _ = writeln!(out, "| {} |", HEADINGS.join(" | "));
        let _ = writeln!(out, "|{}", "---|".repeat(HEADINGS.len()));
        for row in &self.rows {
            let cells = cells(row).map(|cell| cell.replace('|', "\\|"));
            let _ = writeln!(out, "| {} |", cells.join(" | "));
        }
        let _ = writeln!(out, "\n{LEGEND}");
        for remark in self.remarks() {
            let _ = writeln!(out, "\n{remark}");
        }
        out
    }

    /// What the numbers come to.
    fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if let Some(gain) = self.mean_gain {
            let rows = self.rows.iter().filter(|row| row.masks.is_some()).count();
            remarks.push(format!(
                "IoU gained over the masks, mean of {rows}: {gain:+.3}"
            ));
        }
        for row in &self.rows {
            let unbeaten = row.unbeaten();
            if !unbeaten.is_empty() {
                remarks.push(format!(
                    "{}, {}: not better than {} in both scores",
                    row.scene,
                    row.start.title(),
                    unbeaten.join(" and ")
                ));
            }
        }
        remarks
    }
}

fn cells(row: &Row) -> [String; 9] {
    let masks = match &row.masks {
        Some(score) => pair(score),
        None => both(row, |run| run.found.as_ref()),
    };
    let report = |run: &Run| Some(run.report.mean.sad);
    let plate = |run: &Run| Some(run.report.plate.as_ref()?.seen?.psnr);
    let mesh = |run: &Run| Some(100.0 * run.report.mesh.as_ref()?.relative.chamfer);
    [
        row.scene.clone(),
        row.start.title().to_owned(),
        masks,
        row.hull.as_ref().map_or("-".to_owned(), pair),
        both(row, |run| Some(&run.report.mean)),
        number(row.of_runs(report), 2),
        number(row.of_runs(plate), 1),
        number(row.of_runs(mesh), 2),
        both(row, |run| run.heldout.as_ref()),
    ]
}

fn pair(score: &AlphaScore) -> String {
    format!("{:.3}, {:.3}", score.iou, score.boundary_iou)
}

/// IoU and boundary IoU over the runs.
fn both(row: &Row, of: impl Fn(&Run) -> Option<&AlphaScore>) -> String {
    let iou = row.of_runs(|run| Some(of(run)?.iou));
    let boundary = row.of_runs(|run| Some(of(run)?.boundary_iou));
    if iou.is_none() {
        return "-".to_owned();
    }
    format!("{}, {}", number(iou, 3), number(boundary, 3))
}

/// A single value, or mean and deviation of several.
fn number(values: Option<Vec<f64>>, decimals: usize) -> String {
    let Some(values) = values else {
        return "-".to_owned();
    };
    match (Spread::of(&values), values.first()) {
        (Some(spread), _) => spread.text(decimals),
        (None, Some(value)) => format!("{value:.decimals$}"),
        (None, None) => "-".to_owned(),
    }
}
