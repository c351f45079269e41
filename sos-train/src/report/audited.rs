//! The part of the page about what needs no ground truth.

use super::ReportInputs;
use super::views::{Row, most_changed};
use crate::audit::AuditedView;
use html_escape::encode_quoted_attribute as escape;
use std::fmt::Write as _;

/// Views named as the least consistent.
const WORST: usize = 6;

/// Mask audit and consistency; nothing for a run that was not audited.
pub(super) fn section(inputs: &ReportInputs, rows: &[Row]) -> String {
    let Some(audit) = &inputs.audit else {
        return String::new();
    };
    let number = |name: &str| rows.iter().position(|row| row.name == name);
    let link = |view: &AuditedView, value: f64| {
        let at = number(&view.name)?;
        let name = escape(&view.name);
        Some(format!("<a href=\"#v{at}\">{name}</a>\u{a0}{value:.3}"))
    };
    let mut html = String::new();

    // Writing to a string cannot fail, here and below.
    if inputs.masks.is_some() && audit.mask_iou.is_some() {
        html.push_str(
            "<h2 id=\"masks\">Mask audit</h2>\n<p class=\"lead\">Start masks that disagree with what all \
             views together came to, by overlap (IoU) inside the view. \
             <i class=\"key added\"></i>object now, was not in the mask; \
             <i class=\"key removed\"></i>in the mask, not the object now. \
             <code>sos export RUN --masks-for TOOL</code> writes the corrected masks.</p>\n\
             <div class=\"cards\">\n",
        );
        for at in most_changed(inputs) {
            let row = &rows[at];
            let Some(view) = audit.view(&row.name) else {
                continue;
            };
            let Some(change) = &row.change else {
                continue;
            };
            let _ = writeln!(
                html,
                "<figure class=\"card\" data-view=\"v{at}\"><img src=\"{}\" width=\"{}\" height=\"{}\" \
                 loading=\"lazy\" alt=\"change of the mask of {name}\"><figcaption>\
                 <a href=\"#v{at}\">{name}</a><span>IoU {:.3}</span></figcaption></figure>",
                change.uri,
                change.width,
                change.height,
                view.mask_iou.unwrap_or(0.0),
                name = escape(&row.name),
            );
        }
        html.push_str("</div>\n");
        let ranked: Vec<String> = lowest(&audit.views, |view| view.mask_iou)
            .into_iter()
            .filter_map(|view| link(view, view.mask_iou?))
            .collect();
        let _ = writeln!(
            html,
            "<details><summary>all {} masks, least overlap first</summary><p class=\"ranked\">{}</p></details>",
            ranked.len(),
            ranked.join(" · ")
        );
        let missing: Vec<String> = audit
            .views
            .iter()
            .filter(|view| view.mask_iou.is_none())
            .filter_map(|view| {
                let at = number(&view.name)?;
                Some(format!("<a href=\"#v{at}\">{}</a>", escape(&view.name)))
            })
            .collect();
        if !missing.is_empty() {
            let _ = writeln!(
                html,
                "<p class=\"facts\">without a start mask: {}</p>",
                missing.join(" · ")
            );
        }
    }

    if let Some(consistency) = audit.consistency {
        let was = audit.mask_consistency.map_or(String::new(), |start| {
            format!(" (coarse masks: {:.2} %)", 100.0 * start)
        });
        let worst = lowest(&audit.views, |view| view.consistency)
            .into_iter()
            .filter_map(|view| link(view, view.consistency?))
            .take(WORST);
        let unsure = lowest(&audit.views, |view| Some(-view.uncertainty))
            .into_iter()
            .filter_map(|view| link(view, view.uncertainty))
            .take(WORST);
        let _ = writeln!(
            html,
            "<h2 id=\"consistency\">Cross-view consistency and uncertainty</h2>\n<p class=\"lead\">In \
             {:.2} % of looks neighbouring views agree that a place is the object{was}. Each view's matte \
             is carried to six neighbours through its depth; what something else hides there does not \
             count. No ground truth is used. Uncertainty is a matte's softness and the share of views \
             that object.</p>\n<p class=\"facts\">least consistent: {}</p>\n<p class=\"facts\">least \
             certain: {}</p>",
            100.0 * consistency,
            worst.collect::<Vec<_>>().join(" · "),
            unsure.collect::<Vec<_>>().join(" · ")
        );
    }
    html
}

/// The views that have a value, lowest first.
fn lowest(views: &[AuditedView], value: impl Fn(&AuditedView) -> Option<f64>) -> Vec<&AuditedView> {
    let mut ranked: Vec<(&AuditedView, f64)> = views
        .iter()
        .filter_map(|view| Some((view, value(view)?)))
        .collect();
    ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
    ranked.into_iter().map(|(view, _)| view).collect()
}
