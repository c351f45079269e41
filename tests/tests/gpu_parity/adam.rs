//! The table's update: lazy Adam where the table is.

use std::sync::Arc;

use burn::tensor::Device;
use hashgrid::{GridConfig, GridLayout, HashGrid, LazyAdam, SparseGrad};
use scene_decomp::sdf_field::{Forward, Normal, SdfFieldConfig, SdfFieldWeights, sdf_field};

use crate::support::{Random, VALUE, assert_close, assert_same_numbers, gpu, numbers, tensor};

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
            forward: Forward::Alone,
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

/// A grid whose gradient is given entry by entry, after steps on both devices: the table, its moments.
fn steps_with(
    config: &GridConfig,
    device: &Device,
    steps: u32,
    gradient_of: impl Fn(u32, usize) -> f32 + Sync,
) -> [Vec<f64>; 3] {
    let mut grid = HashGrid::new(config, 1, device);
    let layout = grid.layout().clone();
    let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
    for step in 0..steps {
        gradient.accumulate_levels(&layout, layout.levels.len(), |level, values| {
            let first = 2 * layout.levels[level].offset;
            for (i, value) in values.iter_mut().enumerate() {
                *value += gradient_of(step, first + i);
            }
        });
        adam.step_grid(&mut grid, &gradient, 1e-2);
        assert_eq!(gradient.touched_blocks(), 0, "used up");
    }
    let [first, second] = adam.moments();
    [numbers(grid.table.val()), wide(first), wide(second)]
}

const PARTS: [&str; 3] = ["table", "first moment", "second moment"];

/// Neither a value nor its neighbour in the same entry or block may suffer from one that is no number.
#[test]
fn a_gradient_that_is_no_number_stays_where_it_is() {
    let Some(gpu) = gpu() else {
        return;
    };
    let gradient = |step: u32, i: usize| match i {
        37 if step == 1 => f32::NAN,
        // Hit always, at times, never.
        _ if i.is_multiple_of(3) || (i / 64) % 4 == step as usize => {
            ((i * 7 % 23) as f32 - 11.5) * 1e-3
        }
        _ => 0.0,
    };
    let found = steps_with(&config(), &gpu, 4, gradient);
    let expected = steps_with(&config(), &Device::flex(), 4, gradient);
    for ((part, found), expected) in PARTS.iter().zip(&found).zip(&expected) {
        assert_eq!(expected.iter().filter(|v| v.is_nan()).count(), 1, "{part}");
        assert_same_numbers(part, found, expected, VALUE);
    }
}

/// Steps count where nothing was hit, and leave the table alone.
#[test]
fn steps_without_a_gradient_change_nothing_but_the_moments_age() {
    let Some(gpu) = gpu() else {
        return;
    };
    let never = |_: u32, _: usize| 0.0;
    let found = steps_with(&config(), &gpu, 3, never);
    let untouched = HashGrid::new(&config(), 1, &gpu);
    assert_eq!(found[0], numbers(untouched.table.val()));
    assert!(found[1..].iter().flatten().all(|value| *value == 0.0));
    // In between as well.
    let at_times = |step: u32, i: usize| if step == 1 { 0.0 } else { (i % 5) as f32 };
    let found = steps_with(&config(), &gpu, 3, at_times);
    let expected = steps_with(&config(), &Device::flex(), 3, at_times);
    for ((part, found), expected) in PARTS.iter().zip(&found).zip(&expected) {
        assert_close(part, found, expected, VALUE);
    }
}

/// A thread takes an entry, a workgroup 64 of them.
#[test]
fn a_table_may_need_more_workgroups_than_an_axis_holds() {
    let Some(gpu) = gpu() else {
        return;
    };
    let config = GridConfig {
        levels: 2,
        base_resolution: 16,
        finest_resolution: 512,
        log2_table_size: 22,
        ..GridConfig::default()
    };
    assert!(GridLayout::new(&config).entries() > 65_535 * 64);
    let gradient = |step: u32, i: usize| ((i * 7 + step as usize) % 23) as f32 - 11.0;
    let found = steps_with(&config, &gpu, 2, gradient);
    let expected = steps_with(&config, &Device::flex(), 2, gradient);
    for ((part, found), expected) in PARTS.iter().zip(&found).zip(&expected) {
        assert_close(part, found, expected, VALUE);
    }
}
