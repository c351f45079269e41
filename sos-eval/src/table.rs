//! A report as text for people: mean, start, the worst views, plates, mesh, what was missing.

use crate::plates::{PlateScore, Quality};
use crate::report::{AlphaScore, Report};
use std::fmt::{self, Write};

const HEADINGS: [&str; 8] = ["IoU", "mIoU", "acc", "bIoU", "SAD", "MSE", "grad", "conn"];
const DECIMALS: [usize; 8] = [4, 4, 4, 4, 3, 3, 3, 3];
/// Views shown by [`Report`]'s `Display`.
const WORST: usize = 5;

impl Report {
    /// The report as aligned text with the `worst` views of lowest IoU.
    ///
    /// IoU, mIoU, accuracy and boundary IoU are better when higher, the other four when lower.
    pub fn table(&self, worst: usize) -> String {
        let mut by_iou: Vec<_> = self.views.iter().collect();
        by_iou.sort_by(|a, b| a.score.iou.total_cmp(&b.score.iou));
        by_iou.truncate(worst);
        let mut rows: Vec<(String, AlphaScore)> =
            vec![(format!("mean of {}", self.views.len()), self.mean)];
        rows.extend(self.start.map(|start| ("start".to_owned(), start)));
        let summary = rows.len();
        rows.extend(
            by_iou
                .into_iter()
                .map(|view| (view.name.clone(), view.score)),
        );
        let names = rows
            .iter()
            .map(|(name, _)| name.chars().count())
            .max()
            .unwrap_or(0);

        let mut out = format!("{:names$}{}", "", score_headings());
        for (i, (name, score)) in rows.iter().enumerate() {
            if i == summary {
                out.push_str("\nworst views");
            }
            push(
                &mut out,
                format_args!("\n{name:names$}{}", score_cells(score)),
            );
        }
        out.push('\n');
        for plate in [&self.plate, &self.clean_plate].into_iter().flatten() {
            push_plate(&mut out, plate);
        }
        self.push_mesh(&mut out);
        for (what, names) in [
            ("matte missing", &self.missing),
            ("start mask missing", &self.start_missing),
        ] {
            if !names.is_empty() {
                push(
                    &mut out,
                    format_args!("{what}, counted as empty: {}\n", names.join(", ")),
                );
            }
        }
        for note in &self.notes {
            push(&mut out, format_args!("note: {note}\n"));
        }
        out
    }

    fn push_mesh(&self, out: &mut String) {
        let Some(mesh) = &self.mesh else { return };
        push(
            out,
            format_args!("mesh, % of object size {:.4}\n", mesh.object_size),
        );
        let d = mesh.relative;
        for (name, mean, median) in [
            ("accuracy", d.accuracy_mean, Some(d.accuracy_median)),
            (
                "completeness",
                d.completeness_mean,
                Some(d.completeness_median),
            ),
            ("chamfer", d.chamfer, None),
        ] {
            push(out, format_args!("  {name:12}  mean {:7.3}", 100.0 * mean));
            if let Some(median) = median {
                push(out, format_args!("  median {:7.3}", 100.0 * median));
            }
            out.push('\n');
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.table(WORST))
    }
}

/// The names of a score's values, each ten characters wide.
pub(crate) fn score_headings() -> String {
    HEADINGS
        .iter()
        .map(|heading| format!("  {heading:>8}"))
        .collect()
}

/// A score's values below [`score_headings`].
pub(crate) fn score_cells(score: &AlphaScore) -> String {
    score
        .to_array()
        .into_iter()
        .zip(DECIMALS)
        .map(|(value, decimals)| format!("  {value:8.decimals$}"))
        .collect()
}

/// The names of a score's values.
pub(crate) fn markdown_headings() -> [&'static str; 8] {
    HEADINGS
}

/// A score's values under [`markdown_headings`].
pub(crate) fn markdown_cells(score: &AlphaScore) -> Vec<String> {
    let values = score.to_array().into_iter().zip(DECIMALS);
    values
        .map(|(value, decimals)| format!("{value:.decimals$}"))
        .collect()
}

/// Writing to a string cannot fail.
fn push(out: &mut String, text: fmt::Arguments<'_>) {
    let _ = out.write_fmt(text);
}

fn push_plate(out: &mut String, plate: &PlateScore) {
    push(out, format_args!("plates against {}\n", plate.truth));
    let share = 100.0 * plate.seen_share;
    let seen = format!("object, seen by >= {} ({share:.0} %)", plate.min_seen);
    let rows = [
        (seen.as_str(), plate.seen),
        ("whole object", plate.object),
        ("whole picture", plate.whole),
    ];
    let names = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    for (name, quality) in rows {
        let Some(Quality {
            psnr, ssim, views, ..
        }) = quality
        else {
            continue;
        };
        push(
            out,
            format_args!("  {name:names$}  PSNR {psnr:6.2} dB  SSIM {ssim:.4}  {views} views\n"),
        );
    }
    if !plate.missing.is_empty() {
        push(
            out,
            format_args!("  not scored: {}\n", plate.missing.join(", ")),
        );
    }
}
