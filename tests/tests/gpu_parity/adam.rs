//! The table's update: lazy Adam where the table is.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout, HashGrid, LazyAdam, SparseGrad};
use scene_decomp::sdf_field::{Normal, SdfFieldConfig, SdfFieldWeights, sdf_field};

use crate::support::{Random, VALUE, assert_close, gpu, numbers, tensor};

fn config() -> GridConfig {
    GridConfig {
        levels: 4,
        base_resolution: 4,
        finest_resolution: 40,
        log2_table_size: 10,
        ..GridConfig::default()
    }
}

/// A grid, its gradient and its optimiser.
struct Training {
    layout: Arc<GridLayout>,
    grid: HashGrid,
    gradient: SparseGrad,
    adam: LazyAdam,
    device: Device,
}

impl Training {
    fn new(device: &Device) -> Self {
        let device = device.clone().autodiff();
        let grid = HashGrid::new(&config(), 1, &device);
        let layout = grid.layout().clone();
        Self {
            gradient: SparseGrad::new(&layout),
            adam: LazyAdam::new(&layout),
            layout,
            grid,
            device,
        }
    }

    /// A step of a loss on `n` points near one corner, which change from step to step: most entries
    /// rest for a while.
    fn step(&mut self, number: u32) {
        let n = 20;
        let device = &self.device;
        let values: Vec<f32> = Random(number % 5 + 1)
            .coordinates(3 * n, 1.0)
            .iter()
            .map(|v| 0.3 * v)
            .collect();
        let inputs = 3 + self.layout.features();
        let mut random = Random(70);
        let weights = SdfFieldWeights {
            table: self.grid.table.val(),
            w1: tensor(&random.list(8 * inputs), [8, inputs], device).require_grad(),
            b1: tensor(&random.list(8), [8], device),
            w2: tensor(&random.list(8), [1, 8], device),
            b2: tensor(&random.list(1), [1], device),
        };
        let config = SdfFieldConfig {
            layout: self.layout.clone(),
            active_levels: 4,
            half_side: 1.0,
            beta: 20.0,
            normal: Normal::Computed,
            sparse: Some(self.gradient.clone()),
        };
        let out = sdf_field(tensor(&values, [n, 3], device), weights, config);
        // Linear in the outputs, so that rounding does not feed back into the gradient's sign.
        let _ = out.sum().backward();
        self.adam.step_grid(&mut self.grid, &self.gradient, 1e-3);
    }

    fn table(&self) -> Vec<f64> {
        numbers(self.grid.table.val())
    }
}

fn wide(values: Vec<f32>) -> Vec<f64> {
    values.into_iter().map(f64::from).collect()
}

#[test]
fn steps_on_the_gpu_are_those_on_the_cpu() {
    let Some(gpu) = gpu() else {
        return;
    };
    let (mut on_gpu, mut on_cpu) = (Training::new(&gpu), Training::new(&Device::flex()));
    let before = on_cpu.table();
    for number in 0..12 {
        on_gpu.step(number);
        on_cpu.step(number);
    }
    let moved =
        |table: Vec<f64>| -> Vec<f64> { table.iter().zip(&before).map(|(a, b)| a - b).collect() };
    let (found, expected) = (moved(on_gpu.table()), moved(on_cpu.table()));
    assert!(expected.iter().filter(|v| **v != 0.0).count() > 100);
    // The change, not the value. Where the gradient is rounding alone, so is its sign.
    let scale = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let far = found
        .iter()
        .zip(&expected)
        .filter(|(f, e)| (*f - *e).abs() > 1e-3 * scale)
        .count();
    assert!(far * 500 < found.len(), "{far} of {} values", found.len());
    for (found, expected) in on_gpu.adam.moments().into_iter().zip(on_cpu.adam.moments()) {
        assert_close("moments", &wide(found), &wide(expected), VALUE);
    }
    assert_eq!(on_gpu.gradient.touched_blocks(), 0);
}

#[test]
fn the_state_moves_between_devices() {
    let Some(gpu) = gpu() else {
        return;
    };
    let mut there = Training::new(&gpu);
    for number in 0..4 {
        there.step(number);
    }
    // To the CPU by way of what a checkpoint holds, and back.
    let mut here = Training::new(&Device::flex());
    let table: Vec<f32> = there.table().iter().map(|v| *v as f32).collect();
    here.grid
        .update_table(|values| values.copy_from_slice(&table));
    here.adam
        .restore(&there.adam.state(), there.adam.steps())
        .unwrap();
    let mut back = Training::new(&gpu);
    back.grid
        .update_table(|values| values.copy_from_slice(&table));
    back.adam
        .restore(&here.adam.state(), here.adam.steps())
        .unwrap();
    for training in [&mut there, &mut here, &mut back] {
        training.step(4);
    }
    let [first, second] = there.adam.moments();
    for other in [&here, &back] {
        let [m, v] = other.adam.moments();
        assert_close("first", &wide(m), &wide(first.clone()), VALUE);
        assert_close("second", &wide(v), &wide(second.clone()), VALUE);
    }
}
