//! The ops, and whole steps, on a GPU against what it does at best.
//!
//! A device works through a queue: an op's time is that of several in a row, from an empty queue until it is
//! empty again. Costs are those of [`fields`](crate::fields), but that a device adds to a table's gradient
//! where it lies: such lines are read and written in its memory.

mod cases;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use burn::tensor::{Device, Tensor};
use gpu_tensors::{Rates, WeightReads, finish};
use hashgrid::{GridConfig, GridLayout, LazyAdam, TableReads};
use serde::Serialize;
use sos_train::config::Preset;
use sos_train::device::ChosenDevice;

use crate::equal::{self, Sizes};
use crate::fields::{Cost, OpSizes, VALUE};
use crate::predict::OPTIMISER_VALUES;
use crate::steps::{self, StepFigures};
use cases::{Case, Layer, Marching, Rays};

/// Calls between two looks at the clock, and such measurements, of which the fastest counts.
const CALLS: u32 = 4;
const MEASUREMENTS: usize = 3;

/// What one run found on a device.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct DeviceReport {
    device: String,
    /// At the paper's sizes.
    #[serde(flatten)]
    step: DeviceSteps,
    /// Of the sdf field's forward and backward together.
    roofline_share: f64,
    peak_gflops: f64,
    peak_gbs: f64,
    ops: Vec<DeviceOp>,
    preset_steps: Option<DevicePreset>,
}

/// Steps of one kind. A step is over on the CPU before the device has done it, so that only the time of many
/// tells; phases by the CPU's clock say what the host does and waits for, not what the device does.
#[derive(Clone, Debug, Serialize)]
struct DeviceSteps {
    samples_per_step: f64,
    /// The mean.
    step_ms: f64,
    trained_samples_per_s: f64,
    /// Means, of the host.
    host_ms: BTreeMap<String, f64>,
}

impl From<StepFigures> for DeviceSteps {
    fn from(steps: StepFigures) -> Self {
        Self {
            samples_per_step: steps.samples_per_step,
            step_ms: 1e3 * steps.samples_per_step / steps.trained_samples_per_s,
            trained_samples_per_s: steps.trained_samples_per_s,
            host_ms: steps.phase_ms,
        }
    }
}

impl fmt::Display for DeviceSteps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:.1} ms for {:.0} samples, {:.0} samples/s",
            self.step_ms, self.samples_per_step, self.trained_samples_per_s
        )?;
        let phases = self.host_ms.iter().filter(|(_, ms)| **ms >= 0.05);
        let phases: Vec<String> = phases.map(|(name, ms)| format!("{name} {ms:.1}")).collect();
        writeln!(f, "    the host's, ms: {}", phases.join(", "))
    }
}

/// A short run of a preset.
#[derive(Clone, Debug, Serialize)]
struct DevicePreset {
    preset: Preset,
    /// None where both fields learn from the start.
    background_alone: Option<DeviceSteps>,
    both_fields: DeviceSteps,
}

/// One op in one direction, at as many points as a step of the paper's sizes has.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct DeviceOp {
    name: &'static str,
    points: usize,
    ms: f64,
    /// Of the device's multiply-adds.
    arithmetic_share: f64,
    /// Of the device's copies.
    bandwidth_share: f64,
}

/// Measures the ops, steps at the paper's sizes, and so many of a preset, unless there are none.
pub(crate) fn measure(
    chosen: &ChosenDevice,
    name: &str,
    sizes: Sizes,
    (preset, preset_steps): (Preset, u32),
) -> Result<DeviceReport> {
    let rates = Rates::measure(&chosen.device, chosen.largest_binding)?
        .with_context(|| format!("{} is not run by CubeCL", chosen.name))?;
    let bench = Bench {
        rates,
        device: &chosen.device,
    };
    let ops = bench.ops(sizes)?;
    let step = DeviceSteps::from(equal::measure(sizes, name)?);
    let preset_steps = (preset_steps > 0)
        .then(|| steps::measure(preset, preset_steps, name))
        .transpose()?
        .map(|steps| DevicePreset {
            preset,
            background_alone: steps.background_alone.map(DeviceSteps::from),
            both_fields: steps.both_fields.into(),
        });
    let of_sdf = || ops.iter().filter(|op| op.name.starts_with("sdf"));
    let least = |op: &DeviceOp| op.ms * op.arithmetic_share.max(op.bandwidth_share);
    Ok(DeviceReport {
        device: chosen.name.clone(),
        step,
        roofline_share: of_sdf().map(least).sum::<f64>() / of_sdf().map(|op| op.ms).sum::<f64>(),
        peak_gflops: rates.gflops,
        peak_gbs: rates.copy_gbs,
        ops,
        preset_steps,
    })
}

/// A device with its peaks.
struct Bench<'a> {
    rates: Rates,
    device: &'a Device,
}

