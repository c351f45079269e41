//! Teaches one neural surface a signed distance and asks what it has become:
//! `cargo run --release -p scene-decomp --example learn_a_shape`.

use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::{Device, Distribution, Tensor};
use hashgrid::{GridConfig, GridLayout};
use scene_decomp::{FrozenSurface, InitialShape, Surface, SurfaceConfig};
use std::sync::Arc;

const POINTS: usize = 4096;
const STEPS: usize = 200;

fn main() {
    let device = Device::flex().autodiff();
    let grid = GridConfig {
        levels: 6,
        base_resolution: 4,
        finest_resolution: 64,
        log2_table_size: 14,
        ..GridConfig::default()
    };
    let config = SurfaceConfig {
        grid: grid.clone(),
        hidden: 32,
        features: 3,
        extra: 0,
        direction_degree: 1,
        outputs: 3,
        half_side: 1.0,
        beta: 100.0,
        initial: InitialShape::Ball(0.5),
    };
    let layout = Arc::new(GridLayout::new(&grid));
    let mut surface = Surface::new(&config, 1, &device);
    let mut adam = AdamConfig::new().with_epsilon(1e-15).init();
    for step in 0..=STEPS {
        let points = Tensor::<2>::random([POINTS, 3], Distribution::Uniform(-1.0, 1.0), &device);
        // A cube of side 1: the largest of the coordinates' distances.
        let wanted = points.clone().abs().max_dim(1) - 0.5;
        let geometry = surface.geometry(points, surface.sdf_config(&layout, grid.levels, None));
        // Column 0 is the distance; the last three are its normal, to be of length 1.
        let [n, columns] = geometry.dims();
        let sdf = geometry.clone().slice([0..n, 0..1]);
        let normals = geometry.slice([0..n, columns - 3..columns]);
        let error = (sdf - wanted).abs().mean();
        let eikonal = (normals.powi_scalar(2).sum_dim(1).sqrt() - 1.0).powi_scalar(2);
        if step % 50 == 0 {
            let error = error.clone().into_scalar::<f32>();
            println!("step {step:3}: mean error of the distance {error:.4}");
        }
        let mut gradients = (error + eikonal.mean() * 0.01).backward();
        let gradients = GradientsParams::from_module(&mut gradients, &surface);
        surface = adam.step(5e-3, surface, gradients);
    }
    let frozen = FrozenSurface::new(&surface, &layout, grid.levels);
    let answer = frozen.geometry(&[0.5, 0.1, 0.2]);
    println!(
        "in the middle of a face: distance {:.3}, normal {:.2}",
        answer.sdf(0),
        answer.normal(0)
    );
}
