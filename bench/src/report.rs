//! All figures, as JSON or for people.

use std::collections::BTreeMap;
use std::fmt;

use hashgrid::Hash;
use serde::Serialize;
use sos_train::config::{Preset, TrainConfig};

use crate::fields::OpFigures;
use crate::peaks::Peaks;
use crate::steps::{PresetSteps, StepFigures};
use crate::torch::TorchFigures;

/// Our step and PyTorch's, one after the other.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Comparison {
    pub(crate) ours_samples_per_s: f64,
    pub(crate) torch: TorchFigures,
    pub(crate) ratio: f64,
}

/// What one run found. The first figures are those of the step at the paper's sizes.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    threads: usize,
    trained_samples_per_s: f64,
    step_ms: f64,
    phase_ms: BTreeMap<String, f64>,
    phase_share: BTreeMap<String, f64>,
    overhead_share: f64,
    /// Of the sdf field's forward and backward together, on all cores, with the hash of the default preset.
    roofline_share: f64,
    peak_gflops: f64,
    peak_gbs: f64,
    peaks: Peaks,
    ops: Vec<OpFigures>,
    against_torch: Vec<Comparison>,
    preset_steps: Option<PresetSteps>,
}

impl Report {
    /// `ours` are measurements of the same step, of which the fastest counts.
    pub(crate) fn new(
        threads: usize,
        peaks: Peaks,
        ops: Vec<OpFigures>,
        ours: Vec<StepFigures>,
        against_torch: Vec<Comparison>,
        preset_steps: Option<PresetSteps>,
    ) -> Self {
        let best = ours
            .into_iter()
            .max_by(|a, b| a.trained_samples_per_s.total_cmp(&b.trained_samples_per_s))
            .unwrap_or_default();
        let (peak_gflops, peak_gbs) = peaks.of(false);
        let hash = TrainConfig::preset(Preset::Default).model.hash;
        Self {
            threads,
            trained_samples_per_s: best.trained_samples_per_s,
            step_ms: best.step_ms,
            phase_ms: best.phase_ms,
            phase_share: best.phase_share,
            overhead_share: best.overhead_share,
            roofline_share: sdf_share(&ops, hash, false, |op| op.traffic_ms),
            peak_gflops,
            peak_gbs,
            peaks,
            ops,
            against_torch,
            preset_steps,
        }
    }
}

/// The sdf field forward and backward: their rooflines' time over their own, with `traffic` taking so
/// many milliseconds.
fn sdf_share(
    ops: &[OpFigures],
    hash: Hash,
    one_core: bool,
    traffic: impl Fn(&OpFigures) -> f64,
) -> f64 {
    let of_sdf =
        |op: &&OpFigures| op.name.starts_with("sdf") && op.hash == hash && op.one_core == one_core;
    let (mut least, mut taken) = (0.0, 0.0);
    for op in ops.iter().filter(of_sdf) {
        least += op.arithmetic_ms.max(op.added_ms).max(traffic(op));
        taken += op.ms;
    }
    if taken > 0.0 { least / taken } else { 0.0 }
}

/// What is said of an op where the grid hashes something else than the paper's does.
fn suffix(hash: Hash) -> &'static str {
    match hash {
        Hash::Nodes => "",
        Hash::Blocks => ", blocks",
    }
}

fn phases(
    f: &mut fmt::Formatter<'_>,
    ms: &BTreeMap<String, f64>,
    share: &BTreeMap<String, f64>,
) -> fmt::Result {
    let mut rows: Vec<_> = ms.iter().collect();
    rows.sort_by(|a, b| b.1.total_cmp(a.1));
    for (name, ms) in rows {
        let share = share.get(name).copied().unwrap_or(0.0);
        writeln!(f, "    {name:<24} {ms:8.2} ms  {:5.1} %", 100.0 * share)?;
    }
    Ok(())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let p = &self.peaks;
        writeln!(f, "peaks, one core / {} cores", self.threads)?;
        writeln!(
            f,
            "    multiply-add  {:7.1} / {:7.1} GFLOP/s",
            p.gflops_one_core, p.gflops
        )?;
        writeln!(
            f,
            "    copy          {:7.1} / {:7.1} GB/s",
            p.copy_gbs_one_core, p.copy_gbs
        )?;
        writeln!(
            f,
            "    triad         {:7.1} / {:7.1} GB/s",
            p.triad_gbs_one_core, p.triad_gbs
        )?;
        writeln!(
            f,
            "    random lines  {:7.1} / {:7.1} GB/s",
            p.lines_gbs_one_core, p.lines_gbs
        )?;
        writeln!(
            f,
            "    added lines   {:7.1} / {:7.1} GB/s",
            p.added_lines_gbs_one_core, p.added_lines_gbs
        )?;
        for one_core in [true, false] {
            let cores = if one_core {
                "one core".to_owned()
            } else {
                format!("{} cores", self.threads)
            };
            let ops = || self.ops.iter().filter(|op| op.one_core == one_core);
            let points = ops().next().map_or(0, |op| op.points);
            writeln!(f, "fused ops, {points} points, 2^19 entries, {cores}")?;
            for op in ops() {
                writeln!(
                    f,
                    "    {:<28} {:7.2} ms {:6.1} GFLOP/s {:5.1} GB/s; at the peaks {:5.2}, {:5.2} \
                     and {:5.2} ms: {:4.1} %",
                    format!("{}{}", op.name, suffix(op.hash)),
                    op.ms,
                    op.gflops,
                    op.gbs,
                    op.arithmetic_ms,
                    op.traffic_ms,
                    op.added_ms,
                    100.0 * op.roofline_share
                )?;
            }
            for hash in [Hash::Nodes, Hash::Blocks] {
                let share = |traffic: fn(&OpFigures) -> f64| {
                    100.0 * sdf_share(&self.ops, hash, one_core, traffic)
                };
                writeln!(
                    f,
                    "    {:<28} {:.1} % of its roofline; {:.1} % of one with lines at random",
                    format!("sdf field, both ways{}", suffix(hash)),
                    share(|op| op.traffic_ms),
                    share(|op| op.scattered_traffic_ms)
                )?;
            }
        }
        writeln!(
            f,
            "step at the paper's sizes: {:.1} ms, {:.0} samples/s; optimisers and bookkeeping {:.1} %",
            self.step_ms,
            self.trained_samples_per_s,
            100.0 * self.overhead_share
        )?;
        phases(f, &self.phase_ms, &self.phase_share)?;
        for comparison in &self.against_torch {
            writeln!(
                f,
                "against torch {}, {} threads: {:.0} / {:.0} samples/s = {:.1}",
                comparison.torch.version,
                comparison.torch.threads,
                comparison.ours_samples_per_s,
                comparison.torch.samples_per_s,
                comparison.ratio
            )?;
        }
        let Some(steps) = &self.preset_steps else {
            return Ok(());
        };
        let alone = steps.background_alone.as_ref();
        let kinds = alone.map(|step| ("the background alone", step));
        for (name, step) in (kinds.into_iter()).chain([("both fields", &steps.both_fields)]) {
            writeln!(
                f,
                "{} preset, {name}: {:.1} ms for {:.0} samples, {:.0} samples/s; optimisers \
                 and bookkeeping {:.1} %",
                steps.preset,
                step.step_ms,
                step.samples_per_step,
                step.trained_samples_per_s,
                100.0 * step.overhead_share
            )?;
            phases(f, &step.phase_ms, &step.phase_share)?;
        }
        Ok(())
    }
}
