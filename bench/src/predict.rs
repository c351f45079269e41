//! What a device could reach at best, from its rates alone, and what the processor beside it leaves of that.
//!
//! The counts are those that the fused ops are measured against ([`fields`](crate::fields)): what the
//! mathematics of a step at the paper's sizes asks for, and what its tables and their optimiser move.
//! Launches, intermediate results and everything else come on top.
//!
//! Training needs more than ops. Whatever trains, the CPU gathers samples, keeps occupancy and counts votes; what
//! that takes was measured ([`CpuWork`]), and is spread over the cores that there are. Both tables are copied to
//! the host every so many steps, beside that.

use std::fmt;
use std::str::FromStr;

use anyhow::{Context as _, ensure};
use hashgrid::{GridConfig, GridLayout};
use serde::Serialize;

use crate::fields::{Cost, OpSizes, VALUE};

/// Values that the table optimiser reads and writes for each entry: the entry, its gradient, two moments.
pub(crate) const OPTIMISER_VALUES: f64 = 8.0;

/// Steps between two copies of both tables to the host, as `sos-train/src/train/outlook.rs` has it.
const STEPS_A_COPY: f64 = 16.0;
/// Assumed of that copy, in GB/s: a fifth of what PCIe 5 carries over 16 lanes, for it passes through
/// memory that the driver maps, and is copied once more there.
const LINK_GBS: f64 = 10.0;

/// What the CPU does in a step whatever trains, measured on two cores of an EPYC (Zen 5) with steps of the
/// default preset on both fields, 9.8 ms for 8192 samples: the phases in `docs/performance.md`.
struct CpuWork;

impl CpuWork {
    /// Gathering, 31.1 % on both cores: samples that a core gathers in a second.
    const GATHERED: f64 = 8192.0 / (2.0 * 0.311 * 9.8e-3);
    /// Occupancy grids, 12.0 % on both cores: milliseconds of a core.
    const OCCUPANCY_MS: f64 = 2.0 * 0.120 * 9.8;
    /// Votes of the default preset: milliseconds of the one thread that adds them up, and of a core for m^P, which
    /// is renewed now and then. From 1.65 and 0.93 ms with one and two threads (`cargo xtask bench --default-steps 1500`)
    /// on cores without AVX-512 that gather a third as fast: the most that it can be.
    const VOTES_ADDED_MS: f64 = 0.21;
    const VOTES_SPREAD_MS: f64 = 1.44;
    /// Preparation, pictures and report of `toy_plane_orbit`: 48 s on both cores, seconds of a core.
    const AROUND_S: f64 = 2.0 * 48.0;
}

/// A device's rates, as in its data sheet, and what is beside it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Rates {
    /// Arithmetic in f32, multiply-adds counting two.
    pub(crate) gflops: f64,
    /// To and from memory.
    pub(crate) gbs: f64,
    /// Cores of the processor, if training is to be predicted as well.
    pub(crate) cores: Option<f64>,
}

impl FromStr for Rates {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Self> {
        let number = |text: &str| -> anyhow::Result<f64> {
            let number: f64 = text.trim().parse().context("not a number")?;
            ensure!(number.is_finite() && number > 0.0, "not a positive number");
            Ok(number)
        };
        let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
        let (gflops, gbs, cores) = match *numbers {
            [gflops, gbs] => (gflops, gbs, None),
            [gflops, gbs, cores] => (gflops, gbs, Some(cores)),
            _ => anyhow::bail!(
                "two numbers are needed, as in 67000,4800, or three, with the processor's cores, as in \
                 67000,4800,16"
            ),
        };
        Ok(Self { gflops, gbs, cores })
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
    training: Option<Training>,
}

impl Prediction {
    /// For a step of `samples`, each asked of both fields.
    pub(crate) fn new(rates: Rates, samples: usize) -> Self {
        let paper = Device::new(rates, &GridConfig::default(), 2.0 * samples as f64);
        let step_ms = paper.ms();
        Self {
            rates,
            samples,
            gflop: paper.gflop,
            ops_gb: paper.ops_gb,
            optimiser_gb: paper.optimiser_gb,
            arithmetic_ms: paper.arithmetic_ms,
            traffic_ms: paper.traffic_ms,
            step_ms,
            samples_per_s: 1e3 * samples as f64 / step_ms,
            training: rates
                .cores
                .map(|cores| Training::new(rates, cores, samples, &paper)),
        }
    }
}

/// What the device does in a step.
struct Device {
    gflop: f64,
    ops_gb: f64,
    optimiser_gb: f64,
    arithmetic_ms: f64,
    traffic_ms: f64,
    /// Both tables.
    tables_gb: f64,
}

impl Device {
    /// With both fields on such a grid, asked for so many values in all.
    fn new(rates: Rates, grid: &GridConfig, asked: f64) -> Self {
        let layout = GridLayout::new(grid);
        let ops = OpSizes::new(&layout).all();
        let sum = |of: fn(&Cost) -> f64| asked * ops.iter().map(of).sum::<f64>();
        let values = (layout.entries() * grid.features) as f64;
        let gflop = 1e-9 * sum(|cost| cost.flops);
        // On such a device lines of a gradient are read and written where they are.
        let ops_gb = 1e-9 * sum(|cost| cost.bytes + 2.0 * cost.added);
        let optimiser_gb = 1e-9 * 2.0 * values * OPTIMISER_VALUES * VALUE;
        Self {
            gflop,
            ops_gb,
            optimiser_gb,
            arithmetic_ms: 1e3 * gflop / rates.gflops,
            traffic_ms: 1e3 * (ops_gb + optimiser_gb) / rates.gbs,
            tables_gb: 1e-9 * 2.0 * values * VALUE,
        }
    }

