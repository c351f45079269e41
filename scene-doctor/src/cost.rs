//! What a training will take.

use crate::directions::rounded;
use crate::finding::Finding;

/// An estimate, and what it rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Training steps.
    pub steps: u32,
    /// Least and most minutes of training and writing the results; none if nothing was measured.
    pub minutes: Option<[f64; 2]>,
    /// Bytes of memory at the peak.
    pub memory: u64,
    /// Bytes of the memory that the system has left, if it says.
    pub memory_left: Option<u64>,
    /// Bytes of the run folder.
    pub disk: u64,
    /// What was measured or counted, in a few words.
    pub basis: String,
}

/// More minutes than this are not what anyone expects.
const LONG: f64 = 180.0;

/// The estimate; a warning where it takes very long or it does not fit into memory.
#[must_use]
pub fn cost(cost: &Cost) -> Finding {
    let mut says = String::new();
    if let Some([least, most]) = cost.minutes {
        says.push_str(&format!(
            "{} for {} steps, ",
            minutes(least, most),
            cost.steps
        ));
    }
    says.push_str(&format!(
        "about {} of memory and {} on disk ({})",
        bytes(cost.memory),
        bytes(cost.disk),
        cost.basis
    ));
    let [least, most] = cost.minutes.unwrap_or([f64::NAN; 2]);
    let finding = Finding::pass("cost", says)
        .number("steps", cost.steps)
        .number("minutes_least", rounded(least))
        .number("minutes_most", rounded(most))
        .number("memory_bytes", cost.memory)
        .number("disk_bytes", cost.disk);
    match cost.memory_left {
        Some(left) if left < cost.memory => finding.warn(format!(
            "only {} of memory are free; close other programs, or train on smaller photos (--downscale)",
            bytes(left)
        )),
        _ if least > LONG => finding.warn(
            "see first whether the object's box is right; then try --preset quick, or smaller photos",
        ),
        _ => finding,
    }
}

fn minutes(least: f64, most: f64) -> String {
    let (unit, scale) = if least > 100.0 {
        ("h", 60.0)
    } else {
        ("min", 1.0)
    };
    let of = |minutes: f64| match minutes / scale {
        time if time < 19.5 => format!("{:.0}", time.max(1.0)),
        time => format!("{:.0}", 5.0 * (time / 5.0).round()),
    };
    match (of(least), of(most)) {
        (a, b) if a == b => format!("about {a} {unit}"),
        (a, b) => format!("{a} to {b} {unit}"),
    }
}

fn bytes(bytes: u64) -> String {
    let megabytes = bytes as f64 / 1e6;
    if megabytes < 995.0 {
        format!("{:.0} MB", 10.0 * (megabytes / 10.0).ceil())
    } else {
        format!("{:.1} GB", megabytes / 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Status;

    #[test]
    fn an_estimate_reads_like_one() {
        let estimate = Cost {
            steps: 8000,
            minutes: Some([4.2, 11.0]),
            memory: 812_000_000,
            memory_left: Some(2_000_000_000),
            disk: 1_240_000_000,
            basis: "measured".to_owned(),
        };
        let finding = cost(&estimate);
        assert_eq!(
            finding.says,
            "4 to 11 min for 8000 steps, about 820 MB of memory and 1.2 GB on disk (measured)"
        );
        assert_eq!(finding.status, Status::Pass);
        let tight = Cost {
            memory_left: Some(500_000_000),
            minutes: None,
            ..estimate
        };
        assert_eq!(cost(&tight).status, Status::Warn);
        assert!(cost(&tight).says.starts_with("about 820 MB"));
    }
}
