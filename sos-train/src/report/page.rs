//! The page itself.

use super::ReportInputs;
use super::audited;
use super::curves::plots;
use super::mesh::PackedMesh;
use super::views::{Cell, Row, columns};
use crate::progress::duration;
use html_escape::encode_quoted_attribute as escape;
use serde_json::{Map, Value};
use sos_eval::AlphaScore;
use std::fmt::Write as _;
use std::time::Duration;

pub(crate) const STYLE: &str = include_str!("style.css");
/// Faults are collected where a test, or a person with the page's source, finds them.
const WATCH: &str = "addEventListener('error',e=>{const d=document.documentElement.dataset;\
                     d.errors=(d.errors||'')+e.message+' at line '+e.lineno+'; '});";
/// Sliders and the large view.
const STAGE: &str = include_str!("stage.js");
/// The mesh.
const VIEWER: &str = include_str!("viewer.js");
/// Views listed as the worst.
const WORST: usize = 5;

/// The whole document. `fault` says what is wrong with a mesh that is not shown.
pub(super) fn page(
    inputs: &ReportInputs,
    rows: &[Row],
    mesh: Option<&PackedMesh>,
    fault: Option<&str>,
) -> String {
    let title = escape(&inputs.title);
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} – sos</title>\n\
         <style>\n{STYLE}</style>\n<script>{WATCH}</script>\n</head>\n<body>\n<header>\n<h1>{title}</h1>\n{}</header>\n",
        facts(inputs)
    );
    html.push_str(&tiles(inputs));
    html.push_str(&looks(mesh));
    html.push_str(&audited::section(inputs, rows));
    html.push_str(&scores(inputs, rows));
    let curves = plots(&inputs.log);
    if !curves.is_empty() {
        // Writing to a string cannot fail, here and below.
        let _ = write!(
            html,
            "<h2>Training</h2>\n<div class=\"plots\">\n{curves}</div>\n"
        );
    }
    let notes: Vec<&str> = fault
        .into_iter()
        .chain(inputs.notes.iter().map(String::as_str))
        .collect();
    if !notes.is_empty() {
        html.push_str("<h2>Notes</h2>\n<ul class=\"notes\">\n");
        for note in notes {
            let _ = writeln!(html, "<li>{}</li>", escape(note));
        }
        html.push_str("</ul>\n");
    }
    html.push_str(&views(inputs, rows));
    let _ = write!(
        html,
        "<script>\n{STAGE}</script>\n<script>\n{VIEWER}</script>\n</body>\n</html>\n"
    );
    html
}

/// Where the scripts put the pair of pictures to compare and the mesh.
fn looks(mesh: Option<&PackedMesh>) -> String {
    let mut html = String::from(
        "<div class=\"looks\">\n<section id=\"compare\" class=\"panel\" hidden></section>\n",
    );
    if let Some(mesh) = mesh {
        let _ = writeln!(
            html,
            "<section id=\"viewer\" class=\"panel\" data-vertices=\"{}\" data-triangles=\"{}\" \
             data-low=\"{}\" data-high=\"{}\"><script type=\"text/plain\" id=\"mesh\">{}</script></section>",
            mesh.vertices,
            mesh.triangles,
            mesh.low.to_array().map(|v| v.to_string()).join(" "),
            mesh.high.to_array().map(|v| v.to_string()).join(" "),
            mesh.base64
        );
    }
    html.push_str("</div>\n");
    html
}

/// The line below the title.
fn facts(inputs: &ReportInputs) -> String {
    let config = &inputs.config;
    let device = last(&inputs.log, "device")
        .and_then(Value::as_str)
        .unwrap_or(&config.device);
    let mut facts = vec![
        format!("preset {}", config.preset),
        format!(
            "{} steps",
            last_step(&inputs.log).unwrap_or(config.steps.into())
        ),
    ];
    if let Some(seconds) = seconds(&inputs.log) {
        facts.push(duration(seconds));
    }
    facts.extend([
        format!("device {device}"),
        format!("seed {}", config.seed),
        format!("sos {}", inputs.versions.sos),
        inputs.versions.platform.clone(),
    ]);
    let facts: Vec<_> = facts.iter().map(|fact| escape(fact)).collect();
    format!("<p class=\"facts\">{}</p>\n", facts.join(" · "))
}

/// The figures that matter most.
fn tiles(inputs: &ReportInputs) -> String {
    let mut tiles: Vec<(String, String)> = Vec::new();
    if let Some(metrics) = &inputs.metrics {
        let was = metrics.start.map_or(String::new(), |start| {
            format!(", coarse masks {:.3}", start.iou)
        });
        tiles.push((format!("{:.3}", metrics.mean.iou), format!("IoU{was}")));
        if let Some(seen) = metrics.plate.as_ref().and_then(|plate| plate.seen) {
            tiles.push((
                format!("{:.1} dB", seen.psnr),
                "plate PSNR behind the object".to_owned(),
            ));
        }
        if let Some(mesh) = &metrics.mesh {
            let share = 100.0 * mesh.relative.chamfer;
            tiles.push((
                format!("{share:.2} %"),
                "mesh distance, of the object's size".to_owned(),
            ));
        }
    }
    let audit = inputs.audit.as_ref();
    if let Some((audit, consistency)) = audit.and_then(|audit| Some((audit, audit.consistency?))) {
        let was = audit.mask_consistency.map_or(String::new(), |start| {
            format!(", coarse masks {:.1} %", 100.0 * start)
        });
        tiles.push((
            format!("{:.2} %", 100.0 * consistency),
            format!("of looks between views agree{was}"),
        ));
    }
    if let Some(psnr) = last(&inputs.log, "psnr").and_then(Value::as_f64) {
        tiles.push((format!("{psnr:.1} dB"), "PSNR of training rays".to_owned()));
    }
    let views = inputs.scene.model.views.len();
    let masks = inputs
        .masks
        .as_ref()
        .map_or("no masks".to_owned(), |masks| {
            format!("{} with a mask", views - masks.missing.len().min(views))
        });
    tiles.push((views.to_string(), format!("views, {masks}")));
    let tiles: String = tiles
        .iter()
        .map(|(figure, what)| format!("<div><b>{figure}</b><span>{}</span></div>\n", escape(what)))
        .collect();
    format!("<div class=\"tiles\">\n{tiles}</div>\n")
}