    fn ms(&self) -> f64 {
        self.arithmetic_ms.max(self.traffic_ms)
    }
}

/// Whether m^P comes from votes on surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Votes {
    /// As in the default preset.
    Cast,
    /// The preset `paper` has the soft hull.
    None,
}

/// A step of training: device, processor and the link between them work beside each other.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct TrainingStep {
    samples: f64,
    gathering_ms: f64,
    occupancy_ms: f64,
    votes_ms: f64,
    copies_ms: f64,
    device_ms: f64,
    step_ms: f64,
}

impl TrainingStep {
    fn new(cores: f64, samples: f64, votes: Votes, device: &Device) -> Self {
        let votes_ms = match votes {
            Votes::Cast => CpuWork::VOTES_ADDED_MS + CpuWork::VOTES_SPREAD_MS / cores,
            Votes::None => 0.0,
        };
        let gathering_ms = 1e3 * samples / (CpuWork::GATHERED * cores);
        let occupancy_ms = CpuWork::OCCUPANCY_MS / cores;
        let copies_ms = 1e3 * device.tables_gb / LINK_GBS / STEPS_A_COPY;
        let device_ms = device.ms();
        let cpu_ms = gathering_ms + occupancy_ms + votes_ms;
        Self {
            samples,
            gathering_ms,
            occupancy_ms,
            votes_ms,
            copies_ms,
            device_ms,
            step_ms: device_ms.max(cpu_ms).max(copies_ms),
        }
    }

    fn cpu_ms(&self) -> f64 {
        self.gathering_ms + self.occupancy_ms + self.votes_ms
    }

    /// How many times its least time the device may take for a step of `ms`; `None` where the rest takes
    /// longer than that.
    fn slack(&self, ms: f64) -> Option<f64> {
        (ms >= self.cpu_ms().max(self.copies_ms)).then(|| ms / self.device_ms)
    }
}

/// What that makes of training, and of what is aimed at.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Training {
    cores: f64,
    /// The preset `paper`, with all the samples that it may have.
    paper: TrainingStep,
    samples_per_s: f64,
    long_run_s: f64,
    /// The default preset on `toy_plane_orbit`.
    default_preset: TrainingStep,
    short_run_s: f64,
    around_s: f64,
}

/// Samples of a step of the default preset, each of one field.
const DEFAULT_SAMPLES: f64 = 8192.0;
/// Steps in which `toy_plane_orbit` reaches an IoU of 0.978 on the CPU.
const SHORT_RUN: f64 = 3000.0;
const LONG_RUN: f64 = 40_000.0;
/// What is aimed at: samples a second, and seconds of either run.
const AIM_SAMPLES: f64 = 8e6;
const AIM_LONG_S: f64 = 180.0;
const AIM_SHORT_S: f64 = 60.0;