impl Bench<'_> {
    /// The seconds of one call.
    fn time(&self, mut call: impl FnMut()) -> Result<f64> {
        // Kernels are compiled.
        call();
        let mut best = f64::INFINITY;
        for _ in 0..MEASUREMENTS {
            finish(self.device)?;
            let begun = Instant::now();
            (0..CALLS).for_each(|_| call());
            finish(self.device)?;
            best = best.min(begun.elapsed().as_secs_f64() / f64::from(CALLS));
        }
        Ok(best)
    }

    /// Both ways of an op, of which the second is what both take beyond the first.
    fn both_ways(
        &self,
        [forward, backward]: [(&'static str, Cost); 2],
        points: usize,
        run: impl Fn() -> Tensor<2>,
        learn: impl Fn() -> Tensor<2>,
    ) -> Result<[DeviceOp; 2]> {
        let there = self.time(|| drop(run()))?;
        let and_back = self.time(|| drop(learn().sum().backward()))?;
        Ok([
            self.figures(forward, points, there),
            self.figures(backward, points, (and_back - there).max(0.0)),
        ])
    }

    fn figures(&self, (name, cost): (&'static str, Cost), points: usize, seconds: f64) -> DeviceOp {
        let rate = |of_point: f64| 1e-9 * of_point * points as f64 / seconds;
        DeviceOp {
            name,
            points,
            ms: 1e3 * seconds,
            arithmetic_share: rate(cost.flops) / self.rates.gflops,
            bandwidth_share: rate(cost.bytes + 2.0 * cost.added) / self.rates.copy_gbs,
        }
    }

    fn ops(&self, sizes: Sizes) -> Result<Vec<DeviceOp>> {
        let points = sizes.rays * sizes.samples;
        let grid = GridConfig::default();
        let layout = Arc::new(GridLayout::new(&grid));
        let costs = OpSizes::new(&layout);
        let [forward, backward, colour_forward, colour_backward] = costs.all();
        let plain = Case::new(points, &layout, self.device);
        let tracked = Case::new(points, &layout, &self.device.clone().autodiff());
        let mut ops = Vec::new();
        ops.extend(self.both_ways(
            [
                ("sdf field forward", forward),
                ("sdf field backward", backward),
            ],
            points,
            || plain.geometry(),
            || tracked.geometry(),
        )?);
        let halved = Arc::new(GridLayout {
            device_reads: TableReads::Half,
            ..GridLayout::clone(&layout)
        });
        let plain_halved = Case::new(points, &halved, self.device);
        let tracked_halved = Case::new(points, &halved, &self.device.clone().autodiff());
        // Shares are of what the op costs otherwise.
        ops.extend(self.both_ways(
            [
                ("halved table, forward", forward),
                ("halved table, backward", backward),
            ],
            points,
            || plain_halved.geometry(),
            || tracked_halved.geometry(),
        )?);
        let geometry = plain.geometry();
        let tracked_geometry = tracked.geometry().detach().require_grad();
        ops.extend(self.both_ways(
            [
                ("colour field forward", colour_forward),
                ("colour field backward", colour_backward),
            ],
            points,
            || plain.colour(geometry.clone()),
            || tracked.colour(tracked_geometry.clone()),
        )?);
        let rays = Rays::new(sizes, self.device);
        let tracked_rays = Rays::new(sizes, &self.device.clone().autodiff()).learnt();
        ops.extend(self.both_ways(
            [
                ("compositing forward", Rays::cost(1.0)),
                // Reads rows, computes again, writes their gradients.
                ("compositing backward", Rays::cost(2.0)),
            ],
            points,
            || rays.pixels(),
            || tracked_rays.pixels(),
        )?);
        for (name, reads) in [
            ("layer, weights cached", WeightReads::Cached),
            ("layer, weights shared", WeightReads::Shared),
        ] {
            if let Some(layer) = Layer::new(points, reads, self.device) {
                let seconds = self.time(|| layer.apply())?;
                ops.push(self.figures((name, Layer::COST), points, seconds));
            }
        }
        let marching = Marching::new(sizes, self.device);
        let seconds = self.time(|| marching.march())?;
        ops.push(self.figures(("marching", Marching::COST), points, seconds));
        let mut table = plain;
        let mut adam = LazyAdam::new(&layout);
        // There has to be a gradient, or next to nothing is done.
        let learning = self.time(|| drop(tracked.geometry().sum().backward()))?;
        let with_step = self.time(|| {
            drop(tracked.geometry().sum().backward());
            adam.step_grid(&mut table.surface.grid, &tracked.gradient, 1e-4);
        })?;
        let seconds = (with_step - learning).max(0.0);
        let values = (layout.entries() * grid.features) as f64;
        let update = Cost {
            flops: 0.0,
            bytes: values * OPTIMISER_VALUES * VALUE / points as f64,
            scattered: 0.0,
            added: 0.0,
        };
        ops.push(self.figures(("table optimiser", update), points, seconds));
        Ok(ops)
    }
}

impl fmt::Display for DeviceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: multiply-adds at {:.0} GFLOP/s, copies at {:.1} GB/s",
            self.device, self.peak_gflops, self.peak_gbs
        )?;
        let points = self.ops.first().map_or(0, |op| op.points);
        writeln!(
            f,
            "ops, {points} points, 2^19 entries: time, and shares of multiply-adds and of copies"
        )?;
        for op in &self.ops {
            writeln!(
                f,
                "    {:<24} {:9.3} ms {:6.2} % {:6.2} %",
                op.name,
                op.ms,
                100.0 * op.arithmetic_share,
                100.0 * op.bandwidth_share
            )?;
        }
        writeln!(
            f,
            "    {:<24} {:.1} % of its roofline",
            "sdf field, both",
            100.0 * self.roofline_share
        )?;
        write!(f, "step at the paper's sizes: {}", self.step)?;
        let Some(steps) = &self.preset_steps else {
            return Ok(());
        };
        let alone = steps.background_alone.as_ref();
        let kinds = alone.map(|step| ("the background alone", step));
        for (name, step) in (kinds.into_iter()).chain([("both fields", &steps.both_fields)]) {
            write!(f, "{} preset, {name}: {step}", steps.preset)?;
        }
        Ok(())
    }
}