fn scores(inputs: &ReportInputs, rows: &[Row]) -> String {
    let Some(metrics) = &inputs.metrics else {
        return String::new();
    };
    let mut html = String::from(
        "<h2>Scores</h2>\n<div class=\"scroll\"><table>\n<tr><th></th><th>IoU</th><th>mIoU</th>\
         <th>accuracy</th><th>boundary IoU</th><th>SAD</th><th>MSE</th><th>Grad</th><th>Conn</th></tr>\n",
    );
    let mut line = |name: &str, score: &AlphaScore| {
        let _ = write!(html, "<tr><th>{name}</th>");
        for (i, value) in score.to_array().into_iter().enumerate() {
            let digits = if i < 4 { 4 } else { 3 };
            let _ = write!(html, "<td>{value:.digits$}</td>");
        }
        html.push_str("</tr>\n");
    };
    line("this run", &metrics.mean);
    if let Some(start) = &metrics.start {
        line("coarse masks", start);
    }
    html.push_str("</table></div>\n");

    let mut worst: Vec<_> = metrics.views.iter().collect();
    worst.sort_by(|a, b| a.score.iou.total_cmp(&b.score.iou));
    let worst: Vec<String> = worst
        .iter()
        .filter_map(|view| {
            let at = rows
                .iter()
                .position(|row| names_match(&row.stem, &view.name))?;
            Some(format!(
                "<a href=\"#v{at}\">{}</a> {:.3}",
                escape(&view.name),
                view.score.iou
            ))
        })
        .take(WORST)
        .collect();
    if !worst.is_empty() {
        let _ = writeln!(
            html,
            "<p class=\"facts\">lowest IoU: {}</p>",
            worst.join(" · ")
        );
    }
    html
}

/// Scores go by file stem; results of photos in sub-folders by the path's last part too.
fn names_match(stem: &str, scored: &str) -> bool {
    stem == scored || stem.rsplit(['/', '\\']).next() == Some(scored)
}

fn views(inputs: &ReportInputs, rows: &[Row]) -> String {
    let columns = columns(inputs);
    let mut html = format!(
        "<h2 id=\"views\">Views</h2>\n<div class=\"views\" style=\"--columns:{}\">\n",
        columns.len()
    );
    html.push_str("<div class=\"row head\">");
    for column in &columns {
        let _ = write!(html, "<span>{column}</span>");
    }
    html.push_str("</div>\n");
    for (number, row) in rows.iter().enumerate() {
        let iou = inputs
            .metrics
            .iter()
            .flat_map(|metrics| &metrics.views)
            .find(|view| names_match(&row.stem, &view.name))
            .map_or(String::new(), |view| {
                format!(" <em>IoU {:.3}</em>", view.score.iou)
            });
        let audited = inputs.audit.iter().find_map(|audit| audit.view(&row.name));
        let consistent = audited
            .and_then(|view| view.consistency)
            .map_or(String::new(), |share| {
                format!(" <em>consistency {:.2} %</em>", 100.0 * share)
            });
        let _ = writeln!(
            html,
            "<section id=\"v{number}\"><h3>{}{iou}{consistent}</h3>\n<div class=\"row\">",
            escape(&row.name)
        );
        for (cell, column) in row.cells.iter().zip(&columns) {
            html.push_str(&picture(cell.as_ref(), column, &row.name));
        }
        html.push_str("</div></section>\n");
    }
    html.push_str("</div>\n");
    html
}

fn picture(cell: Option<&Cell>, column: &str, name: &str) -> String {
    let Some(Cell { picture, file }) = cell else {
        return format!(
            "<figure class=\"none\" data-column=\"{column}\"><span>none</span></figure>\n"
        );
    };
    let image = format!(
        "<img src=\"{}\" width=\"{}\" height=\"{}\" loading=\"lazy\" alt=\"{column} of {}\">",
        picture.uri,
        picture.width,
        picture.height,
        escape(name)
    );
    let inner = match file {
        Some(file) => format!("<a href=\"{}\">{image}</a>", escape(&link(file))),
        None => image,
    };
    format!("<figure data-column=\"{column}\">{inner}</figure>\n")
}

/// A relative path as a link: everything that could mean something in one is escaped.
fn link(path: &str) -> String {
    path.bytes().fold(String::new(), |mut out, byte| {
        if byte.is_ascii_alphanumeric() || b"/._-~".contains(&byte) {
            out.push(char::from(byte));
        } else {
            let _ = write!(out, "%{byte:02X}");
        }
        out
    })
}

/// The last value of a key that is not null.
fn last<'a>(log: &'a [Map<String, Value>], key: &str) -> Option<&'a Value> {
    log.iter()
        .rev()
        .filter_map(|line| line.get(key))
        .find(|value| !value.is_null())
}

fn last_step(log: &[Map<String, Value>]) -> Option<u64> {
    log.iter()
        .filter_map(|line| line.get("step")?.as_u64())
        .max()
}

/// Of the whole run if it came to its end, else of training.
fn seconds(log: &[Map<String, Value>]) -> Option<Duration> {
    Duration::try_from_secs_f64(last(log, "seconds")?.as_f64()?).ok()
}
