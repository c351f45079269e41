//! The networks' optimiser: Burn's Adam, and the same in one launch for a parameter where CubeCL runs it.

use burn::optim::{Adam, AdamConfig, AdamState, LearningRate, ModuleOptimizer, Optimizer};
use burn::tensor::{Device, Tensor};

/// The method's constants, with an epsilon that suits hash tables.
const BETAS: [f32; 2] = [0.9, 0.99];
const EPSILON: f32 = 1e-15;

/// An optimiser before its first step.
pub(super) fn adam() -> ModuleOptimizer {
    let [beta1, beta2] = BETAS;
    ModuleOptimizer::from(NetworkAdam(
        AdamConfig::new()
            .with_beta_1(beta1)
            .with_beta_2(beta2)
            .with_epsilon(EPSILON)
            .build(),
    ))
}

/// Burn's, whose state it shares, so that checkpoints move between devices.
#[derive(Clone)]
struct NetworkAdam(Adam);

impl Optimizer for NetworkAdam {
    type State<const D: usize> = AdamState<D>;

    fn step<const D: usize>(
        &self,
        rate: LearningRate,
        tensor: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        #[cfg(any(feature = "wgpu", feature = "cuda"))]
        if let Some((tensor, state)) = on_device(rate, &tensor, &gradient, state.as_ref()) {
            return (tensor, Some(state));
        }
        self.0.step(rate, tensor, gradient, state)
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        Adam::to_device(state, device)
    }
}

/// The step where CubeCL runs the parameter; `None` elsewhere.
#[cfg(any(feature = "wgpu", feature = "cuda"))]
fn on_device<const D: usize>(
    rate: LearningRate,
    tensor: &Tensor<D>,
    gradient: &Tensor<D>,
    state: Option<&AdamState<D>>,
) -> Option<(Tensor<D>, AdamState<D>)> {
    use burn::optim::AdaptiveMomentumState;

    let time = state.map_or(0, |state| state.momentum.time) + 1;
    // Beyond some thousands of steps the corrections are one.
    let [first, second] = BETAS.map(|beta| 1.0 - f64::from(beta).powi(time.min(1 << 20) as i32));
    let rule = gpu_tensors::AdamRule {
        decay: BETAS,
        rate: (rate * second.sqrt() / first) as f32,
        epsilon: (f64::from(EPSILON) * second.sqrt()) as f32,
    };
    let moments = state.map(|state| [&state.momentum.moment_1, &state.momentum.moment_2]);
    let [stepped, first, second] = gpu_tensors::adam_step(tensor, gradient, moments, rule)?;
    let momentum = AdaptiveMomentumState::new(time, first, second);
    Some((stepped, AdamState::new(momentum)))
}
