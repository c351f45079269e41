//! The networks' optimiser: Burn's Adam, and the same in a launch for a few parameters where CubeCL runs it.

use std::path::Path;
#[cfg(any(feature = "wgpu", feature = "cuda"))]
use std::sync::Arc;

use burn::module::Module;
use burn::optim::{
    Adam, AdamConfig, AdamState, GradientsParams, LearningRate, ModuleOptimizer, Optimizer,
    RecordState, StateSink, StateSource,
};
use burn::store::RecordError;
use burn::tensor::{Device, Tensor};
#[cfg(any(feature = "wgpu", feature = "cuda"))]
use gpu_tensors::{AdamRule, AdamSteps};

/// The method's constants, with an epsilon that suits hash tables.
const BETAS: [f32; 2] = [0.9, 0.99];
const EPSILON: f32 = 1e-15;

/// Adam for the parameters of a module.
pub(super) struct NetworkOptimiser {
    burns: ModuleOptimizer,
    #[cfg(any(feature = "wgpu", feature = "cuda"))]
    asked: Arc<AdamSteps>,
}

impl NetworkOptimiser {
    /// Before its first step.
    pub(super) fn new() -> Self {
        let [beta1, beta2] = BETAS;
        let adam = AdamConfig::new()
            .with_beta_1(beta1)
            .with_beta_2(beta2)
            .with_epsilon(EPSILON)
            .build();
        #[cfg(any(feature = "wgpu", feature = "cuda"))]
        let asked = Arc::default();
        Self {
            burns: ModuleOptimizer::from(NetworkAdam {
                burns: adam,
                #[cfg(any(feature = "wgpu", feature = "cuda"))]
                asked: Arc::clone(&asked),
            }),
            #[cfg(any(feature = "wgpu", feature = "cuda"))]
            asked,
        }
    }

    /// The module after a step down `gradients`.
    pub(super) fn step<M: Module>(
        &mut self,
        rate: LearningRate,
        module: M,
        gradients: GradientsParams,
    ) -> M {
        let module = self.burns.step(rate, module, gradients);
        #[cfg(any(feature = "wgpu", feature = "cuda"))]
        self.asked.launch();
        module
    }

    /// Writes the moments into a file.
    pub(super) fn save(&self, path: &Path) -> Result<(), RecordError> {
        self.burns.save(path)
    }

    /// Takes the moments of a file.
    pub(super) fn load(&mut self, path: &Path) -> Result<(), RecordError> {
        self.burns = self.burns.clone().load(path)?;
        Ok(())
    }
}

/// Burn's, whose state it shares, so that checkpoints move between devices.
#[derive(Clone)]
struct NetworkAdam {
    burns: Adam,
    /// What CubeCL runs, and [`NetworkOptimiser`] launches.
    #[cfg(any(feature = "wgpu", feature = "cuda"))]
    asked: Arc<AdamSteps>,
}

/// Burn's state, which comes from a file to the CPU: by itself it comes to Burn's default device, a GPU in builds that know
/// some, which need not be there.
#[derive(Clone)]
struct State<const D: usize>(AdamState<D>);

impl<const D: usize> RecordState for State<D> {
    fn state_flatten(&self, prefix: &str, out: &mut StateSink) {
        self.0.state_flatten(prefix, out);
    }

    fn state_unflatten(prefix: &str, src: &mut StateSource, _: &Device) -> Option<Self> {
        AdamState::state_unflatten(prefix, src, &Device::flex()).map(Self)
    }
}

impl Optimizer for NetworkAdam {
    type State<const D: usize> = State<D>;

    fn step<const D: usize>(
        &self,
        rate: LearningRate,
        tensor: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        let state = state.map(|state| state.0);
        #[cfg(any(feature = "wgpu", feature = "cuda"))]
        let state = match self.on_device(rate, &tensor, &gradient, state) {
            Ok((tensor, state)) => return (tensor, Some(State(state))),
            Err(state) => state,
        };
        let (tensor, state) = self.burns.step(rate, tensor, gradient, state);
        (tensor, state.map(State))
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        State(Adam::to_device(state.0, device))
    }
}

#[cfg(any(feature = "wgpu", feature = "cuda"))]
impl NetworkAdam {
    /// Asks for the step where CubeCL runs the parameter; the state as it came elsewhere.
    fn on_device<const D: usize>(
        &self,
        rate: LearningRate,
        tensor: &Tensor<D>,
        gradient: &Tensor<D>,
        state: Option<AdamState<D>>,
    ) -> Result<(Tensor<D>, AdamState<D>), Option<AdamState<D>>> {
        use burn::optim::AdaptiveMomentumState;

        let last = state.as_ref().map_or(0, |state| state.momentum.time);
        let time = last + 1;
        // Beyond some thousands of steps the corrections are one.
        let corrections = BETAS.map(|beta| 1.0 - f64::from(beta).powi(time.min(1 << 20) as i32));
        let [first, second] = corrections;
        let rule = AdamRule {
            decay: BETAS,
            rate: (rate * second.sqrt() / first) as f32,
            epsilon: (f64::from(EPSILON) * second.sqrt()) as f32,
        };
        let moments = state.map(|state| [state.momentum.moment_1, state.momentum.moment_2]);
        let momentum = |time, [first, second]: [Tensor<D>; 2]| {
            AdamState::new(AdaptiveMomentumState::new(time, first, second))
        };
        match self.asked.ask(tensor, gradient, moments, rule) {
            Ok([stepped, first, second]) => Ok((stepped, momentum(time, [first, second]))),
            Err(moments) => Err(moments.map(|moments| momentum(last, moments))),
        }
    }
}