impl Training {
    fn new(rates: Rates, cores: f64, samples: usize, paper: &Device) -> Self {
        let paper = TrainingStep::new(cores, samples as f64, Votes::None, paper);
        let grid = GridConfig {
            log2_table_size: 18,
            ..GridConfig::default()
        };
        let device = Device::new(rates, &grid, DEFAULT_SAMPLES);
        let default_preset = TrainingStep::new(cores, DEFAULT_SAMPLES, Votes::Cast, &device);
        Self {
            cores,
            samples_per_s: 1e3 * paper.samples / paper.step_ms,
            long_run_s: 1e-3 * LONG_RUN * paper.step_ms,
            short_run_s: 1e-3 * SHORT_RUN * default_preset.step_ms,
            around_s: CpuWork::AROUND_S / cores,
            paper,
            default_preset,
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
        )?;
        match &self.training {
            Some(training) => write!(f, "\n{training}"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for Training {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "training, with {} cores that gather {:.2} million samples/s each, and a link of {LINK_GBS:.0} GB/s",
            self.cores,
            1e-6 * CpuWork::GATHERED
        )?;
        for (name, step) in [
            ("the paper's", &self.paper),
            ("the default", &self.default_preset),
        ] {
            writeln!(
                f,
                "    {name} preset, {:.0} samples: device {:.3} ms, beside it gathering {:.2}, occupancy {:.2}, \
                 votes {:.2} ms, and copies {:.2} ms: {:.2} ms",
                step.samples,
                step.device_ms,
                step.gathering_ms,
                step.occupancy_ms,
                step.votes_ms,
                step.copies_ms,
                step.step_ms
            )?;
        }
        let long = Verdict {
            met: self.long_run_s <= AIM_LONG_S,
            slack: self.paper.slack(1e3 * AIM_LONG_S / LONG_RUN),
        };
        let rate = Verdict {
            met: self.samples_per_s >= AIM_SAMPLES,
            slack: self.paper.slack(1e3 * self.paper.samples / AIM_SAMPLES),
        };
        let left = AIM_SHORT_S - self.around_s;
        let short = Verdict {
            met: self.short_run_s <= left,
            slack: self.default_preset.slack(1e3 * left / SHORT_RUN),
        };
        writeln!(
            f,
            "    {:.1} million samples/s; 8 are aimed at: {rate}",
            1e-6 * self.samples_per_s
        )?;
        writeln!(
            f,
            "    40 000 steps in {:.0} s; {AIM_LONG_S:.0} are aimed at: {long}",
            self.long_run_s
        )?;
        write!(
            f,
            "    toy_plane_orbit in {:.0} s, {:.0} of them for what is around 3000 steps; {AIM_SHORT_S:.0} are aimed \
             at: {short}",
            self.short_run_s + self.around_s,
            self.around_s
        )
    }
}

/// Whether an aim is within reach.
struct Verdict {
    met: bool,
    /// How many times its least time the device may take.
    slack: Option<f64>,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.slack {
            Some(slack) if self.met => {
                write!(
                    f,
                    "met if the device takes at most {slack:.1} times its least time"
                )
            }
            Some(slack) => {
                let faster = slack.recip();
                write!(
                    f,
                    "missed: the device would have to be {faster:.1} times as fast"
                )
            }
            None => write!(f, "missed, however fast the device is"),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn of(text: &str) -> Prediction {
        Prediction::new(text.parse().unwrap(), 65_536)
    }

    #[test]
    fn the_slower_of_both_rates_decides() {
        let (slow_units, slow_memory) = (of("100,1e9"), of("1e9,10"));
        assert!((slow_units.step_ms - slow_units.arithmetic_ms).abs() < 1e-9);
        assert!((slow_memory.step_ms - slow_memory.traffic_ms).abs() < 1e-9);
        let twice = of("200,1e9");
        assert!((slow_units.step_ms / twice.step_ms - 2.0).abs() < 1e-6);
        assert!(twice.training.is_none());
    }

    #[test]
    fn training_waits_for_the_slowest_of_device_processor_and_link() {
        let training = |text: &str| of(text).training.unwrap();
        // No device is fast enough for two cores, and enough of them leave it to the device.
        let few = training("1e9,1e9,2");
        assert!((few.paper.step_ms - few.paper.cpu_ms()).abs() < 1e-9);
        assert!(few.samples_per_s < 3e6);
        let many = training("100,10,1e6");
        assert!((many.paper.step_ms - many.paper.device_ms).abs() < 1e-9);
        let (few, many) = (few.to_string(), many.to_string());
        assert!(few.contains("however fast"), "{few}");
        assert!(
            many.contains("times as fast") && !many.contains("however"),
            "{many}"
        );
        let both = training("1e9,1e9,1e6");
        let text = both.to_string();
        assert!(!text.contains("missed"), "{text}");
        // Copies remain, and with votes the thread that adds them up.
        assert!(
            (both.paper.step_ms - both.paper.copies_ms).abs() < 1e-9,
            "{text}"
        );
        assert!(both.default_preset.votes_ms > 0.2, "{text}");
    }

    #[test]
    fn what_is_no_list_of_rates_is_refused() {
        for text in ["", "5", "1,x", "0,1", "1,-1", "1,inf", "1,2,0", "1,2,3,4"] {
            assert!(text.parse::<Rates>().is_err(), "{text}");
        }
        assert_eq!("1,2".parse::<Rates>().unwrap().cores, None);
        assert_eq!("1,2,3".parse::<Rates>().unwrap().cores, Some(3.0));
    }
}
