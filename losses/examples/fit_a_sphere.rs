//! Finds a sphere from points on its surface, some of them wrong:
//! `cargo run --release -p losses --example fit_a_sphere`.

use burn::tensor::{Device, Tensor, TensorData};
use losses::{PointPenalty, Schedule, point_loss};

const STEPS: u64 = 400;

/// Points of a sphere around (0.3, -0.2, 0.1) with radius 0.7; every tenth is far off.
fn points() -> Vec<f32> {
    (0..300)
        .flat_map(|i| {
            // Equal steps in height and by the golden angle go evenly around.
            let (z, turn) = (1.0 - (i as f32 + 0.5) / 150.0, 2.4 * i as f32);
            let across = (1.0 - z * z).sqrt();
            let radius = if i % 10 == 0 { 2.0 } else { 0.7 };
            [
                0.3 + radius * across * turn.cos(),
                -0.2 + radius * across * turn.sin(),
                0.1 + radius * z,
            ]
        })
        .collect()
}

fn main() {
    let device = Device::flex().autodiff();
    let points = Tensor::<2>::from_data(TensorData::new(points(), [300, 3]), &device);
    let rate = Schedule::WarmUpDecay {
        peak: 0.05,
        warm_up: 20,
        end: STEPS,
        final_ratio: 0.01,
    };
    // Huber's penalty grows linearly, so that a tenth of wrong points hardly moves the answer.
    let penalty = PointPenalty::Huber { delta: 0.05 };
    let mut centre = Tensor::<2>::zeros([1, 3], &device).require_grad();
    let mut radius = Tensor::<1>::ones([1], &device).require_grad();
    for step in 0..=STEPS {
        let offset = points.clone() - centre.clone();
        let sdf = offset.powi_scalar(2).sum_dim(1).sqrt().reshape([300]) - radius.clone();
        let loss = point_loss(sdf, penalty, None);
        if step % 100 == 0 {
            let centre = centre.to_data().try_to_vec::<f32>().unwrap_or_default();
            let radius = radius.clone().into_scalar::<f32>();
            println!("step {step:3}: centre {centre:.3?}, radius {radius:.3}");
        }
        let gradients = loss.backward();
        let rate = rate.at(step) as f32;
        if let (Some(c), Some(r)) = (centre.grad(&gradients), radius.grad(&gradients)) {
            centre = Tensor::from_inner(centre.inner() - c * rate).require_grad();
            radius = Tensor::from_inner(radius.inner() - r * rate).require_grad();
        }
    }
}
