//! What a device could reach at best, from its rates alone.
//!
//! The counts are those that the fused ops are measured against ([`fields`](crate::fields)): what the
//! mathematics of a step at the paper's sizes asks for, and what its tables and their optimiser move.
//! Launches, intermediate results and everything else come on top.

use std::fmt;
use std::str::FromStr;

use anyhow::{Context as _, ensure};
use hashgrid::{GridConfig, GridLayout};
use serde::Serialize;

use crate::fields::{Cost, OpSizes, VALUE};

/// Values that the table optimiser reads and writes for each entry: the entry, its gradient, two moments.
pub(crate) const OPTIMISER_VALUES: f64 = 8.0;

/// A device's rates, as in its data sheet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Rates {
    /// Arithmetic in f32, multiply-adds counting two.
    pub(crate) gflops: f64,
    /// To and from memory.
    pub(crate) gbs: f64,
}

impl FromStr for Rates {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Self> {
        let (gflops, gbs) = text
            .split_once(',')
            .context("two numbers are needed, as in 67000,4800")?;
        let number = |text: &str| -> anyhow::Result<f64> {
            let number: f64 = text.trim().parse().context("not a number")?;
            ensure!(number.is_finite() && number > 0.0, "not a positive number");
            Ok(number)
        };
        Ok(Self {
            gflops: number(gflops)?,
            gbs: number(gbs)?,
        })
    }
}

/// The least time of a step at a device's rates.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Prediction {
    rates: Rates,
    samples: usize,
    gflop: f64,
    ops_gb: f64,
    optimiser_gb: f64,
    arithmetic_ms: f64,
    traffic_ms: f64,
    /// No step is faster than the larger of the two.
    step_ms: f64,
    samples_per_s: f64,
}

impl Prediction {
    /// For a step of `samples`, each asked of both fields.
    pub(crate) fn new(rates: Rates, samples: usize) -> Self {
        let grid = GridConfig::default();
        let layout = GridLayout::new(&grid);
        let ops = OpSizes::new(&layout).all();
        let sum = |of: fn(&Cost) -> f64| 2.0 * samples as f64 * ops.iter().map(of).sum::<f64>();
        let values = (layout.entries() * grid.features) as f64;
        let gflop = 1e-9 * sum(|cost| cost.flops);
        // On such a device lines of a gradient are read and written where they are.
        let ops_gb = 1e-9 * sum(|cost| cost.bytes + 2.0 * cost.added);
        let optimiser_gb = 1e-9 * 2.0 * values * OPTIMISER_VALUES * VALUE;
        let arithmetic_ms = 1e3 * gflop / rates.gflops;
        let traffic_ms = 1e3 * (ops_gb + optimiser_gb) / rates.gbs;
        let step_ms = arithmetic_ms.max(traffic_ms);
        Self {
            rates,
            samples,
            gflop,
            ops_gb,
            optimiser_gb,
            arithmetic_ms,
            traffic_ms,
            step_ms,
            samples_per_s: 1e3 * samples as f64 / step_ms,
        }
    }
}

impl fmt::Display for Prediction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "a step at the paper's sizes, {} samples asked of both fields, at {:.0} GFLOP/s and {:.0} GB/s",
            self.samples, self.rates.gflops, self.rates.gbs
        )?;
        writeln!(
            f,
            "    arithmetic  {:8.2} GFLOP                                  {:8.3} ms",
            self.gflop, self.arithmetic_ms
        )?;
        writeln!(
            f,
            "    traffic     {:8.2} GB of the ops, {:.2} GB of the optimiser  {:8.3} ms",
            self.ops_gb, self.optimiser_gb, self.traffic_ms
        )?;
        write!(
            f,
            "no more than {:.1} million samples/s; 40 000 steps in no less than {:.0} s",
            1e-6 * self.samples_per_s,
            40.0 * self.step_ms
        )
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn the_slower_of_both_rates_decides() {
        let of = |text: &str| Prediction::new(text.parse().unwrap(), 65_536);
        let (slow_units, slow_memory) = (of("100,1e9"), of("1e9,10"));
        assert!((slow_units.step_ms - slow_units.arithmetic_ms).abs() < 1e-9);
        assert!((slow_memory.step_ms - slow_memory.traffic_ms).abs() < 1e-9);
        let twice = of("200,1e9");
        assert!((slow_units.step_ms / twice.step_ms - 2.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_pair_of_rates_is_refused() {
        for text in ["", "5", "1,x", "0,1", "1,-1", "1,inf"] {
            assert!(text.parse::<Rates>().is_err(), "{text}");
        }
    }
}
