//! The fused field ops against their rooflines.
//!
//! A kernel can be no faster than its arithmetic at the peak of the multiply-add units, nor than its
//! memory traffic at full bandwidth; the larger of the two times over the time it took is the share
//! reported. [`Cost`] counts what the mathematics asks for, not what a kernel happens to do.
//!
//! A table's gradient is added up level by level, in a buffer that stays in the caches. Its lines do not
//! count as traffic of the memory; they have a ceiling of their own, the rate at which a core adds to such
//! a buffer in no order.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout, Hash, LazyAdam, SparseGrad};
use scene_decomp::{InitialShape, Surface, SurfaceConfig, colour_field, sdf_field};
use serde::Serialize;
use tensor_slices::Stopwatch;

use crate::peaks::Peaks;
use crate::phases::{SCATTER_OF, ScatterMark};

/// Points of a measurement: about those of a batch's share of one field.
const POINTS: usize = 16_384;
/// Calls before the measurement, and in it; their median counts.
const WARM_UP: usize = 3;
const CALLS: usize = 15;

/// Work of one point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    /// Operations, a multiply-add counting two.
    pub(crate) flops: f64,
    /// To and from memory.
    pub(crate) bytes: f64,
    /// Those of them that are cache lines in no order.
    pub(crate) scattered: f64,
    /// Of the lines of a level's gradient that are added to, in no order.
    pub(crate) added: f64,
}

/// One op in one direction.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct OpFigures {
    pub(crate) name: &'static str,
    /// What the grid hashes.
    pub(crate) hash: Hash,
    pub(crate) one_core: bool,
    pub(crate) points: usize,
    pub(crate) ms: f64,
    pub(crate) gflops: f64,
    pub(crate) gbs: f64,
    /// The time of its arithmetic at the peak.
    pub(crate) arithmetic_ms: f64,
    /// The time of its traffic at full bandwidth.
    pub(crate) traffic_ms: f64,
    /// The same where cache lines in no order come as fast as this machine fetches such lines.
    pub(crate) scattered_traffic_ms: f64,
    /// The time of what it adds to a level's gradient, at the rate for such a buffer.
    pub(crate) added_ms: f64,
    /// The largest of arithmetic, traffic and additions over `ms`.
    pub(crate) roofline_share: f64,
}

/// Sizes that the costs depend on.
pub(crate) struct OpSizes {
    levels: f64,
    hashed: f64,
    /// Cache lines that the corners of a cell lie on, on a hashed level.
    lines: f64,
    inputs: f64,
    hidden: f64,
    outputs: f64,
    colour_inputs: f64,
    colours: f64,
}

/// Operations of softplus and its slope: exp 20, log 19, the rest 9.
const SOFTPLUS: f64 = 48.0;
/// Of a sigmoid.
const SIGMOID: f64 = 20.0;
/// Bytes of a value, and of a cache line.
pub(crate) const VALUE: f64 = 4.0;
const LINE: f64 = 64.0;

impl OpSizes {
    /// FoCoR's at the paper's sizes.
    pub(crate) fn new(layout: &GridLayout) -> Self {
        let levels = layout.levels.len() as f64;
        Self {
            levels,
            hashed: layout.levels.iter().filter(|l| l.hash.is_some()).count() as f64,
            lines: match layout.levels.last().and_then(|finest| finest.hash) {
                // Of two nodes along an axis, every second pair lies in one block.
                Some(Hash::Blocks) => 1.5_f64.powi(3),
                Some(Hash::Nodes) | None => 4.0,
            },
            inputs: 3.0 + 2.0 * levels,
            hidden: 64.0,
            outputs: 13.0,
            colour_inputs: 22.0,
            colours: 4.0,
        }
    }

    /// Of the sdf field forward and backward, and the colour field forward and backward.
    pub(crate) fn all(&self) -> [Cost; 4] {
        [
            self.forward(),
            self.backward(),
            self.colour_forward(),
            self.colour_backward(),
        ]
    }

