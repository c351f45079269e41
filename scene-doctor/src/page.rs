//! The report as one HTML file: the scene to be turned with the mouse, and the table of checks.

use crate::drawing::Drawing;
use crate::finding::{Finding, Report};
use html_escape::encode_quoted_attribute as escape;
use std::fmt::Write as _;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Photos listed by name below the table, for each check.
const MOST_NAMES: usize = 40;

/// The whole document; it loads nothing from anywhere.
#[must_use]
pub fn page(report: &Report, drawing: &Drawing) -> String {
    let title = escape(&report.scene);
    let verdict = report.verdict.to_string().to_lowercase();
    let rows: String = report.checks.iter().map(row).collect();
    // In a script element only the end of it means anything; `<` is the same character in JSON.
    let data = serde_json::to_string(drawing)
        .unwrap_or_else(|_| "null".to_owned())
        .replace('<', "\\u003c");
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} – sos doctor</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<header>\n<h1>{title}</h1>\n\
         <p class=\"verdict {verdict}\">{}</p>\n</header>\n\
         <div class=\"stage\">\n<canvas id=\"scene\" tabindex=\"0\" role=\"img\" \
         aria-label=\"Cameras, sparse points, the object's box and the ground in 3D\"></canvas>\n\
         <output id=\"name\" hidden></output>\n\
         <p class=\"keys\"><span><i class=\"camera\"></i>camera</span>\
         <span><i class=\"flagged\"></i>camera with a warning</span>\
         <span><i class=\"box\"></i>the object's box</span>\
         <span><i class=\"ground\"></i>ground</span>\
         <span class=\"how\">drag to turn, wheel to come near, shift-drag to move, double click to reset</span></p>\n\
         </div>\n<noscript><p>The scene in 3D needs JavaScript; the checks do not.</p></noscript>\n\
         <h2>Checks</h2>\n<table>\n{rows}</table>\n\
         <script type=\"application/json\" id=\"drawing\">{data}</script>\n\
         <script>\n{SCRIPT}</script>\n</body>\n</html>\n",
        escape(&report.summary())
    )
}

fn row(finding: &Finding) -> String {
    let status = finding.status.to_string().to_lowercase();
    let mut html = format!(
        "<tr class=\"{status}\"><td><b>{status}</b></td><th>{}</th><td><p>{}</p>",
        finding.check,
        escape(&finding.says)
    );
    // Writing to a string cannot fail.
    if let Some(remedy) = &finding.remedy {
        let _ = write!(html, "<p class=\"remedy\">{}</p>", escape(remedy));
    }
    if !finding.photos.is_empty() {
        let shown = &finding.photos[..finding.photos.len().min(MOST_NAMES)];
        let more = match finding.photos.len() - shown.len() {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let _ = write!(
            html,
            "<details><summary>{} photo{}</summary>{}{more}</details>",
            finding.photos.len(),
            if finding.photos.len() == 1 { "" } else { "s" },
            escape(&shown.join(", "))
        );
    }
    html.push_str("</td></tr>\n");
    html
}
