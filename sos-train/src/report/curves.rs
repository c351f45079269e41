//! Training curves as SVG.
//!
//! Drawn by hand in a page or so, and not by a plotting crate, so that the page's style sheet decides
//! colours and fonts, in light and dark.

use serde_json::{Map, Value};
use std::fmt::Write as _;

/// A curve has at most this many points; more cannot be told apart.
const MAX_POINTS: usize = 320;
/// Size of a plot and of the part the curves may use.
const SIZE: (f64, f64) = (400.0, 210.0);
const LEFT: f64 = 46.0;
const RIGHT: f64 = 392.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 184.0;

/// How values become heights.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scale {
    Linear,
    /// Linear, and zero is shown: for what would otherwise look wilder than it is.
    FromZero,
    Log,
}

struct Curve {
    name: String,
    /// Step and value, both finite, steps rising.
    points: Vec<(f64, f64)>,
}

/// All plots that the log has something for, each a `<figure>`.
pub(crate) fn plots(log: &[Map<String, Value>]) -> String {
    let records: Vec<&Map<String, Value>> = log
        .iter()
        .filter(|line| !line.contains_key("event"))
        .collect();
    let one = |key: &str, name: &str| -> Vec<Curve> {
        curve(&records, name, |record| record.get(key))
            .into_iter()
            .collect()
    };
    let mut losses: Vec<String> = records
        .iter()
        .filter_map(|record| record.get("losses")?.as_object())
        .flat_map(|losses| losses.keys().cloned())
        .collect();
    losses.sort();
    losses.dedup();
    let losses = losses
        .iter()
        .filter_map(|key| curve(&records, key, |record| record.get("losses")?.get(key)))
        .collect();
    let mut sharpness = one("sharpness", "object");
    sharpness.extend(one("sharpness_background", "background"));
    [
        (
            "PSNR of training rays, dB",
            Scale::Linear,
            one("psnr", "PSNR"),
        ),
        ("losses, before their weights", Scale::Log, losses),
        ("sharpness b", Scale::Log, sharpness),
        (
            "change of the mattes",
            Scale::Log,
            one("alpha_change", "alpha change"),
        ),
        (
            "samples a second",
            Scale::FromZero,
            one("samples_per_second", "samples/s"),
        ),
        (
            "hash levels in use",
            Scale::FromZero,
            one("levels", "levels"),
        ),
    ]
    .into_iter()
    .filter_map(|(title, scale, curves)| plot(title, scale, curves))
    .collect()
}

fn curve<'a>(
    records: &[&'a Map<String, Value>],
    name: &str,
    value: impl Fn(&'a Map<String, Value>) -> Option<&'a Value>,
) -> Option<Curve> {
    let points: Vec<(f64, f64)> = records
        .iter()
        .filter_map(|&record| {
            let step = record.get("step")?.as_f64()?;
            // What was not a number is null in the log.
            let value = value(record)?.as_f64().filter(|v| v.is_finite())?;
            Some((step, value))
        })
        .collect();
    (points.len() > 1).then(|| Curve {
        name: name.to_owned(),
        points: thinned(&points),
    })
}

/// Means over equal runs of points.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let run = points.len().div_ceil(MAX_POINTS);
    points
        .chunks(run)
        .map(|part| {
            let n = part.len() as f64;
            let sum = part
                .iter()
                .fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
            (sum.0 / n, sum.1 / n)
        })
        .collect()
}

