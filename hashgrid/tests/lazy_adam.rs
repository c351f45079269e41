//! The lazy Adam against a dense textbook Adam in f64.
#![allow(missing_docs, clippy::unwrap_used)]

mod support;

use burn::tensor::Device;
use hashgrid::{
    FEATURES, GridConfig, GridLayout, HashGrid, LazyAdam, LazyAdamConfig, MomentPrecision,
    RestoreError, SparseGrad, cpu,
};
use support::Random;

/// Relative error of f32 moments: a step rounds three times, and the decay forgets.
const MOMENT: f64 = 3e-6;
/// Parameters are of size 1 and take 100 steps of 0.01, each rounded to an f32.
const PARAMETER: f64 = 2e-5;

fn layout() -> GridLayout {
    GridLayout::new(&GridConfig {
        levels: 2,
        base_resolution: 3,
        finest_resolution: 5,
        ..Default::default()
    })
}

struct Dense {
    step: i32,
    m: Vec<f64>,
    v: Vec<f64>,
    table: Vec<f64>,
}

impl Dense {
    fn new(table: &[f32]) -> Self {
        let zeros = vec![0.0; table.len()];
        Self {
            step: 0,
            m: zeros.clone(),
            v: zeros,
            table: table.iter().map(|t| f64::from(*t)).collect(),
        }
    }

    /// Adam as published; values with a gradient of zero only keep their moments.
    fn step(&mut self, grad: &[f32], rate: f64) {
        self.step += 1;
        for (i, g) in grad.iter().enumerate() {
            let g = f64::from(*g);
            self.m[i] = 0.9 * self.m[i] + 0.1 * g;
            self.v[i] = 0.99 * self.v[i] + 0.01 * g * g;
            let m = self.m[i] / (1.0 - 0.9_f64.powi(self.step));
            let v = self.v[i] / (1.0 - 0.99_f64.powi(self.step));
            if g != 0.0 {
                self.table[i] -= rate * m / (v.sqrt() + 1e-15);
            }
        }
    }

    fn compare(&self, adam: &LazyAdam, table: &[f32]) {
        let [m, v] = adam.moments();
        // The first moment may cancel: its error is measured against the gradients' size.
        let scale = self.v.iter().map(|v| v.sqrt()).fold(0.0, f64::max);
        for i in 0..table.len() {
            assert!((f64::from(m[i]) - self.m[i]).abs() <= MOMENT * scale);
            assert!((f64::from(v[i]) - self.v[i]).abs() <= MOMENT * self.v[i] * 10.0);
            assert!((f64::from(table[i]) - self.table[i]).abs() < PARAMETER);
        }
    }
}

/// Feeds a dense gradient.
fn feed(gradient: &SparseGrad, layout: &GridLayout, values: &[f32]) {
    gradient.accumulate_levels(layout, layout.levels.len(), |l, grad| {
        let level = &layout.levels[l];
        let own = &values[FEATURES * level.offset..FEATURES * (level.offset + level.entries)];
        grad.iter_mut()
            .zip(own)
            .for_each(|(grad, value)| *grad += value);
    });
}

#[test]
fn is_adam_when_everything_is_touched() {
    let layout = layout();
    let mut random = Random(1);
    let mut table = random.signed(2 * layout.entries());
    let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
    let mut dense = Dense::new(&table);
    for _ in 0..100 {
        let values = random.signed(table.len());
        feed(&gradient, &layout, &values);
        adam.step(&mut table, &gradient, 0.01);
        dense.step(&values, 0.01);
    }
    assert_eq!(adam.steps(), 100);
    dense.compare(&adam, &table);
}

/// Gradients that wait give what gradients that are added at once give, bit by bit.
#[test]
fn passes_that_wait_are_the_same_step() {
    let layout = layout();
    let mut random = Random(5);
    for moments in [MomentPrecision::Single, MomentPrecision::Half] {
        let config = LazyAdamConfig {
            moments,
            ..LazyAdamConfig::default()
        };
        let start = random.signed(2 * layout.entries());
        let run = |wait: bool, seed: u64| {
            let mut random = Random(seed);
            let mut table = start.clone();
            let gradient = SparseGrad::new(&layout);
            let mut adam = LazyAdam::with_config(&layout, config);
            for step in 0..12 {
                // Two passes a step, the second of fewer levels; none in some steps.
                for levels in if step % 4 == 3 { vec![] } else { vec![2, 1] } {
                    let [x, y, z, d] =
                        std::array::from_fn(|_| (0..7).map(|_| random.unit()).collect::<Vec<_>>());
                    let inner = layout.clone();
                    let add = move |l: usize, grad: &mut [f32], touched: &mut [u8]| {
                        let rows = cpu::ScatterRows {
                            position: [&x, &y, &z],
                            d_value: [&d; 2],
                            normal_part: None,
                            prefetch_offset: 0,
                        };
                        cpu::scatter_level(&inner, l, &rows, grad, Some(touched));
                    };
                    if wait {
                        gradient.defer_levels(&layout, levels, add);
                    } else {
                        gradient.accumulate_levels_marked(&layout, levels, add);
                    }
                }
                adam.step(&mut table, &gradient, 0.01);
                assert_eq!(gradient.touched_blocks(), 0);
            }
            (table, adam.state())
        };
        let (at_once, later) = (run(false, 9), run(true, 9));
        assert_ne!(at_once.0, start);
        assert_eq!(at_once, later);
    }
}

