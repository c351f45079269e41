//! Times the field ops on the device that the parity tests use: `cargo run --release -p sos-tests
//! --features wgpu --example gpu_ops [POINTS]`.
//!
//! Sizes are those of the default preset. Figures are of the best of several runs, with the wait for the
//! result; processor time, where the system tells it, is what counts for a software renderer.

use std::sync::Arc;
use std::time::Instant;

use burn::tensor::{Device, Tensor, TensorData};
use hashgrid::{GridConfig, GridLayout, SparseGrad};
use neus_render::random::unit_float;
use scene_decomp::colour_field::{ColourFieldInputs, colour_field};
use scene_decomp::{InitialShape, Surface, SurfaceConfig};

const RUNS: usize = 8;

struct Case {
    surface: Surface,
    layout: Arc<GridLayout>,
    gradient: SparseGrad,
    points: Tensor<2>,
    directions: Tensor<2>,
}

impl Case {
    fn new(n: usize, device: &Device) -> Self {
        let grid = GridConfig {
            log2_table_size: 18,
            ..GridConfig::default()
        };
        let layout = Arc::new(GridLayout::new(&grid));
        let config = SurfaceConfig {
            grid,
            hidden: 64,
            features: 12,
            extra: 0,
            direction_degree: 1,
            outputs: 4,
            half_side: 1.0,
            beta: 100.0,
            initial: InitialShape::Ball(0.5),
        };
        let mut surface = Surface::new(&config, 1, device);
        surface.grid.table = surface.grid.table.set_require_grad(false);
        let rows = |seed: u64| {
            let values: Vec<f32> = (0..3 * n as u64)
                .map(|i| 2.0 * unit_float(seed, i) - 1.0)
                .collect();
            Tensor::from_data(TensorData::new(values, [n, 3]), device)
        };
        Self {
            gradient: SparseGrad::new(&layout),
            points: rows(1),
            directions: rows(2),
            surface,
            layout,
        }
    }

    fn geometry(&self) -> Tensor<2> {
        let levels = self.layout.levels.len();
        let config = self
            .surface
            .sdf_config(&self.layout, levels, Some(self.gradient.clone()));
        self.surface.geometry(self.points.clone(), config)
    }

    fn colour(&self, geometry: Tensor<2>) -> Tensor<2> {
        let [n, _] = geometry.dims();
        let device = geometry.device();
        colour_field(
            ColourFieldInputs {
                geometry,
                points: self.points.clone(),
                directions: self.directions.clone(),
                extra: Tensor::zeros([n, 0], &device),
            },
            self.surface.colour_weights(),
        )
    }
}

/// Waits for a tensor: data is fetched when its values are asked for.
fn wait<const D: usize>(tensor: Tensor<D>) {
    let values = tensor.slice(0..1).into_data().try_to_vec::<f32>();
    assert!(values.is_ok_and(|values| !values.is_empty()), "no values");
}

/// Milliseconds that all threads of this process have computed for; zero where nobody says.
fn processor_ms() -> f64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else {
        return 0.0;
    };
    tasks
        .filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok())
        .filter_map(|text| text.split(' ').next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-6
}

fn time(name: &str, run: impl Fn()) {
    let start = Instant::now();
    run();
    let first = start.elapsed().as_secs_f64();
    let (mut wall, mut processor) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..RUNS {
        let (start, before) = (Instant::now(), processor_ms());
        run();
        wall = wall.min(1e3 * start.elapsed().as_secs_f64());
        processor = processor.min(processor_ms() - before);
    }
    println!(
        "{name:34} {wall:8.1} ms, {processor:8.1} ms of processors (the first run {first:.1} s)"
    );
}

fn device() -> Option<Device> {
    #[cfg(feature = "wgpu")]
    for adapter in gpu_tensors::adapters() {
        if let Some(device) = adapter.device() {
            println!("on {} ({})", adapter.name, adapter.kind);
            return Some(device);
        }
    }
    None
}

fn main() {
    let n = std::env::args()
        .nth(1)
        .and_then(|n| n.parse().ok())
        .unwrap_or(8192);
    let Some(device) = device() else {
        eprintln!("this build finds no device");
        return;
    };
    println!("{n} points");
    let plain = Case::new(n, &device);
    let tracked = Case::new(n, &device.autodiff());
    let geometry = plain.geometry();
    let tracked_geometry = tracked.geometry().detach().require_grad();
    time("sdf field, forward", || wait(plain.geometry()));
    time("sdf field, forward and backward", || {
        let loss = tracked.geometry().sum();
        let grads = loss.backward();
        if let Some(gradient) = tracked.surface.sdf[0].weight.val().grad(&grads) {
            wait(gradient);
        }
    });
    time("colour field, forward", || {
        wait(plain.colour(geometry.clone()));
    });
    time("colour field, forward and backward", || {
        let loss = tracked.colour(tracked_geometry.clone()).sum();
        let grads = loss.backward();
        if let Some(gradient) = tracked.surface.colour[0].weight.val().grad(&grads) {
            wait(gradient);
        }
    });
}
