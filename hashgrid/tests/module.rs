//! The grid as a module.
#![allow(missing_docs, clippy::unwrap_used, deprecated)]

use burn::Tensor;
use burn::module::Module;
use burn::tensor::Device;
use hashgrid::{GridConfig, HashGrid};

fn table(grid: &HashGrid) -> Vec<f32> {
    grid.table.val().into_data().to_vec().unwrap()
}

#[test]
fn a_seed_gives_the_same_bits_on_every_device() {
    let config = GridConfig {
        levels: 4,
        ..Default::default()
    };
    let flex = table(&HashGrid::new(&config, 3, &Device::flex()));
    assert_eq!(flex, table(&HashGrid::new(&config, 3, &Device::ndarray())));
    assert_ne!(flex, table(&HashGrid::new(&config, 4, &Device::flex())));
    assert!(flex.iter().all(|value| value.abs() < 1e-4));
    // Uniform: mean 0, variance (2e-4)^2 / 12, within five standard errors.
    let n = flex.len() as f64;
    let mean = flex.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let variance = flex.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / n;
    assert!(mean.abs() < 5.0 * 1e-4 / (3.0 * n).sqrt());
    assert!((variance / (4e-8 / 12.0) - 1.0).abs() < 5.0 * (0.8 / n).sqrt());
}

#[test]
fn encodes_points_and_is_a_module() {
    let device = Device::flex().autodiff();
    let config = GridConfig {
        levels: 4,
        ..Default::default()
    };
    let grid = HashGrid::new(&config, 3, &device);
    assert_eq!(grid.num_params(), 2 * grid.layout().entries());
    let points = Tensor::from_floats([[0.2, 0.4, 0.6], [0.0, 1.0, 0.5]], &device);
    let h = grid.forward(points.clone(), 3);
    assert_eq!(h.dims(), [2, 8]);
    let grads = h.sum().backward();
    let gradient = grid.table.val().grad(&grads).unwrap();
    // Weights add up to 1: 2 points, 3 levels, 2 features.
    let total: f32 = gradient.sum().into_scalar();
    assert!((total - 12.0).abs() < 1e-4);
    let (h, j) = grid.forward_with_jacobian(points, 4);
    assert_eq!((h.dims(), j.dims()), ([2, 8], [2, 8, 3]));

    let record = grid.clone().into_record();
    let other = HashGrid::new(&config, 9, &device).load_record(record);
    assert_eq!(table(&other), table(&grid));
    assert_eq!(other.layout(), grid.layout());
}
