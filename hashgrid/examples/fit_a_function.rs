//! Fits a hash grid to a function of space by plain gradient descent:
//! `cargo run --release -p hashgrid --example fit_a_function`.

use burn::tensor::{Device, Distribution, Tensor};
use hashgrid::{GridConfig, HashGrid};

const POINTS: usize = 4096;
const STEPS: usize = 200;
const RATE: f32 = 20.0;

fn main() {
    let device = Device::flex().autodiff();
    let config = GridConfig {
        levels: 4,
        base_resolution: 4,
        finest_resolution: 32,
        log2_table_size: 14,
        ..GridConfig::default()
    };
    let mut grid = HashGrid::new(&config, 1, &device);
    let levels = config.levels;
    for step in 0..=STEPS {
        let points = Tensor::<2>::random([POINTS, 3], Distribution::Uniform(0.0, 1.0), &device);
        let wanted = (points.clone() * 6.0).sin().sum_dim(1);
        // The plainest of decoders: the sum of all features.
        let features = grid.forward(points, levels);
        let loss = (features.sum_dim(1) - wanted).powi_scalar(2).mean();
        if step % 50 == 0 {
            println!(
                "step {step:3}: mean squared error {:.5}",
                loss.clone().into_scalar::<f32>()
            );
        }
        let gradients = loss.backward();
        let table = grid.table.val();
        if let Some(gradient) = table.grad(&gradients) {
            let next = table.inner() - gradient * RATE;
            grid.table = grid.table.map(|_| Tensor::from_inner(next).require_grad());
        }
    }
}