    /// Encoding with its derivative: positions within cells, and two features blended, each with
    /// seven interpolations for the value and as much again for the gradient.
    fn encoding(&self) -> f64 {
        self.levels * (12.0 + 2.0 * 43.0)
    }

    /// Lines of hashed levels. Dense levels stay in cache.
    fn table_bytes(&self) -> f64 {
        self.hashed * self.lines * LINE
    }

    fn forward(&self) -> Cost {
        let OpSizes {
            inputs,
            hidden,
            outputs,
            ..
        } = *self;
        let features = inputs - 3.0;
        Cost {
            flops: self.encoding()
                // Hidden layer, output layer, and the hidden layer's way back for the normal.
                + 2.0 * hidden * (inputs + outputs + inputs)
                + hidden * (SOFTPLUS + 1.0)
                // J^T g.
                + 6.0 * features,
            bytes: self.table_bytes() + VALUE * (3.0 + outputs + 3.0),
            scattered: self.table_bytes(),
            added: 0.0,
        }
    }

    fn backward(&self) -> Cost {
        let OpSizes {
            inputs,
            hidden,
            outputs,
            ..
        } = *self;
        let features = inputs - 3.0;
        let scatter = self.levels * (12.0 + 2.0 * 8.0 * 7.0);
        Cost {
            flops: scatter
                // dg = J dn, its layer, and the three products for dL/dW1 and dL/dW2.
                + 6.0 * features
                + 2.0 * hidden * (inputs + inputs + inputs + outputs)
                // Through the output layer and back to the features.
                + 2.0 * hidden * (outputs + features)
                + 10.0 * hidden,
            bytes: VALUE * (outputs + 3.0),
            scattered: 0.0,
            added: self.table_bytes(),
        }
    }

    fn colour_layers(&self) -> f64 {
        self.hidden * (self.colour_inputs + self.hidden + self.colours)
    }

    fn colour_forward(&self) -> Cost {
        Cost {
            flops: 2.0 * self.colour_layers() + 2.0 * self.hidden + SIGMOID * self.colours,
            bytes: VALUE * (self.colour_inputs + self.colours),
            scattered: 0.0,
            added: 0.0,
        }
    }

    fn colour_backward(&self) -> Cost {
        Cost {
            // Gradients of the weights, and of the inputs.
            flops: 4.0 * self.colour_layers() + 2.0 * self.hidden + 3.0 * self.colours,
            bytes: VALUE * (self.colour_inputs + self.outputs + 3.0 + self.colours),
            scattered: 0.0,
            added: 0.0,
        }
    }
}

/// FoCoR at the paper's sizes.
pub(crate) fn surface_config() -> SurfaceConfig {
    SurfaceConfig {
        grid: GridConfig::default(),
        hidden: 64,
        features: 12,
        extra: 0,
        direction_degree: 1,
        outputs: 4,
        half_side: 1.0,
        beta: 100.0,
        initial: InitialShape::Ball(0.5),
    }
}

/// Measures FoCoR's ops at the paper's sizes on one core and on all, with either hash.
pub(crate) fn measure(peaks: &Peaks, device: &Device) -> Result<Vec<OpFigures>> {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let both = |one_core: bool| {
        [Hash::Nodes, Hash::Blocks]
            .into_iter()
            .flat_map(move |hash| ops(peaks, device, one_core, hash))
    };
    let mut figures: Vec<OpFigures> = one.install(|| both(true).collect());
    figures.extend(both(false));
    Ok(figures)
}

