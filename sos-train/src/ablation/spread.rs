//! How far runs of one row lie apart that differ in nothing but the seed.

use serde::Serialize;
use std::fmt::Write as _;

use super::Scored;

/// Mean and sample standard deviation of a score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The standard deviation, of a sample.
    pub deviation: f64,
}

impl Spread {
    /// Of two values or more; `None` for fewer.
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (values.len() > 1).then(|| Self {
            mean,
            deviation: (squares / (n - 1.0)).sqrt(),
        })
    }

    /// Mean ± deviation.
    pub(crate) fn text(self, decimals: usize) -> String {
        format!("{:.decimals$} ± {:.decimals$}", self.mean, self.deviation)
    }
}

/// A row over all of its seeds.
#[derive(Debug, Clone, Serialize)]
pub struct OverSeeds {
    /// The row's name, which is its first seed's folder.
    pub row: &'static str,
    /// Its title.
    pub name: &'static str,
    /// How many runs there are.
    pub runs: usize,
    /// Intersection over union.
    pub iou: Spread,
    /// Boundary IoU.
    pub boundary_iou: Spread,
    /// Sum of absolute differences / 1000.
    pub sad: Spread,
    /// Plates' PSNR in dB where seen; none where a run has no score.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plate: Option<Spread>,
    /// The mesh's chamfer distance as a share of the object's size; none where a run has no score.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<Spread>,
}

/// The rows that ran with more than one seed.
pub(super) fn over_seeds(rows: &[Scored]) -> Vec<OverSeeds> {
    let mut out: Vec<OverSeeds> = Vec::new();
    for (i, first) in rows.iter().enumerate() {
        if rows[..i].iter().any(|earlier| earlier.row == first.row) {
            continue;
        }
        let alike = || rows.iter().filter(|other| other.row == first.row);
        let of = |value: &dyn Fn(&Scored) -> Option<f64>| {
            let values: Option<Vec<f64>> = alike().map(value).collect();
            Spread::of(&values?)
        };
        let mean = |scored: &Scored| scored.compared.report.mean;
        let (Some(iou), Some(boundary_iou), Some(sad)) = (
            of(&|run| Some(mean(run).iou)),
            of(&|run| Some(mean(run).boundary_iou)),
            of(&|run| Some(mean(run).sad)),
        ) else {
            continue;
        };
        out.push(OverSeeds {
            row: first.row,
            name: first.title,
            runs: alike().count(),
            iou,
            boundary_iou,
            sad,
            plate: of(&|run| Some(run.compared.report.plate.as_ref()?.seen?.psnr)),
            mesh: of(&|run| Some(run.compared.report.mesh.as_ref()?.relative.chamfer)),
        });
    }
    out
}

/// The names of what [`cells`] gives.
const HEADINGS: [&str; 6] = ["runs", "IoU", "bIoU", "SAD", "plate", "mesh"];

fn cells(row: &OverSeeds) -> [String; 6] {
    let cell = |spread: Option<Spread>, factor: f64, decimals: usize| {
        spread.map_or("-".to_owned(), |Spread { mean, deviation }| {
            let (mean, deviation) = (factor * mean, factor * deviation);
            Spread { mean, deviation }.text(decimals)
        })
    };
    [
        row.runs.to_string(),
        cell(Some(row.iou), 1.0, 4),
        cell(Some(row.boundary_iou), 1.0, 4),
        cell(Some(row.sad), 1.0, 3),
        cell(row.plate, 1.0, 2),
        cell(row.mesh, 100.0, 3),
    ]
}

/// The rows as aligned text, with a line of headings.
pub(super) fn table(rows: &[OverSeeds]) -> String {
    let names = rows.iter().map(|row| row.name.chars().count());
    let names = names.max().unwrap_or(0);
    let mut out = format!("{:names$}", "");
    for heading in HEADINGS {
        // Writing to a string cannot fail, here and below.
        let _ = write!(out, "  {heading:>15}");
    }
    for row in rows {
        let _ = write!(out, "\n{:names$}", row.name);
        for cell in cells(row) {
            let _ = write!(out, "  {cell:>15}");
        }
    }
    out.push('\n');
    out
}

/// The rows in Markdown.
pub(super) fn markdown(rows: &[OverSeeds]) -> String {
    let rule = "---:|".repeat(HEADINGS.len());
    let mut out = format!("| | {} |\n|---|{rule}\n", HEADINGS.join(" | "));
    for row in rows {
        let name = row.name.replace('|', "\\|");
        let _ = writeln!(out, "| {name} | {} |", cells(row).join(" | "));
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_has_the_spread_of_a_sample() {
        assert_eq!(Spread::of(&[3.0]), None);
        assert_eq!(Spread::of(&[]), None);
        let Spread { mean, deviation } = Spread::of(&[1.0, 2.0, 6.0]).unwrap();
        assert_eq!(mean, 3.0);
        assert!((deviation - 7f64.sqrt()).abs() < 1e-12);
    }
}