fn plot(title: &str, scale: Scale, mut curves: Vec<Curve>) -> Option<String> {
    if scale == Scale::Log {
        for curve in &mut curves {
            curve.points.retain(|(_, value)| *value > 0.0);
            for point in &mut curve.points {
                point.1 = point.1.log10();
            }
        }
    }
    curves.retain(|curve| curve.points.len() > 1);
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let (mut low, mut high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
        (low.min(p.1), high.max(p.1))
    });
    let last = all().map(|p| p.0).fold(0.0, f64::max);
    if !(low.is_finite() && high.is_finite()) || last <= 0.0 {
        return None;
    }
    let ticks = match scale {
        Scale::Linear => ticks(low, high),
        Scale::FromZero => ticks(low.min(0.0), high),
        Scale::Log => log_ticks(low, high),
    };
    if let (Some(first), Some(final_)) = (ticks.first(), ticks.last()) {
        (low, high) = (low.min(*first), high.max(*final_));
    }
    if high - low < 1e-9 {
        (low, high) = (low - 0.5, high + 0.5);
    }
    let x = |step: f64| LEFT + step / last * (RIGHT - LEFT);
    let y = |value: f64| BOTTOM - (value - low) / (high - low) * (BOTTOM - TOP);

    // Writing to a string cannot fail.
    let mut svg = format!(
        "<figure class=\"plot\"><figcaption>{title}</figcaption>\n<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{title}\">\n",
        SIZE.0, SIZE.1
    );
    for tick in ticks {
        let shown = match scale {
            Scale::Linear | Scale::FromZero => label(tick),
            Scale::Log => label(10_f64.powf(tick)),
        };
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{RIGHT}\" y1=\"{0:.1}\" y2=\"{0:.1}\"/><text class=\"y\" x=\"{1}\" y=\"{2:.1}\">{shown}</text>",
            y(tick),
            LEFT - 6.0,
            y(tick) + 3.5
        );
    }
    for step in ticks_of_steps(last) {
        let _ = writeln!(
            svg,
            "<text class=\"x\" x=\"{:.1}\" y=\"{}\">{}</text>",
            x(step),
            BOTTOM + 16.0,
            label(step)
        );
    }
    for (number, curve) in curves.iter().enumerate() {
        let points: String = curve
            .points
            .iter()
            .map(|p| format!("{:.1},{:.1} ", x(p.0), y(p.1)))
            .collect();
        let _ = writeln!(
            svg,
            "<polyline class=\"curve s{}\" points=\"{}\"/>",
            number % 8,
            points.trim_end()
        );
    }
    svg.push_str("</svg>\n");
    if curves.len() > 1 {
        svg.push_str("<div class=\"legend\">");
        for (number, curve) in curves.iter().enumerate() {
            let _ = write!(
                svg,
                "<span><i class=\"s{}\"></i>{}</span>",
                number % 8,
                html_escape::encode_quoted_attribute(&curve.name)
            );
        }
        svg.push_str("</div>\n");
    }
    svg.push_str("</figure>\n");
    Some(svg)
}

/// Round values across a range, four or so.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let span = (high - low).max(1e-9);
    let rough = span / 4.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| *s >= rough);
    let step = step.unwrap_or(10.0 * power);
    let first = (low / step).floor() as i64;
    let last = (high / step).ceil() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Powers of ten across a range of logarithms, at most seven or so.
fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    let (first, last) = (low.floor() as i64, high.ceil() as i64);
    let every = ((last - first) / 5).max(1);
    (first..=last)
        .step_by(every as usize)
        .map(|i| i as f64)
        .collect()
}

fn ticks_of_steps(last: f64) -> Vec<f64> {
    ticks(0.0, last)
        .into_iter()
        .filter(|step| *step <= last * 1.001)
        .collect()
}

/// 0.05, 12, 3 k, 1.5 M; powers of ten below a thousandth as 1e-4.
fn label(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".to_owned();
    }
    let trimmed = |value: f64| {
        let text = format!("{value:.2}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    match size {
        s if s >= 1e6 => format!("{} M", trimmed(value / 1e6)),
        s if s >= 1e3 => format!("{} k", trimmed(value / 1e3)),
        s if s >= 0.01 => trimmed(value),
        s if s >= 0.000_999 => format!("{value:.3}"),
        _ => format!("{value:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn log(lines: impl IntoIterator<Item = Value>) -> Vec<Map<String, Value>> {
        lines
            .into_iter()
            .filter_map(|line| line.as_object().cloned())
            .collect()
    }

    #[test]
    fn ticks_are_round_and_cover_the_range() {
        assert_eq!(ticks(12.3, 27.9), [10.0, 15.0, 20.0, 25.0, 30.0]);
        assert_eq!(log_ticks(-2.4, -0.1), [-3.0, -2.0, -1.0, 0.0]);
        assert!(log_ticks(-20.0, 3.0).len() <= 7);
    }

    #[test]
    fn labels_are_short() {
        let shown = [0.0, 0.05, 12.0, 2500.0, 1.5e6, 1e-3, 1e-5].map(label);
        assert_eq!(
            shown,
            ["0", "0.05", "12", "2.5 k", "1.5 M", "0.001", "1e-5"]
        );
    }

    #[test]
    fn gaps_and_events_are_skipped() {
        let lines = [
            json!({"step": 0, "event": "start"}),
            json!({"step": 10, "psnr": 12.0}),
            json!({"step": 20, "psnr": null}),
            json!({"step": 30, "psnr": 18.0}),
        ];
        let svg = plots(&log(lines));
        assert_eq!(svg.matches("<polyline").count(), 1);
        assert!(!svg.contains("NaN"));
    }

    #[test]
    fn a_log_without_records_has_no_plots() {
        assert_eq!(plots(&[]), "");
        assert_eq!(plots(&log([json!({"step": 5, "psnr": 1.0})])), "");
    }

    #[test]
    fn long_logs_are_thinned() {
        let points: Vec<(f64, f64)> = (0..10_000).map(|i| (f64::from(i), 1.0)).collect();
        let thin = thinned(&points);
        assert!(thin.len() <= MAX_POINTS && thin.iter().all(|p| p.1 == 1.0));
    }
}
