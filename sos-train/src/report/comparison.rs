//! One page for several results: the table of scores, and every view's mattes side by side.

use super::ReportError;
use super::page::STYLE;
use super::thumbnail;
use crate::export::byte;
use html_escape::encode_quoted_attribute as escape;
use image::GrayImage;
use rayon::prelude::*;
use sos_eval::{Comparison, Contender, Plane, mattes_by_view};
use std::fmt::Write as _;
use std::path::Path;

/// Pixels of a thumbnail.
const ROOM: u32 = 320 * 240;

/// The whole document, with nothing outside it.
///
/// # Errors
/// [`ReportError`] if a picture cannot be read.
pub fn comparison_page(
    comparison: &Comparison,
    contenders: &[Contender],
    gt_dir: &Path,
) -> Result<String, ReportError> {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>Comparison – sos</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<header>\n<h1>Comparison</h1>\n\
         <p class=\"facts\">against {}</p>\n</header>\n<pre>{}</pre>\n<div class=\"scroll\">\
         <table class=\"mattes\">\n<tr><th></th><th>truth</th>",
        escape(&gt_dir.display().to_string()),
        escape(&comparison.table()),
    );
    // Writing to a string cannot fail, here and below.
    for contender in contenders {
        let _ = write!(html, "<th>{}</th>", escape(&contender.name));
    }
    html.push_str("</tr>\n");
    let rows = mattes_by_view(contenders, gt_dir)?
        .into_par_iter()
        .map(|(name, files)| {
            let mut row = format!("<tr><th>{}</th>", escape(&name));
            for (column, file) in files.iter().enumerate() {
                let Some(file) = file else {
                    row.push_str("<td>none</td>");
                    continue;
                };
                let matte = thumbnail::matte(&grey(&file.read()?), ROOM);
                let _ = write!(
                    row,
                    "<td><img src=\"{}\" width=\"{}\" height=\"{}\" loading=\"lazy\" alt=\"\">",
                    matte.uri, matte.width, matte.height
                );
                let scored = column
                    .checked_sub(1)
                    .and_then(|c| comparison.contenders.get(c));
                let view = scored.and_then(|s| s.report.views.iter().find(|v| v.name == name));
                if let Some(view) = view {
                    let _ = write!(row, "<br>IoU {:.3}", view.score.iou);
                }
                row.push_str("</td>");
            }
            row.push_str("</tr>\n");
            Ok(row)
        })
        .collect::<Result<Vec<_>, ReportError>>()?;
    html.extend(rows);
    html.push_str("</table></div>\n</body>\n</html>\n");
    Ok(html)
}

fn grey(matte: &Plane) -> GrayImage {
    GrayImage::from_fn(matte.width as u32, matte.height as u32, |x, y| {
        let value = matte.values[y as usize * matte.width + x as usize];
        image::Luma([byte(value)])
    })
}