fn ops(peaks: &Peaks, device: &Device, one_core: bool, hash: Hash) -> Vec<OpFigures> {
    let mut config = surface_config();
    config.grid.hash = hash;
    let device = device.clone().autodiff();
    let layout = Arc::new(GridLayout::new(&config.grid));
    let mut surface = Surface::new(&config, 1, &device);
    surface.grid.table = surface.grid.table.set_require_grad(false);
    let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
    let levels = layout.levels.len();
    let [forward, backward, colour_forward, colour_backward] = OpSizes::new(&layout).all();
    let (points, directions) = ray_points(POINTS);
    let cases: [(&str, &Stopwatch, Cost); 4] = [
        ("sdf field forward", &sdf_field::FORWARD, forward),
        ("sdf field backward", &sdf_field::BACKWARD, backward),
        (
            "colour field forward",
            &colour_field::FORWARD,
            colour_forward,
        ),
        (
            "colour field backward",
            &colour_field::BACKWARD,
            colour_backward,
        ),
    ];
    let mut times = vec![Vec::new(); cases.len()];
    for call in 0..WARM_UP + CALLS {
        let before = cases.map(|(_, stopwatch, _)| stopwatch.total());
        let samples = surface.sample(
            &points,
            &directions,
            &[],
            surface.sdf_config(&layout, levels, Some(gradient.clone())),
        );
        let _ = (samples.geometry.sum() + samples.colour.sum()).backward();
        // The table's gradient waits for a step, whose scatter is the end of the way back.
        let (mark, begun) = (ScatterMark::now(), Instant::now());
        adam.step_grid(&mut surface.grid, &gradient, 0.0);
        let scatter = begun.elapsed().mul_f64(mark.share());
        if call >= WARM_UP {
            for ((times, (name, stopwatch, _)), before) in times.iter_mut().zip(&cases).zip(before)
            {
                let waited = if *name == SCATTER_OF {
                    scatter
                } else {
                    Duration::ZERO
                };
                times.push(stopwatch.total() - before + waited);
            }
        }
    }
    cases
        .into_iter()
        .zip(times)
        // Colours are asked of no grid.
        .filter(|((name, ..), _)| hash == Hash::Nodes || name.starts_with("sdf"))
        .map(|((name, _, cost), times)| figures(name, hash, one_core, cost, times, peaks))
        .collect()
}

fn figures(
    name: &'static str,
    hash: Hash,
    one_core: bool,
    cost: Cost,
    mut times: Vec<Duration>,
    peaks: &Peaks,
) -> OpFigures {
    let (gflops, gbs) = peaks.of(one_core);
    let (lines_gbs, added_gbs) = if one_core {
        (peaks.lines_gbs_one_core, peaks.added_lines_gbs_one_core)
    } else {
        (peaks.lines_gbs, peaks.added_lines_gbs)
    };
    times.sort();
    let seconds = times[times.len() / 2].as_secs_f64();
    let (flops, bytes) = (cost.flops * POINTS as f64, cost.bytes * POINTS as f64);
    let scattered = cost.scattered * POINTS as f64;
    let (arithmetic, traffic) = (flops / gflops * 1e-9, bytes / gbs * 1e-9);
    let added = cost.added * POINTS as f64 / added_gbs * 1e-9;
    let scattered_traffic = (scattered / lines_gbs + (bytes - scattered) / gbs) * 1e-9;
    OpFigures {
        name,
        hash,
        one_core,
        points: POINTS,
        ms: seconds * 1e3,
        gflops: flops / seconds * 1e-9,
        gbs: bytes / seconds * 1e-9,
        arithmetic_ms: arithmetic * 1e3,
        traffic_ms: traffic * 1e3,
        scattered_traffic_ms: scattered_traffic * 1e3,
        added_ms: added * 1e3,
        roofline_share: arithmetic.max(traffic).max(added) / seconds,
    }
}

/// `count` points on rays through the box, 64 each, and the rays' directions.
pub(crate) fn ray_points(count: usize) -> (Vec<f32>, Vec<f32>) {
    use glam::Vec3;
    use rand::RngExt;
    let mut random = sos_train::train::sampler::step_random(3, 0);
    let (mut points, mut directions) = (Vec::new(), Vec::new());
    for _ in 0..count / 64 {
        let mut face = |z: f32| {
            Vec3::new(
                random.random_range(-1.0..1.0),
                random.random_range(-1.0..1.0),
                z,
            )
        };
        let (from, to) = (face(-1.0), face(1.0));
        let direction = (to - from).normalize();
        for k in 0..64 {
            points.extend(from.lerp(to, (k as f32 + 0.5) / 64.0).to_array());
            directions.extend(direction.to_array());
        }
    }
    (points, directions)
}