/// With halves as moments, a table goes where it goes with all of their bits.
#[test]
fn half_moments_are_adam_within_their_precision() {
    let layout = layout();
    let mut random = Random(6);
    let mut table = random.signed(2 * layout.entries());
    let gradient = SparseGrad::new(&layout);
    let config = LazyAdamConfig {
        moments: MomentPrecision::Half,
        ..LazyAdamConfig::default()
    };
    let mut adam = LazyAdam::with_config(&layout, config);
    let mut dense = Dense::new(&table);
    // A mean that all agree on, so that the table moves by about the rate in each step.
    let mean = random.signed(table.len());
    for _ in 0..400 {
        let noise = random.signed(table.len());
        let values: Vec<f32> = mean.iter().zip(noise).map(|(m, n)| m + 0.3 * n).collect();
        feed(&gradient, &layout, &values);
        adam.step(&mut table, &gradient, 0.01);
        dense.step(&values, 0.01);
    }
    let (mut bias, mut worst) = (0.0f64, 0.0f64);
    let [_, v] = adam.moments();
    for i in 0..table.len() {
        worst = worst.max((f64::from(table[i]) - dense.table[i]).abs());
        bias += (f64::from(v[i]) / dense.v[i] - 1.0) / table.len() as f64;
    }
    // A rounding is off by 0.23 % as a root mean square; the second moment remembers a hundred of them,
    // which makes 1.6 %, and a step half of that. 400 steps of 0.01 are four such memories of a path of 1:
    // 0.8 % of it, twice, as a root mean square. The bound is five times that.
    assert!(worst < 5.0 * 2.0 * 0.008, "{worst}");
    assert!(bias.abs() < 2e-3, "{bias}");
}

#[test]
fn skipped_steps_decay_exactly() {
    let layout = layout();
    let mut random = Random(2);
    let mut table = random.signed(2 * layout.entries());
    let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
    let mut dense = Dense::new(&table);
    let mut untouched = table.clone();
    for step in 0..200 {
        // A run of empty steps in between that is longer than the table of powers.
        let share = if (50..130).contains(&step) { 0.0 } else { 0.2 };
        let mut values = random.signed(table.len());
        for block in values.chunks_mut(16) {
            if random.unit() >= share {
                block.fill(0.0);
            }
            block[3] = 0.0;
        }
        feed(&gradient, &layout, &values);
        adam.step(&mut table, &gradient, 0.005);
        dense.step(&values, 0.005);
        if step == 49 {
            untouched.clone_from(&table);
        }
        if step == 129 {
            assert_eq!(untouched, table);
        }
    }
    dense.compare(&adam, &table);
}

#[test]
fn goes_on_with_the_same_bits_after_a_checkpoint() {
    let layout = layout();
    let mut random = Random(3);
    let mut table = random.signed(2 * layout.entries());
    let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
    let mut saved = None;
    let steps: Vec<Vec<f32>> = (0..20)
        .map(|_| {
            (0..table.len())
                .map(|_| {
                    if random.unit() < 0.1 {
                        random.unit()
                    } else {
                        0.0
                    }
                })
                .collect()
        })
        .collect();
    for (i, values) in steps.iter().enumerate() {
        if i == 10 {
            saved = Some((table.clone(), adam.state(), adam.steps()));
        }
        feed(&gradient, &layout, values);
        adam.step(&mut table, &gradient, 0.01);
    }
    let (mut again, state, count) = saved.unwrap();
    let mut resumed = LazyAdam::new(&layout);
    resumed.restore(&state, count).unwrap();
    for values in &steps[10..] {
        feed(&gradient, &layout, values);
        resumed.step(&mut again, &gradient, 0.01);
    }
    assert_eq!(again, table);
    assert_eq!(resumed.state(), adam.state());

    let expected = state.len();
    assert_eq!(
        resumed.restore(&state[1..], count),
        Err(RestoreError::Length {
            found: expected - 1,
            expected
        })
    );
    assert!(matches!(
        resumed.restore(&state, 3),
        Err(RestoreError::Step { steps: 3, .. })
    ));
}

#[test]
#[allow(deprecated)]
fn a_grids_table_is_updated_in_place_on_each_device() {
    let config = GridConfig {
        levels: 2,
        base_resolution: 3,
        finest_resolution: 5,
        ..Default::default()
    };
    let devices = [
        Device::flex(),
        Device::ndarray(),
        Device::flex().autodiff(),
        Device::ndarray().autodiff(),
    ];
    let mut results = Vec::new();
    for device in devices {
        let mut grid = HashGrid::new(&config, 7, &device);
        let layout = grid.layout().clone();
        let (gradient, mut adam) = (SparseGrad::new(&layout), LazyAdam::new(&layout));
        let id = grid.table.id;
        let mut places = Vec::new();
        for _ in 0..3 {
            gradient.accumulate_levels(&layout, 1, |_, grad| grad[2] = 1.0);
            adam.step_grid(&mut grid, &gradient, 0.01);
            grid.update_table(|values| places.push(values.as_ptr()));
        }
        assert_eq!(grid.table.id, id);
        assert_eq!(grid.table.val().is_require_grad(), device.is_autodiff());
        assert_eq!(places[0], places[1]);
        assert_eq!(places[0], places[2]);
        let table: Vec<f32> = grid.table.val().into_data().to_vec().unwrap();
        assert!((table[2] + 0.03).abs() < 2e-4);
        results.push(table);
    }
    assert!(results.iter().all(|table| *table == results[0]));
}
